"""Every benchmark runs, with as little work as it can be given."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "benchmarks"
#: Modules that benchmarks share.
SHARED = {"results"}
#: The arguments with which a benchmark has least to do; `{tmp}` is a folder for what it writes.
SMALL: dict[str, list[str]] = {
    "exploration": [
        "touches",
        *("--bodies", "sphere"),
        *("--until", "600"),
        *("--at", "600"),
        *("--executed", "1"),
        *("--targets", "40"),
        *("--ways", "active", "goals"),
    ],
    "growth": ["--touches", "50"],
    "mending": [
        *("--bodies", "sphere"),
        *("--kinds", "one"),
        *("--touches", "600"),
        *("--watched", "1000"),
        *("--targets", "20"),
        *("--pairs", "2"),
    ],
    "walks": ["--experiment", "sphere", "--touches", "200"],
    "servo": ["cube", "--out", "{tmp}", "--touches", "3000", "--targets", "60", "--pairs", "1"],
}


def test_every_benchmark_has_small_arguments():
    assert {path.stem for path in FOLDER.glob("*.py")} - SHARED == set(SMALL)


@pytest.mark.slow
@pytest.mark.parametrize("name", SMALL)
def test_a_benchmark_runs(name, tmp_path):
    arguments = [word.format(tmp=tmp_path) for word in SMALL[name]]
    done = subprocess.run(
        [sys.executable, FOLDER / f"{name}.py", *arguments],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
