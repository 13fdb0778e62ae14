"""Each program in `examples/` works as described."""

import importlib.util
import json
import warnings
from pathlib import Path

import pytest

from selftouch_drake.agent.body_model.model import JointKind
from selftouch_drake.geometry.closing import SimplifiedWarning

EXAMPLES = Path(__file__).parents[1] / "examples"


def run(name, *arguments):
    """Runs an example's `main`; a simplified skin is an error."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    with warnings.catch_warnings():
        warnings.simplefilter("error", SimplifiedWarning)
        return module.main(*arguments)


def test_a_falling_head_feels_its_weight():
    time_s, sensation = run("falling_head")
    assert sensation.shape == (len(time_s), 50)
    assert not sensation[time_s < 0.19].any()
    assert sensation[-1].sum() == pytest.approx(9.81, rel=0.01)


def test_a_forearm_on_a_table_feels_it_and_its_page_plays_it(tmp_path):
    page = tmp_path / "forearm.html"
    time_s, sensation = run("forearm_on_table", page)
    force = sensation.sum(axis=1)
    assert not force[time_s < 0.5].any()
    assert 0.0 < force[150] < 0.5 * force[-1]
    assert page.stat().st_size > 1e6


def test_both_fingers_of_a_gripper_feel_how_hard_they_hold():
    felt = run("gripper")
    assert felt["left"] == pytest.approx(6.0, rel=0.01)
    assert felt["right"] == pytest.approx(6.0, rel=0.01)
    assert felt["height"] > 0.09


@pytest.mark.slow
def test_a_strangers_humanoid_feels_its_weight_from_head_to_toe():
    pytest.importorskip("gymnasium")
    felt, weight = run("humanoid")
    assert len(felt) == 13
    assert sum(felt.values()) == pytest.approx(weight, rel=0.01)


def test_an_agent_in_a_diagram_feels_what_is_wanted():
    wanted, felt = run("agent_in_a_diagram")
    assert felt == wanted


def test_plans_reach_what_a_policy_is_still_learning_to_reach():
    pytest.importorskip("stable_baselines3", reason="a large package, with torch")
    in_the_end, ever, planned = run("learn_to_reach", 5.0, 20)
    assert in_the_end <= ever < 0.5
    assert planned > 0.9


def lines_of_glue(name):
    """Lines of an example that are not blank, up to its `main`."""
    text = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8").partition("\ndef main")[0]
    return [line for line in text.splitlines() if line.strip()]


def test_mujoco_is_a_body_in_forty_lines():
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    assert len(lines_of_glue("body_in_mujoco")) <= 40
    touches, receptors = run("body_in_mujoco")
    assert touches > 50
    assert receptors >= 20


def test_pybullet_is_a_body_in_forty_lines():
    pytest.importorskip("pybullet", reason="there are wheels of pybullet up to Python 3.11 only")
    assert len(lines_of_glue("body_in_pybullet")) <= 40
    touches, receptors = run("body_in_pybullet")
    assert touches > 50
    assert receptors >= 20


def test_a_robot_stops_where_it_is_pressed_too_hard():
    assert run("own_robot") == [True, True, False]


@pytest.mark.slow
def test_an_arm_is_a_chain_of_joints_and_mixed_readings_are_none():
    plain, mixed = run("no_chain", 3000, 0.5)
    assert plain.accepted
    assert (plain.joint_kind == JointKind.TURNS).all()
    assert plain.joint_names == ("yaw", "shoulder", "elbow", "wrist")
    assert not mixed.accepted
    # Only touches that a memory does not place count: 3,000 of them leave the plain arm 0.94.
    assert mixed.held_out[0] < 0.8 < 0.9 < plain.held_out[0]


def test_every_example_is_tested():
    text = Path(__file__).read_text(encoding="utf-8")
    for path in EXAMPLES.glob("*.py"):
        assert f"run({json.dumps(path.stem)}" in text
