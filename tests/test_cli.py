"""The command line as a user sees it."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from commands import SMALL, refused, selftouch

from selftouch_drake.agent.motions import NO_KERNEL
from selftouch_drake.agent.representation.graphs import connected_edges
from selftouch_drake.cli import _route, exit_status
from selftouch_drake.experiment import load_experiment
from selftouch_drake.experiment.loading import parse_fields
from selftouch_drake.resources import EXPERIMENTS, MODELS, SWEEPS, shipped
from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.executors import InTurn
from selftouch_drake.run.metrics import METRICS


def files_below(folder):
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()
    }


# `icub` and `icub_skin` need a package of their own, and hours; they have tests of their own. Of
# some, another has the same robot, and only the surface differs.
ELSEWHERE = (
    "cube",
    "icub",
    "icub_skin",
    "cylinder",
    "double_torus",
    "ellipsoid",
    "sphere_two_fingers",
    "torus",
)
SMOKED = [name for name in shipped(EXPERIMENTS) if name not in ELSEWHERE]


@pytest.mark.slow
@pytest.mark.parametrize("name", SMOKED)
def test_shipped_experiment_runs_to_its_report(name, tmp_path):
    quick = SMALL.replace("num_pairs: 1", "num_pairs: 1, shape_metrics: []")
    quick = quick.replace("num_targets: 60", "num_targets: 60, metric: sensorimotor")
    done = selftouch("run", name, "--out", tmp_path / "run", "--set", quick)
    assert done.status == 0, done.stderr
    assert f"report: {tmp_path / 'run' / 'report.html'}" in done.stdout
    assert_is_complete(tmp_path / "run", metrics_compared={"sensorimotor"})


def test_run_leaves_all_that_the_design_names(finished_run):
    assert_is_complete(
        finished_run, metrics_compared={"literal", "motor", "learned", "sensorimotor"}
    )


def assert_is_complete(run, *, metrics_compared):
    metrics = json.loads((run / "metrics.json").read_text())
    experiment = load_experiment(run / "experiment.yaml")
    known = {metric.key for metric in METRICS}
    assert set(metrics) - {"made_for"} <= known
    assert metrics["babbling_num_samples"] == 2000
    assert list(metrics["babbling_touches_by_skin"]) == list(experiment.skins)
    assert metrics["representation_num_targets"] == 60
    assert metrics["parts_found"] >= 1
    if len(experiment.skins) > 1 or metrics["parts_found"] > 1:
        assert len(metrics["topology_betti_by_part"]) == metrics["parts_found"]
    else:
        assert len(metrics["topology_betti"]) == 3
    if "parts_true" in metrics:
        assert set(metrics["shape_rms_fraction_by_metric"]) == metrics_compared
    else:
        # Two fingers of one hand: a kernel is no place on the skin.
        assert len(experiment.touching) == 2
        assert not any(key.startswith("shape_") for key in metrics)
    assert metrics["planning_num_pairs"] == metrics["execution_num_pairs"] == 1
    assert metrics["planning_impossible_postures"] >= 0
    assert metrics["execution_impossible_postures"] >= 0
    assert 0 <= metrics["execution_contact_mean"] <= 1
    for name in (
        "experiment.yaml",
        "models.json",
        "skin.npz",
        "representation.npz",
        "report.html",
        "babbling.html",
        "playback.html",
    ):
        assert (run / name).stat().st_size > 0, name
    assert list((run / "figures").glob("*.png"))
    (plan,) = (run / "plans").glob("*.npz")
    with np.load(plan) as arrays:
        num_times, num_joints = arrays["q"].shape
        assert arrays["time_s"].shape == (num_times,)
        assert arrays["q_measured"].shape == arrays["v"].shape == (num_times, num_joints)
        shape = (num_times, experiment.num_receptors)
        assert arrays["felt"].shape == arrays["predicted"].shape == shape
    with np.load(run / "skin.npz") as arrays:
        sizes = [len(arrays[f"{name}_p_LS"]) for name in experiment.skins]
        assert sizes == [skin.num_receptors for skin in experiment.skins.values()]
        assert np.bincount(arrays["receptor_skin"]).tolist() == sizes
        for name in experiment.skins:
            assert arrays[f"{name}_faces"].max() < len(arrays[f"{name}_vertices"])
    with np.load(run / "representation.npz") as arrays:
        assert arrays["kernel_q"].shape[1] == len(arrays["joint_scale"]) == num_joints
        assert arrays["part"].shape == (60,)
    leftovers = [name for name in files_below(run) if name.endswith(".part")]
    assert leftovers == []


def test_same_seed_same_bytes_whatever_the_number_of_workers_and_without_the_truth(
    finished_run, tmp_path
):
    again = tmp_path / "again"
    done = selftouch("babble", "cube", "--out", again, "--set", SMALL, "--workers", 2)
    assert done.status == 0, done.stderr
    for folder in ("experience", "truth"):
        assert files_below(again / folder) == files_below(finished_run / folder)
    assert (again / "skin.npz").read_bytes() == (finished_run / "skin.npz").read_bytes()
    shutil.rmtree(again / "truth")
    (again / "skin.npz").unlink()
    assert selftouch("learn", again).status == 0
    for name in ("representation.npz", "topology.npz"):
        assert (again / name).read_bytes() == (finished_run / name).read_bytes(), name
    assert refused("evaluate", again) == (
        f"{again / 'truth' / 'part-00000.parquet'} is missing; collect it again with "
        f"`selftouch babble {again / 'experiment.yaml'} --out {again}`"
    )


def test_stages_one_by_one(finished_run, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(finished_run, run)
    planned = selftouch("plan", run, "--from", 0, "--to", 59)
    assert planned.status == 0, planned.stderr
    assert planned.stdout.startswith("route: 0 ")
    executed = selftouch("execute", run, "--from", 0, "--to", 59)
    assert executed.status == 0, executed.stderr
    assert "in contact: " in executed.stdout


def test_finished_run_is_not_done_again(small_run, monkeypatch):
    monkeypatch.setattr("selftouch_drake.show.outputs.write_report", lambda run, *_, **__: "drawn")
    before = files_below(small_run.path)
    done = selftouch("run", "cube", "--out", small_run.path, "--set", SMALL)
    assert done.status == 0, done.stderr
    assert "report: drawn" in done.stdout
    assert files_below(small_run.path) == before


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT to a process group")
def test_ctrl_c_leaves_a_run_to_resume(tmp_path, finished_run):
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
        "selftouch: stopped; give the same command again to resume"
    )
    assert [name for name in files_below(run) if name.endswith(".part")] == []
    assert selftouch("run", "cube", "--out", run, "--set", SMALL).status == 0
    assert files_below(run / "experience") == files_below(finished_run / "experience")
    same = (run / "representation.npz").read_bytes() == (
        finished_run / "representation.npz"
    ).read_bytes()
    assert same


def test_wrong_yaml_is_refused(tmp_path):
    message = "--set is not YAML: expected ',' or ']', but got '<stream end>'"
    assert refused("run", "cube", "--out", tmp_path / "run", "--set", "[1") == message
    assert not (tmp_path / "run").exists()


def test_unknown_experiment_is_refused(tmp_path):
    message = "experiment 'cubes' is neither shipped nor a file; did you mean cube?"
    with contextlib.chdir(tmp_path):
        assert refused("run", "cubes") == message
    assert list(tmp_path.iterdir()) == []


def test_folder_that_is_not_a_run_is_refused(tmp_path):
    for verb in ("learn", "evaluate", "report"):
        assert refused(verb, tmp_path) == (
            f"{tmp_path} is not a run: it has no experiment.yaml; make one with `selftouch run`"
        )


def test_half_finished_run_is_refused(tmp_path, finished_run):
    run = tmp_path / "run"
    run.mkdir()
    shutil.copy(finished_run / "experiment.yaml", run)
    assert refused("learn", run).startswith(
        f"{run} is half-finished: babbling has not come to its end"
    )
    assert refused("plan", run, "--from", 0, "--to", 1) == (
        f"{run} has learned nothing yet; run `selftouch learn {run}`"
    )


def test_run_of_another_version_is_refused(tmp_path, finished_run):
    run = tmp_path / "run"
    run.mkdir()
    # What is below the first line is not read: the first version had other fields.
    (run / "experiment.yaml").write_text("# A run of selftouch_drake, format 1\nbody: {}\n")
    assert refused("learn", run) == (
        f"{run} was made by another version (format 1, this is 2); "
        "run the experiment again with another --out"
    )


def test_other_experiment_in_the_same_folder_is_refused(finished_run):
    before = files_below(finished_run)
    assert refused("run", "torus", "--out", finished_run, "--set", SMALL) == (
        f"{finished_run} was begun with name 'cube', not 'torus'; choose another --out"
    )
    assert files_below(finished_run) == before


def test_target_out_of_range_is_refused(finished_run):
    before = files_below(finished_run)
    for verb in ("plan", "execute"):
        line = refused(verb, finished_run, "--from", 0, "--to", 60)
        assert line == "--to is 60; this run has target sensations 0 to 59"
    assert files_below(finished_run) == before


def test_help_teaches():
    text = selftouch("--help").stdout
    for verb in (
        "run",
        "babble",
        "learn",
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


def test_a_robot_in_words():
    done = selftouch("robot", "two_arms", "--set", "{skins: {left_forearm: {num_receptors: 41}}}")
    assert done.status == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == "12 joints move"
    assert "  left_arm::elbow_pitch      turns  -2.6 to 2.6 rad    60 N·m" in lines
    assert any("left_forearm" in line and "41 receptors" in line for line in lines)
    assert "What touches what" in lines


def test_a_shipped_experiment_is_shown():
    text = (EXPERIMENTS / "gantry.yaml").read_text(encoding="utf-8")
    assert selftouch("experiments", "--show", "gantry").stdout == text
    assert refused("experiments", "--show", "gantri") == (
        "--show is 'gantri'; this experiment is not shipped: did you mean gantry?"
    )


def test_a_list_of_experiments_needs_no_drake():
    code = (
        "import sys; from selftouch_drake.cli import cli; "
        "cli.main(['experiments'], standalone_mode=False); "
        "print(sorted({name.split('.')[0] for name in sys.modules} & set(sys.argv[1:])))"
    )
    heavy = ("pydrake", "sklearn", "scipy", "matplotlib", "trimesh", "numba", "pyarrow")
    done = subprocess.run([sys.executable, "-c", code, *heavy], capture_output=True, text=True)
    *lines, loaded = done.stdout.splitlines()
    listed = [line.split(maxsplit=1) for line in lines if line.startswith("  ")]
    assert [name for name, _ in listed] == [*shipped(EXPERIMENTS), *shipped(SWEEPS)]
    assert all(meaning.endswith((".", "?")) for _, meaning in listed)
    assert loaded == "[]"


def test_a_plan_through_the_air_is_shown():
    def route(nodes, in_air):
        plan = SimpleNamespace(nodes=np.array(nodes), in_air=np.array(in_air, dtype=bool))
        return _route(SimpleNamespace(plan=plan))

    assert route([3, 17, 120, 131], [False, True, False]) == "3 17 | lifts off | 120 131"
    off = "off 120 7\n       off: nothing is felt there"
    assert route([NO_KERNEL, 120, 7], [True, False]) == off
    again = "10 228 10* 240\n       *: felt again, in another posture"
    assert route([10, 228, 10, 240], [False, False, False]) == again
    assert route([5], []) == "5"


def test_an_edited_model_is_named_by_what_comes_after(tmp_path, finished_run):
    """A run with the user's own models, as after `selftouch run mine.yaml`."""
    models, run = tmp_path / "models", tmp_path / "run"
    shutil.copytree(MODELS, models)
    shutil.copytree(finished_run, run)
    for name in ("experiment.yaml", "models.json"):
        text = (run / name).read_text().replace(str(MODELS.resolve()), str(models))
        (run / name).write_text(text)
    arm = models / "arm.sdf"
    arm.write_text(arm.read_text().replace("0.40", "0.41", 1))
    for verb in (["execute", "--from", 0, "--to", 1], ["learn"], ["report"]):
        assert refused(verb[0], run, *verb[1:]) == (
            f"{arm} has changed since {run} was begun; restore it, or run the experiment again "
            "with another --out"
        )


