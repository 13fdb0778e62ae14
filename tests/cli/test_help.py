"""The commands and their help."""

import subprocess
import sys

import pytest
from commands import selftouch

from selftouch_drake import __version__


def test_help_teaches():
    text = selftouch("--help").stdout
    for verb in (
        "run",
        "babble",
        "teach",
        "learn",
        "skin",
        "plan",
        "execute",
        "evaluate",
        "report",
        "play",
        "robot",
        "body",
    ):
        assert f"\n  {verb} " in text
    assert "selftouch plan runs/cube --from 3 --to 250" in text
    assert "..." not in text.partition("Commands:")[2]  # no line of it is cut
    assert selftouch().stdout == text


@pytest.mark.parametrize("module", ["selftouch_drake", "selftouch_drake.cli"])
def test_python_runs_the_package_as_the_command(module, tmp_path):
    def python(*words):
        command = [sys.executable, "-m", module, *words]
        return subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)

    assert python("--version").stdout == f"selftouch, version {__version__}\n"
    refusal = python("learn", "nowhere")
    assert refusal.returncode == 2
    assert refusal.stderr == (
        "selftouch: nowhere is not a run: it has no experiment.yaml; make one with "
        "`selftouch run`\n"
    )


def test_help_loads_nothing_that_is_slow():
    code = (
        "import sys; from selftouch_drake.cli import cli; "
        "cli.main(['--help'], standalone_mode=False); "
        "print(sorted({name.split('.')[0] for name in sys.modules} & set(sys.argv[1:])))"
    )
    slow = ("numpy", "rich", "yaml", "multiprocessing", "concurrent")
    done = subprocess.run([sys.executable, "-c", code, *slow], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "[]"
