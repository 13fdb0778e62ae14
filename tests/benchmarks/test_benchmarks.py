"""Every benchmark runs, with as little work as it can be given."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "benchmarks"
#: Modules that are parts of other programs.
PARTS = {
    *("accuracy/agent_trials", "accuracy/made_up_bodies"),
    *("cost/ompl_planner", "cost/peers", "cost/questions"),
    *("accuracy/revolute", "accuracy/unrolling", "others/foreign_bodies"),
    *("others/nao_scores", "others/rival_maps"),
    *("shared/babbled", "shared/numbers_in_source", "shared/raw_skin", "shared/results"),
}
#: Programs that draw or break what others made; tests of their own run them, or `make` does.
MEASURE_NOTHING = {
    *("make/drawings", "make/mutants", "make/notebooks", "make/pictures", "make/taken_home"),
}
#: What they measure on is fetched by who runs them.
ON_DATA_OF_OTHERS = {"others/babybench", "others/foreign_points", "others/motoman", "others/nao"}
FEW = ("--touches=3000", "--targets=60")
#: The arguments with which a benchmark has least to do; `{tmp}` is a folder for what it writes,
#: `{run}` a run that has learned.
SMALL: dict[str, list[str]] = {
    "cost/babbling": ["--touches", "200", "--turns", "1"],
    "cost/environments": ["--steps", "5", "--copies", "1", "--environments", "SelfTouch/Sphere-v0"],
    "accuracy/imported": ["--out", "{tmp}", "--rows", "30000", "--targets", "60", "--skins", "raw"],
    "accuracy/recorded": ["--out={tmp}", "--seeds=2", "--rows=60000", "--targets=20", "--pairs=2"],
    "make/kills": ["--kills", "1"],
    "cost/memory": ["{tmp}/run", "--touches", "2000", "--targets", "50", "--times", "2"],
    "cost/online": ["sphere", "--touches=100"],
    "cost/table": ["--touching", "--turns", "1"],
    "accuracy/joints": ["--joints=6", "--touches=3000", "--targets=60", "--pairs=1", "--out={tmp}"],
    "make/recordings": ["--bodies=raw", "--seeds=1", "--out={tmp}"],
    "others/rivals": [
        "torus_1",
        "--touches=600",
        "--targets=60",
        *("--ways", "body_model", "isomap", "diffusion", "variational", "calibrated"),
    ],
    "life/exploration": [
        "touches",
        *("--bodies", "sphere"),
        *("--until", "600"),
        *("--at", "600"),
        *("--executed", "1"),
        *("--targets", "40"),
        *("--ways", "active", "goals"),
    ],
    "cost/growth": ["--touches", "50"],
    "life/mending": [
        *("--bodies", "sphere"),
        *("--kinds", "one"),
        *("--touches", "600"),
        *("--watched", "1000"),
        *("--targets", "20"),
        *("--pairs", "2"),
    ],
    "life/compared": ["--bodies=sphere", "--kinds=joint", "--touches=300", "--since=60"],
    "life/explained": ["--bodies=sphere", "--kinds=joint", "--before=300", "--since=50"],
    "life/noticed": ["--bodies=sphere", "--seeds=6", "--kinds", "joint", "--watched=500"],
    "make/growing": ["--body=sphere", "--touches", "60", "100", "--out={tmp}/growing.gif"],
    "life/walks": ["--experiment", "sphere", "--touches", "50"],
    "accuracy/servo": [
        "cube",
        "--out",
        "{tmp}",
        "--touches",
        "3000",
        "--targets",
        "60",
        "--pairs",
        "1",
    ],
    "accuracy/shape": [
        "{tmp}/sphere_1",
        "--samples=3000",
        "--targets=60",
        "--metrics=sensorimotor",
    ],
    "accuracy/teaching": ["two_arms", "--person", "--seeds=1", "--touches=60"],
    "accuracy/trust": [
        "luck",
        "--out={tmp}",
        "--touches=3000",
        "--targets=60",
        "--networks=1",
        "--cases=1",
    ],
    "cost/live": ["{run}", "--seconds", "1", "--no-browser"],
    "accuracy/sensor": ["--quick", "--looks", "2"],
    "accuracy/bending": ["--joints=6", *FEW, "--pairs=2", "--out={tmp}"],
    "accuracy/paths": ["{run}", "--pairs", "2"],
    "accuracy/readings": [
        "--shapes=sphere",
        "--widths=overlap",
        "--readings=pressure",
        *FEW,
        "--out={tmp}/t",
    ],
    "accuracy/constants": ["{tmp}/sphere_1", *FEW, "--pairs=1", "--only", "links._LEAP_POWER"],
    "accuracy/agent_constants": ["--only", "readings.turns._FEWEST"],
    "accuracy/causes": ["{tmp}/sphere_1", "--touches=20000"],
    "accuracy/layout": ["sphere", *FEW, "--seeds=1", "--out={tmp}"],
    "cost/cluster": ["{run}"],
    "others/foreign": ["--humanoid", *FEW, "--pairs=1", "--out={tmp}"],
    "accuracy/body_model": ["sphere", "--seeds=1", "--touches=3000", "--runs={tmp}"],
    "accuracy/body_model_judged": ["--kinds", "right", "--seeds=0", "--touches=3000", "--jobs=1"],
    "accuracy/assumption": ["--kinds=none", "--seeds=1", "--touches=2500", "--pairs=1"],
    "accuracy/before_practice": ["{run}", "--pairs=2", "--ways", "imagined", "no_slides"],
    "accuracy/both_sides": ["--seeds=10", "--postures=40", "--searches=0"],
    "accuracy/felt_twice": ["--seeds=1", "--sizes=0.9", "--touches=1500", "--targets=60"],
    "accuracy/few_touches": [
        "sphere",
        "--seeds=1",
        "--touches",
        "100",
        "--stored=400",
        "--runs={tmp}",
    ],
    "accuracy/skin_faults": ["{run}", "--seeds=1", "--touches=1000"],
    "accuracy/standard_errors": ["--seeds=0", "--touches=3000", "--kernels=100"],
    "accuracy/take_home": ["sphere", "--seeds=1", *FEW, "--pairs=1", "--runs={tmp}"],
    "cost/diagrams": ["--count", "1"],
    "accuracy/given_model": ["--seeds=1", "--out={tmp}/table.md"],
    "accuracy/two_fingers": ["runs", "{tmp}/sphere_two_fingers_1", "--rows=3000", "--targets=60"],
}
#: Those that take long however small they are.
LONG = {
    "accuracy/felt_twice",
    "cost/memory",
    "cost/babbling",
    "cost/cluster",
    "make/kills",
    "others/foreign",
    "life/noticed",
    "life/walks",
    "life/exploration",
}


def test_every_benchmark_has_small_arguments():
    programs = {
        path.relative_to(FOLDER).with_suffix("").as_posix()
        for path in FOLDER.rglob("*.py")
        if path.name != "__init__.py"
    }
    assert programs - PARTS - MEASURE_NOTHING - ON_DATA_OF_OTHERS == set(SMALL)


def test_every_mutant_breaks_a_line_that_is_there_once():
    from benchmarks.make import mutants

    def text(mutant):
        file = ROOT / "selftouch_drake" / mutant.file
        return file.read_text(encoding="utf-8") if file.exists() else ""

    assert [one.name for one in mutants.MUTANTS if text(one).count(one.old) != 1] == []
    first = [test for one in mutants.MUTANTS for test in one.first]
    assert [test for test in first if not (ROOT / test.partition("::")[0]).exists()] == []


@pytest.mark.parametrize("before", ["nowhere", "tests"])
def test_a_version_to_compare_with_must_be_a_checkout(before, monkeypatch):
    from benchmarks.cost import table

    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(sys, "argv", ["table.py", "--before", before])
    with pytest.raises(SystemExit) as end:
        table.main()
    assert end.value.code == (
        f"bench: BEFORE is '{before}', and no checkout: it has no selftouch_drake; make one with "
        "`git worktree add build/before COMMIT`, or leave BEFORE out"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.long) if n in LONG else n for n in SMALL]
)
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
