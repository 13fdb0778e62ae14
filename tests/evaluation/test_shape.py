import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import procrustes
from scipy.spatial.distance import cdist, pdist
from sklearn import manifold

from selftouch_drake.evaluation.shape import (
    distance_distortion,
    shape_rms_fraction,
    trustworthiness,
)


def apart(points: np.ndarray) -> np.ndarray:
    return cdist(points, points)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 99), st.integers(1, 9))
def test_trustworthiness_is_that_of_scikit_learn(seed, num_neighbours):
    rng = np.random.default_rng(seed)
    true = rng.normal(size=(25, 3))
    found = true[:, :2] + rng.normal(scale=0.3, size=(25, 2))
    expected = manifold.trustworthiness(true, found, n_neighbors=num_neighbours)
    assert trustworthiness(apart(found), apart(true), num_neighbours) == pytest.approx(expected)


def test_the_shape_error_is_that_of_scipy_s_procrustes_analysis():
    rng = np.random.default_rng(0)
    true = rng.normal(size=(30, 3))
    found = 5.0 * true[:, [1, 2, 0]] * [1, 1, -1] + rng.normal(scale=0.5, size=(30, 3))
    _, _, disparity = procrustes(true, found)
    rms = np.sqrt(disparity * np.square(true - true.mean(axis=0)).sum() / len(true))
    assert shape_rms_fraction(found, true) == pytest.approx(rms / pdist(true).max())


def test_trust_and_continuity_tell_a_fold_from_a_tear():
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    flat, torn = circle[:, :1], angle[:, None]
    true = apart(circle)
    # Opposite sides laid on each other: near is not truly near.
    assert trustworthiness(apart(flat), true, 6) < 0.8
    assert trustworthiness(true, apart(flat), 6) > 0.9
    # Cut open at one place: what is truly near there is no longer near.
    assert trustworthiness(apart(torn), true, 6) > 0.98
    assert trustworthiness(true, apart(torn), 6) < 0.97
    assert trustworthiness(2 * true, true, 6) == 1.0


def test_distortion_by_hand():
    true = np.array([[0.0, 1.0, 2.0], [1.0, 0.0, 4.0], [2.0, 4.0, 0.0]])
    assert distance_distortion(7 * true, true)[1] == pytest.approx(0.0)
    found = np.array([[0.0, 1.0, 2.2], [1.0, 0.0, 3.6], [2.2, 3.6, 0.0]])
    assert distance_distortion(found, true) == pytest.approx((0.1, 0.1))


def test_pairs_at_no_true_distance_are_left_out():
    true = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 2.0], [2.0, 2.0, 0.0]])
    found = np.array([[0.0, 0.3, 1.0], [0.3, 0.0, 1.0], [1.0, 1.0, 0.0]])
    assert distance_distortion(found, true)[1] == 0.0
