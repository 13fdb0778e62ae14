import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from selftouch_drake.quotient.sensations import assign, target_sensations, unit


def test_assign_by_hand():
    targets = np.array([[1.0, 0.0], [0.0, 1.0]], dtype=np.float32)
    label, error = assign(np.array([[5.0, 0.0], [0.0, 0.01], [3.0, 4.0]]), targets)
    assert label.tolist() == [0, 1, 1]
    np.testing.assert_allclose(error, [0.0, 0.0, 0.2], atol=1e-6)


@pytest.mark.parametrize("share_felt", [0.05, 0.3, 1.0])
def test_assign_finds_what_a_matrix_product_finds(share_felt):
    rng = np.random.default_rng(3)
    felt = rng.random((400, 37)) < share_felt
    felt[:, 36] |= ~felt.any(axis=1)
    sensation = felt * rng.exponential(size=felt.shape)
    targets = unit(sensation[:50])
    likeness = unit(sensation) @ targets.T
    label, error = assign(sensation, targets)
    best = likeness.max(axis=1)
    np.testing.assert_allclose(likeness[np.arange(400), label], best, atol=1e-6)
    np.testing.assert_allclose(error, 1.0 - best, atol=1e-6)


def test_a_light_touch_is_felt_as_a_firm_one():
    firm = np.array([[0.3, 0.4, 0.0]])
    np.testing.assert_allclose(unit(firm * 1e-30), [[0.6, 0.8, 0.0]], atol=1e-6)


@settings(max_examples=20, deadline=None)
@given(st.integers(2, 40), st.integers(0, 99))
def test_every_target_is_the_nearest_of_some_row(num_targets, seed):
    rng = np.random.default_rng(seed)
    sensation = rng.exponential(size=(200, 6)).astype(np.float32) ** 3
    targets = target_sensations(sensation[:120], num_targets)
    label, error = assign(sensation, targets)
    assert targets.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(targets, axis=1), 1.0, atol=1e-5)
    assert set(label.tolist()) == set(range(num_targets))
    assert error.min() >= 0.0


def test_targets_are_spread_more_evenly_than_the_touches():
    rng = np.random.default_rng(0)
    often = np.radians(rng.uniform(0.0, 3.0, 5000))
    seldom = np.radians(rng.uniform(3.0, 90.0, 300))
    angle = np.concatenate([often, seldom])
    targets = target_sensations(np.stack([np.cos(angle), np.sin(angle)], axis=1), 16)
    found = np.degrees(np.sort(np.arctan2(targets[:, 1], targets[:, 0])))
    assert np.diff(found).min() > 2.0
    assert np.diff(found).max() < 12.0


def test_too_few_distinct_sensations():
    with pytest.raises(ValueError, match="distinct") as error:
        target_sensations(np.repeat(np.eye(3), 4, axis=0), 5)
    assert str(error.value) == (
        "num_targets is 5, but the experience holds only 3 distinct sensations: "
        "give at most 3, or babble longer"
    )
