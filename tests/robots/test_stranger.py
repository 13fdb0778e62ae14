import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import selftouch

from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World

DATA = Path(__file__).parent / "data"


@pytest.fixture(scope="module")
def robot():
    gymnasium = pytest.importorskip("gymnasium")
    return {"packages": {"gymnasium": str(Path(gymnasium.__file__).parent)}}


@pytest.fixture(scope="module")
def humanoid(robot):
    return World(load_experiment(DATA / "humanoid.yaml", {"robot": robot}))


def test_mujoco_file_loads_as_it_is(humanoid):
    robot = humanoid.robot
    assert robot.num_joints == robot.plant.num_positions() == robot.plant.num_actuators() == 17
    assert np.isfinite(robot.lower).all()
    assert np.isfinite(robot.upper).all()
    # Controls of at most 0.4, times gears of 25, 100, 200 and 300.
    assert {*humanoid.limits.torque.tolist()} == {10.0, 40.0, 80.0, 120.0}


def test_stranger_feels_its_hands(humanoid):
    robot = humanoid.robot
    postures = np.random.default_rng(0).uniform(*robot.babbled_range, (4000, robot.num_joints))
    touches = humanoid.probe.touches(postures)
    possible = ~humanoid.probe.impossible(postures[touches.row])
    assert possible.sum() > 20
    felt = touches.sensation[touches.row[possible]]
    assert (felt.sum(axis=1) > 0).all()


def test_links_of_one_body_s_joints_and_the_floor_are_no_obstacles(humanoid):
    pairs = {tuple(link.name() for link in pair.links) for pair in humanoid.robot.rigid_pairs}
    assert ("torso", "left_lower_arm") in pairs
    # Three joints lie between pelvis and thigh, with massless links between them.
    assert ("pelvis", "left_thigh") not in pairs
    assert not any("world" in pair for pair in pairs)


@pytest.mark.slow
def test_its_run_ends_with_a_report(robot, tmp_path):
    settings = {
        "robot": robot,
        "babbling": {"num_samples": 2000, "walk_size": 1000},
        "representation": {"num_targets": 60, "body_model": "off"},
        "execution": {"max_tries": 2},
        "evaluation": {"num_pairs": 2},
    }
    words = ("--out", tmp_path / "run", "--set", yaml.safe_dump(settings))
    done = selftouch("run", DATA / "humanoid.yaml", *words)
    assert done.status == 0, done.stderr
    assert done.stdout.splitlines()[-1] == f"report: {tmp_path / 'run' / 'report.html'}"
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    tried = metrics.get("execution_num_pairs", 0) + metrics["planning_num_without_way"]
    assert tried == 2


@pytest.mark.slow
@pytest.mark.long
def test_fists_with_skin_are_parts_beside_what_they_press(tmp_path):
    settings = yaml.safe_dump(
        {
            "seed": 31,
            "babbling": {"num_samples": 4000},
            "representation": {
                "num_targets": 200,
                "metric": "sensorimotor",
                "body_model": "off",
            },
        }
    )
    run = tmp_path / "run"
    selftouch("babble", DATA / "infant_hands.yaml", "--out", run, "--set", settings)
    selftouch("learn", run)
    figures = json.loads((run / "metrics.json").read_text())
    assert figures["parts_found"] == 8
