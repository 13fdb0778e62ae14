"""The whole way from configurations and labels to a body model, and what is refused."""

import numpy as np
import pytest
from hand_made_chains import an_arm, misfit, touches
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.chain import places
from selftouch_drake.agent.body_model.find import find_body_model
from selftouch_drake.agent.body_model.model import JointKind

NAMES = ["d", "c", "b", "a", "e"]


def found(q, target, kernels=150, **more):
    part = np.zeros(kernels, dtype=int)
    return find_body_model(q, None, target, part, joint_names=NAMES[: q.shape[1]], **more)


def test_a_chain_of_unknown_order_and_units_is_found():
    twists, point = an_arm()
    q, target, y = touches(twists, point)
    # Its joints are shuffled, in other units, with other zeros, and one runs backwards.
    order, unit, zero = [2, 0, 3, 1], np.array([57.3, 1, -100, 1]), np.array([10, 0, 3, -1])
    readings = q[:, order] * unit + zero
    model = found(readings, target)
    assert model.accepted, model.reason
    assert misfit(model.place(readings, target), y) < 1.0
    assert [order[joint] for joint in model.chain(int(model.toucher_link[0]))] == [0, 1, 2, 3]
    assert set(model.joint_kind.tolist()) == {JointKind.TURNS}
    assert model.dimension == 3
    # The scale of each joint is known: |w| per unit of the reading.
    turns = np.linalg.norm(model.twists[:, :3], axis=1)
    assert turns == pytest.approx(1 / np.abs(unit), rel=0.02)
    assert np.abs(np.linalg.norm(model.twist_sigma, axis=1) * np.abs(unit)).max() < 0.1
    # The skin is a sphere, touched from outside.
    place = model.kernel_place
    sphere = np.linalg.lstsq(np.c_[2 * place, np.ones(len(place))], (place**2).sum(axis=1))[0]
    assert ((place - sphere[:3]) * model.kernel_normal).sum(axis=1).min() > 0


@pytest.fixture(scope="module")
def sliding():
    """Touches of an arm of which one joint slides, and the model of them."""
    q, target, y = touches(*an_arm(slides=[1]))
    return q, target, y, found(q, target)


def test_a_slide_is_told_from_a_turn(sliding):
    q, target, y, model = sliding
    assert model.accepted, model.reason
    assert model.joint_kind.tolist() == [1, 2, 1, 1]
    assert np.array_equal(model.twists[1, :3], np.zeros(3))
    assert misfit(model.place(q, target), y) < 1.0


def test_a_joint_that_does_not_matter_is_not_used():
    q, target, _ = touches(*an_arm())
    idle = np.random.default_rng(5).uniform(-1, 1, len(q))
    model = found(np.column_stack([q[:, :1], idle, q[:, 1:]]), target)
    assert model.accepted, model.reason
    assert model.used.tolist() == [True, False, True, True, True]


@pytest.mark.slow
def test_three_joints_leave_a_body_open():
    # Each kernel has one or two postures: a body that is wrong by 5 % makes them as small.
    q, target, _ = touches(*an_arm(joints=3))
    model = found(q, target)
    assert not model.accepted
    assert "the touches prove nothing" in model.reason


@pytest.mark.slow
def test_two_fingers_of_one_hand_are_told_apart():
    twists, point = an_arm()
    q, target, y = touches(twists, point, number=6000)
    other = point + np.array([1.5, 0.0, 1.0])
    # Where the second finger touches the same kernels.
    random = np.random.default_rng(9)
    tried = random.uniform(-1.5, 1.5, (400_000, 4))
    there = places(tried, twists, other)
    apart, nearest = cKDTree(y).query(there)
    close = np.flatnonzero(apart < 0.03)[:6000]
    both_q, both = np.concatenate([q, tried[close]]), np.r_[target, target[nearest[close]]]
    true = np.r_[np.zeros(len(q)), np.ones(len(close))]
    model = found(both_q, both)
    assert model.accepted, model.reason
    assert len(model.toucher_link) >= 2
    # Whichever number a finger has, its touches are its own.
    for toucher in range(len(model.toucher_link)):
        of_one = true[model.kernel_toucher == toucher]
        assert max(of_one.mean(), 1 - of_one.mean()) > 0.95
    assert 0.5 * true.mean() < true[model.kernel_toucher >= 0].mean() < 1.5 * true.mean()


@pytest.mark.slow
@pytest.mark.parametrize("wrong", ["mixed", "shuffled"])
def test_what_is_no_body_is_rejected(wrong):
    q, target, _ = touches(*an_arm())
    if wrong == "mixed":
        q = q + 0.2 * np.sin(2 * q[:, ::-1])
    else:
        target = np.random.default_rng(0).permutation(target)
    model = found(q, target)
    assert not model.accepted
    assert "rejected" in model.reason


def test_few_touches_are_not_looked_at():
    q, target, _ = touches(*an_arm(), number=40)
    model = found(q, target)
    assert not model.accepted
    assert "40 touches" in model.reason


def test_the_model_depends_on_the_seed_alone(sliding):
    q, target, _, one = sliding
    told = []
    other = found(q, target, progress=lambda fraction, what: told.append(fraction))
    for name, array in one.to_arrays().items():
        assert np.array_equal(array, other.to_arrays()[name], equal_nan=array.dtype.kind == "f")
    assert told == sorted(told)
    assert told[-1] == 1.0
