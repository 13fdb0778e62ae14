import numpy as np
import pytest

from selftouch_drake.agent.representation.touches import (
    overlapping,
    separate_touches,
)

# Six receptors in a row, each overlapping the next.
ROW = np.eye(6, dtype=bool) | np.eye(6, k=1, dtype=bool) | np.eye(6, k=-1, dtype=bool)


@pytest.mark.parametrize(
    ("sensation", "number", "first", "second"),
    [
        ([0, 0, 0, 0, 0, 0], 0, [0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0]),
        ([1, 2, 1, 0, 0, 0], 1, [1, 2, 1, 0, 0, 0], [0, 0, 0, 0, 0, 0]),
        ([1, 2, 0, 0, 3, 1], 2, [0, 0, 0, 0, 3, 1], [1, 2, 0, 0, 0, 0]),
        ([1, 2, 3, 4, 5, 6], 1, [1, 2, 3, 4, 5, 6], [0, 0, 0, 0, 0, 0]),
        ([3, 0, 2, 0, 1, 0], 3, [3, 0, 0, 0, 0, 0], [0, 0, 2, 0, 0, 0]),
    ],
)
def test_touches_are_what_no_overlap_joins(sensation, number, first, second):
    found, parts = separate_touches(np.array([sensation]), ROW)
    assert found.tolist() == [number]
    np.testing.assert_array_equal(parts[0], [first, second])


def test_nothing_of_one_or_two_touches_is_lost():
    rng = np.random.default_rng(0)
    sensation = rng.exponential(size=(200, 6)) * (rng.random((200, 6)) < 0.4)
    number, parts = separate_touches(sensation, ROW)
    whole = number <= 2
    np.testing.assert_allclose(parts.sum(axis=1)[whole], sensation[whole], rtol=1e-6)


def test_overlap_is_found_from_what_is_felt_together():
    rng = np.random.default_rng(0)
    place = rng.uniform(0, 6, 3000)
    field = np.maximum(1 - np.abs(place[:, None] - np.arange(6) - 0.5), 0)
    # In one touch in ten a second finger touches, anywhere.
    second = field[rng.permutation(3000)] * (rng.random((3000, 1)) < 0.1)
    np.testing.assert_array_equal(overlapping(field + second), ROW)


def test_a_receptor_that_never_feels_overlaps_with_itself_alone():
    overlap = overlapping(np.array([[1.0, 1.0, 0.0]] * 5))
    np.testing.assert_array_equal(overlap, [[1, 1, 0], [1, 1, 0], [0, 0, 1]])
