"""The command line as a user meets it: in a process of its own."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from selftouch_drake.agent.representation import connected_edges
from selftouch_drake.cli import exit_status
from selftouch_drake.experiment import shipped_experiments

SMALL = (
    "{babbling: {num_samples: 2000, walk_size: 1000}, representation: {num_targets: 60}, "
    "evaluation: {num_pairs: 1}}"
)


def selftouch(*arguments, cwd=None):
    return subprocess.run(
        [sys.executable, "-m", "selftouch_drake.cli", *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd,
        timeout=300,
    )


def files_below(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture(scope="session")
def cube_run(tmp_path_factory):
    run = tmp_path_factory.mktemp("runs") / "cube"
    done = selftouch("run", "cube", "--out", run, "--set", SMALL)
    assert done.returncode == 0, done.stderr
    return run


@pytest.mark.parametrize("name", [name for name in shipped_experiments() if name != "cube"])
def test_shipped_experiment_runs_to_its_report(name, tmp_path):
    quick = SMALL.replace("num_pairs: 1", "num_pairs: 1, shape_metrics: []")
    quick = quick.replace("num_targets: 60", "num_targets: 60, metric: sensorimotor")
    done = selftouch("run", name, "--out", tmp_path / "run", "--set", quick)
    assert done.returncode == 0, done.stderr
    assert f"report: {tmp_path / 'run' / 'report.html'}" in done.stdout
    assert_is_complete(tmp_path / "run", metrics_compared={"sensorimotor"})


def test_run_leaves_all_that_the_design_names(cube_run):
    assert_is_complete(cube_run, metrics_compared={"literal", "motor", "learned", "sensorimotor"})


def assert_is_complete(run, *, metrics_compared):
    metrics = json.loads((run / "metrics.json").read_text())
    assert metrics["babbling_num_samples"] == 2000
    assert metrics["representation_num_targets"] == 60
    assert len(metrics["topology_betti"]) == 3
    assert set(metrics["shape_rms_fraction_by_metric"]) == metrics_compared
    assert metrics["planning_num_pairs"] == metrics["execution_num_pairs"] == 1
    assert 0 < metrics["execution_contact_mean"] <= 1
    for name in (
        "experiment.yaml",
        "skin.npz",
        "representation.npz",
        "report.html",
        "playback.html",
    ):
        assert (run / name).stat().st_size > 0, name
    assert list((run / "figures").glob("*.png"))
    (plan,) = (run / "plans").glob("*.npz")
    with np.load(plan) as arrays:
        num_times, num_receptors = len(arrays["time_s"]), arrays["predicted"].shape[1]
        assert arrays["q"].shape == arrays["v"].shape == (num_times, 6)
        assert arrays["q_measured"].shape == (num_times, 6)
        assert arrays["felt"].shape == arrays["predicted"].shape == (num_times, num_receptors)
    leftovers = [name for name in files_below(run) if name.endswith(".part")]
    assert leftovers == []


def test_same_seed_same_bytes(cube_run, tmp_path):
    again = tmp_path / "again"
    assert (
        selftouch("babble", "cube", "--out", again, "--set", SMALL, "--workers", 1).returncode == 0
    )
    assert selftouch("learn", again).returncode == 0
    for folder in ("experience", "truth"):
        assert files_below(again / folder) == files_below(cube_run / folder)
    for name in ("representation.npz", "topology.npz", "skin.npz"):
        assert (again / name).read_bytes() == (cube_run / name).read_bytes(), name


def test_truth_is_not_read_by_learn(cube_run, tmp_path):
    blind = tmp_path / "blind"
    shutil.copytree(cube_run, blind)
    shutil.rmtree(blind / "truth")
    (blind / "skin.npz").unlink()
    assert selftouch("learn", blind).returncode == 0
    known = (cube_run / "representation.npz").read_bytes()
    assert (blind / "representation.npz").read_bytes() == known
    assert refused("evaluate", blind) == (
        f"{blind / 'truth' / 'part-00000.parquet'} is missing; collect it again with "
        f"`selftouch babble {blind / 'experiment.yaml'} --out {blind}`"
    )


def test_stages_one_by_one(cube_run, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(cube_run, run)
    planned = selftouch("plan", run, "--from", 0, "--to", 59)
    assert planned.returncode == 0, planned.stderr
    assert planned.stdout.startswith("route: 0 ")
    executed = selftouch("execute", run, "--from", 0, "--to", 59)
    assert executed.returncode == 0, executed.stderr
    assert "in contact: " in executed.stdout
    assert selftouch("report", run).returncode == 0


def test_finished_run_is_not_done_again(cube_run):
    before = (cube_run / "representation.npz").stat().st_mtime_ns
    done = selftouch("run", "cube", "--out", cube_run, "--set", SMALL)
    assert done.returncode == 0, done.stderr
    assert (cube_run / "representation.npz").stat().st_mtime_ns == before


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT to a process group")
def test_ctrl_c_leaves_a_run_to_resume(tmp_path, cube_run):
    run = tmp_path / "run"
    command = [sys.executable, "-m", "selftouch_drake.cli", "run", "cube", "--out", str(run)]
    command += ["--set", SMALL, "--workers", "1"]
    process = subprocess.Popen(
        command, start_new_session=True, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 120
    while not (run / "experience" / "part-00000.parquet").exists():
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    _, stderr = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "Traceback" not in stderr
    assert stderr.strip().splitlines()[-1] == (
        "selftouch: stopped; the same command goes on from here"
    )
    assert [name for name in files_below(run) if name.endswith(".part")] == []
    assert selftouch("run", "cube", "--out", run, "--set", SMALL).returncode == 0
    assert files_below(run / "experience") == files_below(cube_run / "experience")
    same = (run / "representation.npz").read_bytes() == (
        cube_run / "representation.npz"
    ).read_bytes()
    assert same


def refused(*arguments, cwd=None):
    """Runs a command that must be refused and returns the one line that says why."""
    done = selftouch(*arguments, cwd=cwd)
    assert done.returncode == 2, (done.returncode, done.stdout, done.stderr)
    assert "Traceback" not in done.stderr
    (line,) = done.stderr.strip().splitlines()
    assert done.stdout == ""
    return line.removeprefix("selftouch: ")


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ("{bodi: 1}", "unknown key bodi; did you mean body?"),
        (
            "{body: {shape: cub}}",
            "body.shape is 'cub'; choose one of sphere, cube, torus, ellipsoid, cylinder, mesh",
        ),
        ("{skin: {num_receptors: 19}}", "skin.num_receptors is 19; give 20 to 200"),
        ("{skin: {num_receptors: 201}}", "skin.num_receptors is 201; give 20 to 200"),
        ("[1", "--set is not YAML: expected ',' or ']', but got '<stream end>'"),
    ],
)
def test_wrong_experiment_is_refused(overrides, message, tmp_path):
    assert refused("run", "cube", "--out", tmp_path / "run", "--set", overrides) == message
    assert not (tmp_path / "run").exists()


def test_unknown_experiment_is_refused(tmp_path):
    message = "experiment 'cubes' is neither shipped nor a file; did you mean cube?"
    assert refused("run", "cubes", cwd=tmp_path) == message
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("overrides", "beginning"),
    [
        ("{skin: {thickness: 0.3}}", "skin.thickness is 0.3 m, thicker than the body allows"),
        ("{skin: {thickness: 0.213}}", "skin.thickness is 0.213 m, which leaves opposite walls"),
        ("{body: {side: 4.0, resolution: 0.1}}", "body.side is 4.0; "),
    ],
)
def test_impossible_body_is_refused(overrides, beginning, tmp_path):
    line = refused("babble", "cube", "--out", tmp_path / "run", "--set", overrides)
    assert line.startswith(beginning), line
    assert not (tmp_path / "run").exists()


def test_open_mesh_is_refused(tmp_path):
    (tmp_path / "open.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "open.yaml").write_text("name: open\nbody: {shape: mesh, mesh: open.obj}\n")
    line = refused("babble", tmp_path / "open.yaml", "--out", tmp_path / "run")
    assert line == (
        f"body.mesh {tmp_path / 'open.obj'} is open; close its holes so that it is watertight"
    )
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("verb", ["learn", "evaluate", "report"])
def test_folder_that_is_not_a_run_is_refused(verb, tmp_path):
    assert refused(verb, tmp_path) == (
        f"{tmp_path} is not a run: it has no experiment.yaml; make one with `selftouch run`"
    )


def test_half_finished_run_is_refused(tmp_path, cube_run):
    run = tmp_path / "run"
    run.mkdir()
    shutil.copy(cube_run / "experiment.yaml", run)
    assert refused("learn", run).startswith(
        f"{run} is half-finished: babbling has not come to its end"
    )
    assert refused("plan", run, "--from", 0, "--to", 1) == (
        f"{run} has learned nothing yet; run `selftouch learn {run}`"
    )


def test_run_of_another_version_is_refused(tmp_path, cube_run):
    run = tmp_path / "run"
    run.mkdir()
    text = (cube_run / "experiment.yaml").read_text().replace("format 1", "format 99", 1)
    (run / "experiment.yaml").write_text(text)
    assert refused("learn", run) == (
        f"{run} was made by another version (format 99, this is 1); "
        "run the experiment again with another --out"
    )


def test_other_experiment_in_the_same_folder_is_refused(cube_run):
    before = files_below(cube_run)
    assert refused("run", "torus", "--out", cube_run, "--set", SMALL) == (
        f"{cube_run} was begun with name 'cube', not 'torus'; choose another --out"
    )
    assert files_below(cube_run) == before


def test_target_out_of_range_is_refused(cube_run):
    before = files_below(cube_run)
    for verb in ("plan", "execute"):
        line = refused(verb, cube_run, "--from", 0, "--to", 60)
        assert line == "--to is 60; this run has target sensations 0 to 59"
    assert files_below(cube_run) == before


def test_help_teaches():
    text = selftouch("--help").stdout
    for verb in ("run", "babble", "learn", "plan", "execute", "evaluate", "report", "play"):
        assert f"\n  {verb} " in text
    assert "selftouch plan runs/cube --from 3 --to 250" in text
    assert "..." not in text.partition("Commands:")[2]  # no line of it is cut
    assert selftouch().stdout == text


def test_a_graph_in_parts_is_told_in_one_line(capfd):
    def learn_two_parts():
        connected_edges(np.array([[0, 1]]), np.array([[0, 1, 5], [1, 0, 4], [5, 4, 0.0]]))
        warnings.warn("of another package", UserWarning, stacklevel=1)

    with pytest.warns(UserWarning, match="of another package"):
        assert exit_status(learn_two_parts) == 0
    assert capfd.readouterr().err == (
        "selftouch: warning: the quotient graph fell into 2 parts (2 with kernel 0, 1 with "
        "kernel 2) and was joined by a bridge (1-2): babble longer, or use more neighbours.\n"
    )
