"""What an agent found, taken home, is a robot of its own: learned on again, and planned on."""

import csv
import json

import numpy as np
import pytest
from commands import selftouch

from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World
from selftouch_drake.robot.skins import MovedReceptorsWarning
from selftouch_drake.run import RunDirectory, load_motion
from selftouch_drake.run.artifacts import stored_pairs

FIELDS = (
    "{babbling: {num_samples: 10000}, representation: {num_targets: 200, metric: sensorimotor}, "
    "evaluation: {num_pairs: 12, shape_metrics: []}}"
)


def ran(*words):
    done = selftouch(*words)
    assert done.status == 0, done.stderr
    return done


def joints_of(world):
    return [name.rpartition("::")[2] for name in world.robot.joint_names]


@pytest.mark.slow
@pytest.mark.filterwarnings(f"ignore::{MovedReceptorsWarning.__module__}.MovedReceptorsWarning")
def test_the_export_is_found_again_and_its_plans_hold_on_the_original(tmp_path):
    first, second, file = (tmp_path / name for name in ("first", "second", "again.urdf"))
    known = ("--length", "shoulder_pitch", "elbow_pitch", 0.4, "--depth", 0.014)
    for run, experiment in ((first, "cube"), (second, tmp_path / "again_experiment.yaml")):
        ran("babble", experiment, "--out", run, "--set", FIELDS, "--workers", 1)
        ran("learn", run)
        ran("evaluate", run, "--workers", 1)
        if run == first:
            ran("model", run, "--urdf", file, *known)
    before, after = (json.loads((run / "metrics.json").read_text()) for run in (first, second))
    for error in ("body_model_place_error_percent", "surface_rms_fraction"):
        assert after[error] < 1.2 * before[error]
    again, original = RunDirectory.open(second), World(load_experiment("cube"))
    with (tmp_path / "again_joints.csv").open() as opened:
        scales = {row["joint"]: row for row in csv.DictReader(opened)}
    names = joints_of(World(again.experiment))
    held = []
    for pair in stored_pairs(again):
        q = load_motion(again, *pair).q
        readings = [
            (q[:, names.index(name)] - float(scales[name]["offset"])) / float(scales[name]["scale"])
            for name in joints_of(original)
        ]
        held.append(original.probe.sensations(np.stack(readings, axis=1)).any(axis=1).mean())
    assert len(held) == 12
    assert np.mean(held) > 0.99
