"""Every benchmark runs, with as little work as it can be given."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "benchmarks"
#: Modules that benchmarks share.
SHARED = {
    *("babbled", "foreign_bodies", "ompl_planner", "peers", "raw_skin"),
    *("results", "revolute", "unrolling"),
}
#: Programs that draw or break what others made; tests of their own run them, or `make` does.
MEASURE_NOTHING = {"drawings", "mutants", "notebooks", "pictures"}
#: What they measure on is fetched by who runs them.
ON_DATA_OF_OTHERS = {"babybench", "nao"}
FEW = ("--touches=3000", "--targets=60")
#: The arguments with which a benchmark has least to do; `{tmp}` is a folder for what it writes,
#: `{run}` a run that has learned.
SMALL: dict[str, list[str]] = {
    "babbling": ["--touches", "200", "--turns", "1"],
    "environments": ["--steps", "5", "--copies", "1", "--environments", "SelfTouch/Sphere-v0"],
    "imported": ["--out", "{tmp}", "--rows", "30000", "--targets", "60", "--skins", "raw"],
    "recorded": ["--out={tmp}", "--seeds=2", "--rows=60000", "--targets=20", "--pairs=2"],
    "kills": ["--kills", "1"],
    "memory": ["{tmp}/run", "--touches", "5000", "--targets", "50", "--times", "2"],
    "table": ["--touching", "--turns", "1"],
    "joints": ["--joints=6", "--touches=3000", "--targets=60", "--pairs=1", "--out={tmp}"],
    "recordings": ["--bodies=raw", "--seeds=1", "--out={tmp}"],
    "rivals": ["torus_1", "--touches=3000", "--targets=60", "--ways", "sensorimotor", "isomap"],
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
    "shape": ["{tmp}/sphere_1", "--samples=3000", "--targets=60", "--metrics=sensorimotor"],
    "trust": ["luck", "--out={tmp}", "--touches=3000", "--targets=60", "--networks=1", "--cases=1"],
    "live": ["{run}", "--seconds", "1", "--no-browser"],
    "sensor": ["--quick", "--looks", "2"],
    "bending": ["--joints=6", *FEW, "--pairs=2", "--out={tmp}"],
    "paths": ["{run}", "--pairs", "2"],
    "readings": [
        "--shapes=sphere",
        "--widths=overlap",
        "--readings=pressure",
        *FEW,
        "--out={tmp}/t",
    ],
    "causes": ["{tmp}/sphere_1", "--touches=20000"],
    "layout": ["sphere", *FEW, "--seeds=1", "--out={tmp}"],
    "cluster": ["{run}"],
    "foreign": ["--humanoid", *FEW, "--pairs=1", "--out={tmp}"],
    "calibration": ["--seeds=1", "--out={tmp}/table.md"],
    "two_fingers": ["runs", "{tmp}/sphere_two_fingers_1", "--rows=3000", "--targets=60"],
}


def test_every_benchmark_has_small_arguments():
    others = SHARED | MEASURE_NOTHING | ON_DATA_OF_OTHERS
    assert {path.stem for path in FOLDER.glob("*.py")} - others == set(SMALL)


def test_every_mutant_breaks_a_line_that_is_there_once(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    import mutants

    def text(mutant):
        file = ROOT / "selftouch_drake" / mutant.file
        return file.read_text(encoding="utf-8") if file.exists() else ""

    assert [one.name for one in mutants.MUTANTS if text(one).count(one.old) != 1] == []
    first = [test for one in mutants.MUTANTS for test in one.first]
    assert [test for test in first if not (ROOT / test.partition("::")[0]).exists()] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", SMALL)
def test_a_benchmark_runs(name, small_run, tmp_path):
    written = tmp_path / "written"
    written.mkdir()
    arguments = [word.format(tmp=written, run=small_run.path) for word in SMALL[name]]
    done = subprocess.run(
        [sys.executable, FOLDER / f"{name}.py", *arguments],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
