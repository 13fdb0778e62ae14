import dataclasses

import numpy as np
import pytest
from scipy.interpolate import BSpline

from selftouch_drake.agent.motions import NO_KERNEL, Execution, Motion, Plan

T, W, J, S = 9, 4, 2, 5


@pytest.fixture
def plan():
    knots = np.array([0, 0, 1, 2, 3, 3], dtype=float)
    waypoints_q = np.array([[0, 0], [1, 0], [1, 1], [1, 2]], dtype=float)
    return Plan(
        nodes=np.array([NO_KERNEL, 3, 5, 2]),
        links=np.array([-1, 7, -1]),
        in_air=np.array([True, False, True]),
        modes=np.full(len(np.array([NO_KERNEL, 3, 5, 2])) - 1, -1),
        imagined=np.zeros(len(np.array([NO_KERNEL, 3, 5, 2])), bool),
        waypoints_q=waypoints_q,
        waypoint_s=np.arange(4.0),
        path=BSpline(knots, waypoints_q, 1),
    )


@pytest.fixture
def motion(plan):
    return Motion(
        plan=plan,
        time_s=np.linspace(0.0, 1.0, T),
        s=np.linspace(0.0, 3.0, T),
        q=np.zeros((T, J)),
        v=np.zeros((T, J)),
        predicted=np.zeros((T, S)),
        predicted_spread=np.zeros(T),
    )


@pytest.fixture
def execution(motion):
    felt = np.zeros((T, S))
    felt[4] = 1.0
    return Execution(
        motion=motion, felt=felt, q_measured=motion.q, v_measured=motion.v, torque=np.ones((30, J))
    )


def same(one, other):
    here, there = one.to_arrays(), other.to_arrays()
    return here.keys() == there.keys() and all(np.array_equal(here[n], there[n]) for n in here)


def test_arrays_and_back_are_the_same(plan, motion, execution):
    more = {"stamp": np.array("x")}
    again = Plan.from_arrays(plan.to_arrays() | more)
    assert same(again, plan)
    assert np.array_equal(again.path(1.7), plan.path(1.7))
    assert same(Motion.from_arrays(motion.to_arrays() | more), motion)
    assert same(Execution.from_arrays(execution.to_arrays() | more), execution)
    # An execution also holds the arrays of its motion.
    assert same(Motion.from_arrays(execution.to_arrays()), motion)


def test_the_names_are_those_of_the_files(execution):
    assert set(execution.to_arrays()) == {
        *("nodes", "links", "in_air", "modes", "imagined", "waypoints_q", "waypoint_s", "doubts"),
        *("path_knots", "path_control"),
        *("time_s", "s", "q", "v", "predicted", "predicted_spread"),
        *("felt", "q_measured", "v_measured", "torque"),
    }


def test_touch_is_expected_where_the_agent_is_not_in_the_air(motion, execution):
    # At s = 0, 0.375, 0.75, 1.125, 1.5, 1.875, 2.25, 2.625, 3: on the last step it lands at s = 3.
    assert motion.touching.tolist() == [False] * 3 + [True] * 3 + [False] * 2 + [True]
    assert motion.step.tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    assert execution.contact == 1 / 4
    assert motion.plan.goal == execution.motion.plan.goal == 2


def test_a_plan_that_stays_is_in_contact(plan):
    stays = Plan(
        nodes=np.array([3]),
        links=np.empty(0, int),
        in_air=np.empty(0, bool),
        modes=np.full(len(np.array([3])) - 1, -1),
        imagined=np.zeros(len(np.array([3])), bool),
        waypoints_q=np.zeros((1, J)),
        waypoint_s=np.zeros(1),
        path=plan.path,
    )
    assert stays.touching(np.zeros(2)).tolist() == [True, True]


NOT_A_NUMBER = np.full((T, J), np.nan)


@pytest.mark.parametrize(
    ("name", "array", "message"),
    [
        ("links", np.zeros(4, int), "links has shape (4,), expected (3,)"),
        ("in_air", np.zeros(3), "in_air must hold booleans"),
        ("nodes", np.zeros(4), "nodes must hold whole numbers"),
        ("waypoints_q", np.zeros(4), "waypoints_q has shape (4,), expected (4, any)"),
        ("waypoints_q", np.zeros((4, 3)), "q has shape (9, 2), expected (9, 3)"),
        ("v", NOT_A_NUMBER, "v must hold finite numbers"),
        ("predicted_spread", np.zeros(8), "predicted_spread has shape (8,), expected (9,)"),
        ("felt", np.zeros((9, 6)), "felt has shape (9, 6), expected (9, 5)"),
        ("torque", np.zeros((9, 3)), "torque has shape (9, 3), expected (any, 2)"),
        ("q_measured", np.zeros((8, 2)), "q_measured has shape (8, 2), expected (9, 2)"),
        ("time_s", np.array(["x"] * 9), "time_s must hold finite numbers"),
    ],
)
def test_what_does_not_fit_is_named(execution, name, array, message):
    with pytest.raises(ValueError, match=r".") as error:
        Execution.from_arrays(execution.to_arrays() | {name: array})
    assert str(error.value).startswith(message)


# Motions stored before version 4 have no path.
@pytest.mark.parametrize("name", ["nodes", "path_knots", "predicted", "torque"])
def test_what_is_missing_is_named(execution, name):
    arrays = execution.to_arrays()
    del arrays[name]
    with pytest.raises(ValueError, match=f"^{name} is missing$"):
        Execution.from_arrays(arrays)


def test_a_file_from_before_there_were_doubts_has_none(plan):
    arrays = dataclasses.replace(plan, doubts=("contact may be lost",)).to_arrays()
    assert Plan.from_arrays(arrays).doubts == ("contact may be lost",)
    del arrays["doubts"]
    assert Plan.from_arrays(arrays).doubts == ()


@pytest.mark.parametrize("knots", [np.zeros(2), np.zeros((6, 1)), np.array(["x"] * 6)])
def test_an_invalid_path_is_refused(plan, knots):
    with pytest.raises(ValueError, match=r"^path_control does not fit path_knots$"):
        Plan.from_arrays(plan.to_arrays() | {"path_knots": knots})


def test_motions_are_frozen(plan, motion, execution):
    for one in (plan, motion, execution):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(one, dataclasses.fields(one)[0].name, None)