def test_what_was_never_touched_is_named_in_one_line(capfd, tmp_path):
    # A skin of a few square centimetres at the shoulder, where the fingertip hardly ever comes.
    surface = {"shape": "sphere", "radius": 0.02, "resolution": 0.01}
    spot = {"link": "shoulder", "surface": surface, "thickness": 0.008, "num_receptors": 4}
    overrides = parse_fields(SMALL) | {"skins": {"spot": spot}}
    experiment = load_experiment("cube", overrides)
    directory = RunDirectory.create(tmp_path / "run", experiment)
    status = exit_status(lambda: stages.babble(directory, InTurn(), stages.silent))
    assert status == 0
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert line == (
        "selftouch: warning: skins.spot was never touched in 2,000 touches; see what can touch "
        f"what with `selftouch robot {directory.path / 'experiment.yaml'} --show`"
    )


def test_a_graph_in_parts_is_named_in_one_line(capfd):
    def learn_two_parts():
        connected_edges(np.array([[0, 1]]), np.array([[0, 1, 5], [1, 0, 4], [5, 4, 0.0]]))
        warnings.warn("of another package", UserWarning, stacklevel=1)

    with pytest.warns(UserWarning, match="of another package"):
        assert exit_status(learn_two_parts) == 0
    assert capfd.readouterr().err == (
        "selftouch: warning: the quotient graph fell into 2 components, of 2, 1 kernels, joined by "
        "bridges 1-2: babble longer, or give fewer targets\n"
    )
