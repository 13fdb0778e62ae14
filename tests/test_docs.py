"""The reference is made from the docstrings, of everything public and without complaint."""

import subprocess
import sys


def test_the_reference_builds(tmp_path):
    options = ["--docformat", "google", "--no-show-source", "--output-directory", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, "-m", "pdoc", *options, "selftouch_drake"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "Warn" not in done.stderr, done.stderr
    world = (tmp_path / "selftouch_drake" / "world.html").read_text(encoding="utf-8")
    assert "TactileSkin.AddToBuilder" in world
    assert (tmp_path / "selftouch_drake" / "show.html").is_file()
