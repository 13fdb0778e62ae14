import numpy as np
import pytest

from selftouch_drake.agent.representation.touches import (
    expected_readings,
    overlapping,
    receptors_together,
    separate_touches,
)

# Six receptors in a row, each overlapping the next.
ROW = np.eye(6, dtype=bool) | np.eye(6, k=1, dtype=bool) | np.eye(6, k=-1, dtype=bool)


@pytest.mark.parametrize(
    ("sensation", "touches"),
    [
        ([1, 2, 1, 0, 0, 0], [[1, 2, 1, 0, 0, 0]]),
        ([1, 2, 0, 0, 3, 1], [[0, 0, 0, 0, 3, 1], [1, 2, 0, 0, 0, 0]]),
        ([1, 2, 3, 4, 5, 6], [[1, 2, 3, 4, 5, 6]]),
        ([3, 0, 2, 0, 1, 0], [[3, 0, 0, 0, 0, 0], [0, 0, 2, 0, 0, 0], [0, 0, 0, 0, 1, 0]]),
    ],
)
def test_touches_are_what_no_overlap_joins(sensation, touches):
    row, found = separate_touches(np.array([sensation]), ROW)
    assert row.tolist() == [0] * len(touches)
    np.testing.assert_array_equal(found, touches)


def test_nothing_of_a_sensation_is_lost():
    rng = np.random.default_rng(0)
    sensation = rng.exponential(size=(200, 6)) * (rng.random((200, 6)) < 0.4)
    sensation = sensation[sensation.any(axis=1)]
    row, touches = separate_touches(sensation, ROW)
    assert (np.diff(row) >= 0).all()
    whole = np.zeros_like(sensation)
    np.add.at(whole, row, touches)
    np.testing.assert_array_equal(whole, sensation)


def test_overlap_is_found_from_what_is_felt_together():
    rng = np.random.default_rng(0)
    place = rng.uniform(0, 6, 3000)
    field = np.maximum(1 - np.abs(place[:, None] - np.arange(6) - 0.5), 0)
    # In one touch in ten a second finger touches, anywhere.
    second = field[rng.permutation(3000)] * (rng.random((3000, 1)) < 0.1)
    overlap, double = overlapping(field + second)
    np.testing.assert_array_equal(overlap, ROW)
    assert not double


def test_a_receptor_at_the_rim_joins_no_two_skins():
    rng = np.random.default_rng(0)
    place = rng.uniform(0, 12, 6000)
    field = np.maximum(1.5 - np.abs(place[:, None] - np.arange(12) - 0.5), 0)
    skins = [slice(0, 6), slice(6, 12)]
    for one, other in (skins, skins[::-1]):
        field[(place < 6) == (other.start == 0), one] = 0
    # Between two skins a fist presses both: nearly half of the touches of one receptor.
    wedged = np.flatnonzero(field[:, 6] > 0)
    wedged = rng.permutation(wedged)[: int(0.45 * len(wedged))]
    field[wedged, 3:6] += 1
    overlap, _ = overlapping(field)
    assert not overlap[skins[0], skins[1]].any()
    assert overlap[skins[0], skins[0]].sum() == overlap[skins[1], skins[1]].sum()


def test_a_receptor_that_never_feels_overlaps_with_itself_alone():
    overlap, _ = overlapping(np.array([[1.0, 1.0, 0.0]] * 5))
    np.testing.assert_array_equal(overlap, [[1, 1, 0], [1, 1, 0], [0, 0, 1]])


def test_many_receptors_are_pooled_by_what_they_feel():
    # Two rings of 600 receptors, which a touch feels within a hundredth of a ring; five touches
    # of each. The last receptor never feels.
    rng = np.random.default_rng(0)
    place, ring = rng.random(6_000), rng.integers(2, size=6_000)
    apart = (place[:, None] - np.arange(600) / 600 + 0.5) % 1 - 0.5
    field = np.maximum(1 - np.abs(apart) / 0.01, 0)
    sensation = np.zeros((6_000, 1201))
    for one in range(2):
        sensation[:, 600 * one : 600 * (one + 1)] = field * (ring == one)[:, None]
    together = receptors_together(sensation)
    assert len(np.unique(together.pool)) == 1000
    assert set(together.pool[:600]).isdisjoint(together.pool[600:1200])
    assert together.pool[1200] not in together.pool[:1200]
    # Neighbours overlap; no pair of both rings does, and nothing is set aside.
    assert together.overlap[np.arange(599), np.arange(599) + 1].all()
    assert not together.overlap[:600, 600:].any()
    row, felt, aside = together.places(sensation)
    np.testing.assert_array_equal(together.receptors(sensation, row, felt), sensation)
    assert not aside.any()
    # Touches are compared over their neighbourhood: farther than a field reaches.
    compared = felt @ expected_readings(felt, together)
    first = np.flatnonzero(ring == 0)
    near, far = (first[np.argmin(np.abs(place[first] - there))] for there in (0.525, 0.75))
    here = first[np.argmin(np.abs(place[first] - 0.5))]
    assert sensation[here] @ sensation[near] == 0
    assert compared[here] @ compared[near] > 0
    assert compared[here] @ compared[far] == 0


def test_receptors_that_share_no_touch_are_never_pooled():
    # Each touch is felt by one receptor, or two neighbours, of 1500.
    rng = np.random.default_rng(0)
    touched = rng.integers(1500, size=4000)
    sensation = np.zeros((4000, 1500))
    sensation[np.arange(4000), touched] = 1.0
    sensation[np.arange(2000), (touched[:2000] + 1) % 1500] = 0.5
    pool = receptors_together(sensation).pool
    felt = np.flatnonzero(sensation.any(axis=0))
    _, size = np.unique(pool[felt], return_counts=True)
    assert size.max() <= 3


@pytest.mark.parametrize("num_felt", [0, 1, 2])
def test_receptors_that_hardly_feel_need_no_pools(num_felt):
    sensation = np.zeros((50, 1200))
    sensation[:, :num_felt] = 1.0
    together = receptors_together(sensation)
    assert len(np.unique(together.pool)) == 1 + num_felt


def test_a_skin_that_is_seldom_touched_is_no_part_of_the_fist_that_touches_it():
    rng = np.random.default_rng(0)

    def ring(num, at):
        apart = (at[:, None] - np.arange(num) / num + 0.5) % 1 - 0.5
        return np.maximum(1 - np.abs(apart) * num / 2.5, 0)

    fist, torso, head = (ring(num, rng.random(20_000)) for num in (30, 100, 100))
    on_head = (np.arange(20_000) < 120)[:, None]
    sensation = np.hstack([fist, np.where(on_head, 0, torso), np.where(on_head, head, 0)])
    together = receptors_together(sensation)
    assert together.double
    assert not together.near[:30, 30:].any()
    assert not together.near[30:130, 130:].any()
