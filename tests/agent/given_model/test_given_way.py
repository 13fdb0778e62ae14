"""A given way of joints: its places, what may change in it, and what is wrong with it."""

import dataclasses

import numpy as np
import pytest

from selftouch_drake.agent.given_model.taxels import compared, doubts, told
from selftouch_drake.agent.given_model.way import GivenWay
from selftouch_drake.agent.given_model.wrong import judged_tree


def pose(*shift):
    X = np.eye(4)
    X[:3, 3] = shift
    return X


#: A head that turns about y on the trunk, and an arm of four joints; the last but one slides.
WAY = GivenWay(
    names=("neck", "yaw", "pitch", "slide", "wrist"),
    slides=np.array([False, False, False, True, False]),
    axes=np.array([[0, 1, 0], [0, 0, 1], [0, 1, 0], [1, 0, 0], [0.6, 0, 0.8]]),
    signs=np.array([-1.0, 1, 1, 1, 1]),
    origins=np.array(
        [pose(0, 0, 0.5), pose(0.3, 0, 0), pose(0, 0.1, 0), pose(0.4, 0, 0), pose(0.2, 0, 0)]
    ),
    skin=pose(0, 0, 0.1),
    toucher=pose(0.1, 0, 0),
    mount="tip",
)


def turned(axis, angle):
    X = np.eye(4)
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    X[:3, :3] = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    return X


def place(way, q):
    """The toucher's place by one multiplication after the other."""
    skin = way.origins[0] @ turned(way.axes[0], q[0]) @ way.skin
    X = np.eye(4)
    for joint in range(1, 5):
        moved = (
            pose(*(q[joint] * way.axes[joint]))
            if way.slides[joint]
            else turned(way.axes[joint], q[joint])
        )
        X = X @ way.origins[joint] @ moved
    return (np.linalg.inv(skin) @ X @ way.toucher)[:3, 3]


def test_places_are_those_of_the_joints_one_after_the_other():
    q = np.random.default_rng(0).uniform(-1, 1, (20, 5))
    np.testing.assert_allclose(WAY.places(q), [place(WAY, row) for row in q], atol=1e-12)


def test_an_offset_is_a_change_of_what_a_joint_reads():
    changes = [change for change in WAY.changes() if change.is_offset]
    assert [change.frame for change in changes] == list(WAY.names)
    assert [change.unit for change in changes] == ["rad", "rad", "rad", "m", "rad"]
    offsets = np.array([0.1, -0.2, 0.05, 0.03, 0.2])
    q = np.random.default_rng(1).uniform(-1, 1, (20, 5))
    found = WAY.changed(changes, offsets).places(q)
    np.testing.assert_allclose(found, WAY.places(q + offsets), atol=1e-12)


def test_each_frame_may_turn_and_shift_and_the_toucher_shift():
    changes = WAY.changes()
    assert len(changes) == 6 * 5 + 3
    assert [change.text for change in changes[-3:]] == [f"shift along {axis}" for axis in "xyz"]
    across = {change.label for change in changes if change.frame == "wrist"}
    assert across == {"its axis", "across 1", "across 2"}
    assert len(dataclasses.replace(WAY, mount="").changes()) == 30


@pytest.fixture(scope="module")
def touches():
    """Postures of an arm on a ball and what receptors read there."""
    rng = np.random.default_rng(2)
    q = rng.uniform(-1.5, 1.5, (40_000, 5))
    places = WAY.places(q)
    middle = places.mean(axis=0)
    q = q[np.abs(np.linalg.norm(places - middle, axis=1) - 0.3) < 0.01][:400]
    receptors = rng.normal(size=(60, 3))
    receptors = middle + 0.3 * receptors / np.linalg.norm(receptors, axis=1, keepdims=True)
    apart = np.linalg.norm(WAY.places(q)[:, None] - receptors, axis=2)
    sensation = np.maximum(1 - (apart / 0.3) ** 2, 0) ** 2
    felt = sensation.any(axis=1)
    return q[felt], sensation[felt]


def test_a_right_tree_is_not_called_wrong(touches):
    verdict = judged_tree(WAY, *touches)
    assert verdict.fits
    assert verdict.best.text == ""
    assert not verdict.new_axes.any()


@pytest.mark.parametrize(
    ("axes", "says"),
    [
        ({2: [0, -1, 0]}, "joint pitch turns the other way round: its axis is 0 1 0"),
        ({1: [1, 0, 0]}, "joint yaw turns about another axis: its axis is 0 0 1"),
        ({3: [-1, 0, 0]}, "joint slide slides the other way round: its axis is 1 0 0"),
    ],
)
def test_a_wrong_axis_is_named(touches, axes, says):
    wrong = WAY.axes.copy()
    for joint, axis in axes.items():
        wrong[joint] = axis
    verdict = judged_tree(dataclasses.replace(WAY, axes=wrong), *touches)
    assert verdict.best.text == says
    assert verdict.new_axes.tolist() == [joint in axes for joint in range(5)]


def test_exchanged_joints_are_named(touches):
    q, sensation = touches
    verdict = judged_tree(WAY, q[:, [0, 4, 2, 3, 1]], sensation)
    assert verdict.best.text == "the readings of joints yaw and wrist are exchanged"
    assert verdict.best.columns.tolist() == [0, 4, 2, 3, 1]


NAMES = [f"T{n}" for n in range(30)]
ERROR = np.full((30, 3), 0.0005)
GROUPS = [f"G{n // 3}" for n in range(30)]


def skin(seed=3):
    """Places of 30 receptors, 2 cm apart, on a bent sheet."""
    x, y = np.meshgrid(0.02 * np.arange(6), 0.02 * np.arange(5))
    places = np.c_[x.ravel(), y.ravel(), 2 * x.ravel() ** 2]
    return places, places + np.random.default_rng(seed).normal(0, 0.0005, places.shape)


def test_receptors_that_are_where_the_file_says_are_not_named():
    given, found = skin()
    X = turned(np.array([0, 0, 1.0]), 0.3)[:3, :3]
    beside = compared(1.02 * found @ X.T + [0.1, 0, 0], ERROR, given)
    assert told(beside, NAMES, GROUPS) == []
    assert beside.turn == pytest.approx(0.3, abs=0.01)
    assert beside.scale == pytest.approx(1.02, abs=0.01)


@pytest.mark.parametrize(
    ("order", "groups", "says"),
    [
        ({4: 20, 20: 4}, GROUPS, ["receptors T4 and T20 are exchanged"]),
        (
            {6: 7, 7: 8, 8: 6},
            GROUPS,
            ["triangle G2 is turned by 120 degrees (receptors T6, T7, T8)"],
        ),
        (
            {6: 7, 7: 8, 8: 6},
            None,
            ["receptors T6, T7, T8 are turned by 120 degrees, or read in each other's place"],
        ),
    ],
)
def test_receptors_that_are_elsewhere_are_named(order, groups, says):
    given, found = skin()
    moved = found.copy()
    for here, there in order.items():
        moved[here] = found[there]
    moved[29] = np.nan
    assert told(beside := compared(moved, ERROR, given), NAMES, groups) == says
    assert doubts(beside, NAMES) == []


def test_a_receptor_that_is_elsewhere_alone_is_doubted():
    given, found = skin()
    moved = found.copy()
    moved[6] = found[22] + 0.0001
    beside = compared(moved, ERROR, given)
    assert told(beside, NAMES, GROUPS) == []
    (doubt,) = doubts(beside, NAMES)
    assert doubt.startswith("receptor T6 is ")
    assert doubt.endswith(" mm away, where T22 is")
