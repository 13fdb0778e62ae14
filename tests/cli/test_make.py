"""Commands that make a run, as a user sees them."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from commands import SMALL, files_below, refused, selftouch

from selftouch_drake.experiment import load_experiment
from selftouch_drake.resources import EXPERIMENTS, shipped
from selftouch_drake.run.metrics import METRICS

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
    # Models of large trees take minutes, and have tests of their own.
    quick = quick.replace(
        "num_targets: 60", "num_targets: 60, metric: sensorimotor, body_model: off"
    )
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


@pytest.mark.slow
@pytest.mark.usefixtures("skins_are_made_anew")
def test_same_seed_same_bytes_whatever_the_number_of_workers_and_without_the_truth(
    finished_run, tmp_path
):
    again = tmp_path / "again"
    without_model = SMALL.replace("num_targets: 60", "num_targets: 60, body_model: off")
    done = selftouch("babble", "cube", "--out", again, "--set", without_model, "--workers", 2)
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
    command = [sys.executable, "-m", "selftouch_drake", "run", "cube", "--out", str(run)]
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
