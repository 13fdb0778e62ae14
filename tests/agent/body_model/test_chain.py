"""Chains of twists against the exponential of matrices and against finite differences."""

import time

import numpy as np
import pytest
from scipy.linalg import expm

from selftouch_drake.agent.body_model.chain import (
    adjoint,
    derivatives,
    exponentials,
    places,
    shifted,
)


def matrix(twist):
    w, v = twist[:3], twist[3:]
    return np.array(
        [[0, -w[2], w[1], v[0]], [w[2], 0, -w[0], v[1]], [-w[1], w[0], 0, v[2]], [0, 0, 0, 0]]
    )


def a_chain(seed=0, length=5, turns=(1.0, 1e-9, 0.0, 0.05, 2.0)):
    random = np.random.default_rng(seed)
    twists = random.standard_normal((length, 6))
    twists[:, :3] *= np.array(turns)[:, None]
    return random.uniform(-3, 3, (20, length)), twists, random.standard_normal(3)


@pytest.mark.parametrize("turn", [0.0, 1e-12, 1e-3, 0.1, 0.2236, 0.23, 1.0, 9.0])
def test_an_exponential_is_that_of_the_matrix(turn):
    twist = np.r_[turn * np.array([0.6, 0.0, -0.8]), 1.0, 2.0, -0.5]
    assert exponentials(twist)[0] == pytest.approx(expm(matrix(twist)), abs=1e-12)


def test_places_are_a_product_of_exponentials():
    q, twists, point = a_chain()
    signs = np.array([1, -1, 1, 1, -1])
    expected = []
    for row in q:
        motion = np.eye(4)
        for twist, sign, t in zip(twists, signs, row, strict=True):
            motion = motion @ expm(sign * t * matrix(twist))
        expected.append((motion @ np.r_[point, 1])[:3])
    assert places(q, twists, point, signs) == pytest.approx(np.array(expected), abs=1e-10)


def test_derivatives_are_those_of_finite_differences():
    q, twists, point = a_chain()
    signs = np.array([1, -1, 1, 1, -1])
    place, by_twist, by_point, by_q = derivatives(q, twists, point, signs)
    assert place == pytest.approx(places(q, twists, point, signs), abs=1e-14)
    step = 1e-6

    def difference(move):
        return (move(step) - move(-step)) / (2 * step)

    for joint in range(5):
        for entry in range(6):

            def by_entry(h, joint=joint, entry=entry):
                changed = twists.copy()
                changed[joint, entry] += h
                return places(q, changed, point, signs)

            assert by_twist[:, :, joint, entry] == pytest.approx(difference(by_entry), abs=2e-7)

        def by_reading(h, joint=joint):
            changed = q.copy()
            changed[:, joint] += h
            return places(changed, twists, point, signs)

        assert by_q[:, :, joint] == pytest.approx(difference(by_reading), abs=2e-7)
    for entry in range(3):
        axis = np.eye(3)[entry]
        slope = difference(lambda h, axis=axis: places(q, twists, point + h * axis, signs))
        assert by_point[:, :, entry] == pytest.approx(slope, abs=1e-8)


def test_a_similarity_carries_twists_along():
    q, twists, point = a_chain()
    random = np.random.default_rng(1)
    for hand in (1, -1):
        turn = np.linalg.qr(random.standard_normal((3, 3)))[0]
        turn *= hand * np.sign(np.linalg.det(turn)) * 1.7
        motion = np.eye(4)
        motion[:3, :3], motion[:3, 3] = turn, random.standard_normal(3)
        expected = places(q, twists, point) @ turn.T + motion[:3, 3]
        found = places(q, adjoint(motion, twists), turn @ point + motion[:3, 3])
        assert found == pytest.approx(expected, abs=1e-10)


def test_readings_of_another_zero_and_scale_are_the_same_chain():
    q, twists, point = a_chain()
    random = np.random.default_rng(2)
    center, scale = random.standard_normal(5), random.uniform(0.5, 2, 5)
    other, carried = shifted(twists, center, scale)
    found = places(q, other, carried[:3, :3] @ point + carried[:3, 3])
    assert found == pytest.approx(places((q - center) / scale, twists, point), abs=1e-10)


@pytest.mark.slow
def test_a_million_places_take_less_than_a_second():
    random = np.random.default_rng(0)
    q, twists = random.standard_normal((1_000_000, 9)), random.standard_normal((9, 6))
    places(q[:10], twists, np.zeros(3))
    start = time.process_time()
    places(q, twists, np.zeros(3))
    assert time.process_time() - start < 1
