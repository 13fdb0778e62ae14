"""A point at the end of three links in space, and a ball that feels how deep the point is."""

from itertools import pairwise

import numpy as np

from selftouch_drake.agent.body import Felt, Followed
from selftouch_drake.agent.practice.sliding import Slider

RADIUS, DEPTH = 0.5, 0.05
CENTRE = np.array([0.7, 0.0, 0.3])
LIMIT = np.full(4, 3.0)
UNIT = np.array([1.0, 2.0, 0.5, 4.0])


def hand(x):
    """`(n, 3)` positions from yaw, shoulder and elbow; the fourth joint has no effect."""
    yaw, shoulder, elbow, _ = np.moveaxis(np.asarray(x, dtype=float), -1, 0)
    flat = 0.7 * np.cos(shoulder) + 0.6 * np.cos(shoulder + elbow)
    up = 0.7 * np.sin(shoulder) + 0.6 * np.sin(shoulder + elbow)
    return np.stack([flat * np.cos(yaw), flat * np.sin(yaw), up], axis=-1)


def deep(x):
    return RADIUS - np.linalg.norm(hand(x) - CENTRE, axis=-1)


def feel(x):
    """Two receptors, left and right; both feel how deep the ball is pressed."""
    left = 1 / (1 + np.exp(-4 * (hand(x) - CENTRE)[:, 1]))
    return np.stack([left, 1 - left], axis=1) * np.maximum(deep(x), 0.0)[:, None]


def possible(x):
    return deep(x) < 0.07


def touches(num, seed=0):
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.5, 1.5, (40_000, 4))
    return x[(deep(x) > 0.01) & (deep(x) < DEPTH)][:num]


class Finger:
    """A body that jumps, with joints in units of their own."""

    joint_names = ("yaw", "shoulder", "elbow", "none")
    velocity, acceleration = np.ones(4), np.ones(4)
    num_receptors, jumps = 2, True

    def __init__(self, unit=UNIT, *, lower=-LIMIT, upper=LIMIT, possible=possible):
        self.lower, self.upper, self._unit, self._possible = (
            lower / unit,
            upper / unit,
            unit,
            possible,
        )

    def feel(self, q):
        x = q * self._unit
        return Felt(q=q, sensation=feel(x), reached=self._possible(x))

    def follow(self, time_s, q):
        return Followed(time_s=time_s, q=q, sensation=self.feel(q).sensation)


SLIDER = Slider(Finger(), UNIT)


def held(x):
    """Share of the straight way through `(n, J)` configurations on which something is felt."""
    dense = np.concatenate([np.linspace(a, b, 20) for a, b in pairwise(x)])
    return np.mean(feel(dense).any(axis=1) & possible(dense))


def test_touch_is_held_where_the_straight_way_lets_go():
    x = touches(40)
    straight, slid = [], []
    for x_from, x_to in pairwise(x):
        found = SLIDER.slide(x_from, x_to)
        if found is None:
            continue
        passed, felt = found
        way = np.concatenate([x_from[None], passed, x_to[None]])
        assert np.linalg.norm(np.diff(way, axis=0), axis=1).max() < 0.13
        np.testing.assert_array_equal(felt, feel(passed))
        straight.append(held(np.stack([x_from, x_to])))
        slid.append(held(way))
    assert len(slid) > 25
    assert np.mean(straight) < 0.7
    assert min(slid) == 1.0


def test_joints_that_are_the_same_at_both_ends_stay():
    x_from, x_to = touches(2)
    x_to[3] = x_from[3]
    passed, _ = SLIDER.slide(x_from, x_to)
    assert (passed[:, 3] == x_from[3]).all()


def test_there_is_no_way_from_or_to_where_nothing_is_felt():
    (x,) = touches(1)
    in_air = np.array([np.pi, 0.0, 0.0, 0.0])
    assert SLIDER.slide(x, in_air) is None
    assert SLIDER.slide(in_air, x) is None


def test_no_joint_leaves_its_limits():
    x_from, x_to = touches(2, seed=3)
    lower, upper = np.minimum(x_from, x_to) - 0.02, np.maximum(x_from, x_to) + 0.02
    found = Slider(Finger(lower=lower, upper=upper), UNIT).slide(x_from, x_to)
    if found is not None:
        assert (found[0] >= lower).all()
        assert (found[0] <= upper).all()


def test_where_the_robot_cannot_be_no_way_leads():
    x = touches(30, seed=5)
    for x_from, x_to in pairwise(x):
        if (found := SLIDER.slide(x_from, x_to)) is not None:
            assert possible(found[0]).all()
