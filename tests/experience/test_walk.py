import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from selftouch_drake.experience.walk import RandomWalk

LOWER = np.array([-3.14, -1.0, -2.6, 0.5])
UPPER = np.array([3.14, 2.6, 2.6, 0.75])


def _walk(seed=0, *, step_size=0.15, persistence=0.9):
    return RandomWalk(
        lower=LOWER,
        upper=UPPER,
        step_size=step_size,
        persistence=persistence,
        seed=np.random.SeedSequence(seed),
    )


@settings(max_examples=50, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    step_size=st.floats(1e-6, 100.0),
    persistence=st.floats(0.0, 0.999),
)
def test_it_stays_between_the_limits_and_moves(seed, step_size, persistence):
    q = _walk(seed, step_size=step_size, persistence=persistence).steps(300)
    assert q.shape == (300, 4)
    assert (q >= LOWER - 1e-12).all()
    assert (q <= UPPER + 1e-12).all()
    assert (np.ptp(q, axis=0) > 0).all()


@settings(max_examples=50, deadline=None)
@given(pieces=st.lists(st.integers(1, 60), min_size=1, max_size=8))
def test_it_is_the_same_however_it_is_cut_up(pieces):
    walk = _walk()
    cut = np.concatenate([walk.steps(piece) for piece in pieces])
    np.testing.assert_array_equal(cut, _walk().steps(sum(pieces)))


def test_walks_of_different_seeds_have_nothing_in_common():
    assert not np.isclose(_walk(0).steps(50), _walk(1).steps(50)).all(axis=1).any()


@pytest.mark.parametrize("persistence", [0.0, 0.9])
def test_its_velocity_has_the_size_and_the_persistence_that_were_asked_for(persistence):
    # Steps so small that the limits are hardly ever met.
    velocity = np.diff(_walk(3, step_size=1e-4, persistence=persistence).steps(40_000), axis=0)
    assert velocity.std(axis=0) == pytest.approx(1e-4, rel=0.1)
    for joint in velocity.T:
        assert np.corrcoef(joint[:-1], joint[1:])[0, 1] == pytest.approx(persistence, abs=0.03)


def test_it_goes_everywhere():
    q = _walk(5).steps(50_000)
    for joint, lower, upper in zip(q.T, LOWER, UPPER, strict=True):
        share, _ = np.histogram(joint, bins=5, range=(lower, upper))
        assert share / len(joint) == pytest.approx(0.2, abs=0.08)
