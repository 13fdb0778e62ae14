"""Faults of receptors on a ball of skin, each put in by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from made_up import sphere_points
from scipy.spatial.distance import cdist

from benchmarks.accuracy.skin_faults import KINDS, named_right, put_in
from selftouch_drake.agent.readings.receptor_faults import (
    Fault,
    _misplaced,
    find_faults,
    neighbours_by_touch,
    neighbours_in_file,
    rings,
)

NUMBER, FIELD = 60, 0.65
PLACE, _ = sphere_points(NUMBER)
NAMES = [f"taxel {n}" for n in range(NUMBER)]


def touches(number=1200, seed=0, below=1.0):
    """Touches of a ball of skin, up to some height."""
    rng = np.random.default_rng(seed)
    at = rng.normal(size=(4 * number, 3))
    at /= np.linalg.norm(at, axis=1, keepdims=True)
    at = at[at[:, 2] <= below][:number]
    return np.maximum(0.0, 1 - cdist(at, PLACE) / FIELD) * rng.uniform(0.3, 2.0, (len(at), 1))


@pytest.fixture(scope="module")
def felt():
    return touches()


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "dead board"])
def test_a_fault_is_named_and_nobody_else_is_blamed(felt, kind):
    for seed in range(3):
        worn, place, at = put_in(kind, felt, PLACE, np.random.default_rng(seed))
        found = find_faults(worn[worn.any(axis=1)], NAMES, neighbours_in_file(place))
        assert named_right(kind, found, at), [(found.fault[n], found.evidence[n]) for n in at]
        assert set(found.faulty.tolist()) == set(at)


def test_evidence_names_figures_of_the_fault(felt):
    worn = felt.copy()
    worn[:, 7] = 0.0
    worn[:, 20] = 0.5
    worn[:, [3, 40]] = worn[:, [40, 3]]
    found = find_faults(worn, NAMES, neighbours_in_file(PLACE))
    assert found.evidence[7].startswith("felt none of ")
    assert found.evidence[20] == "reads 0.5, whatever is touched"
    assert found.evidence[3].startswith("reads what taxel 40 should: likeness ")
    assert (found.read_as[3], found.read_as[40], found.read_as[5]) == (40, 3, 5)
    assert (found.felt[7], found.felt[20]) == (0, len(worn))
    assert found.expected[7] > 20
    assert found.evidence[5] == ""


def test_a_receptor_that_dies_or_sticks_is_found_with_its_touch(felt):
    worn = felt.copy()
    worn[600:, 7] = 0.0
    worn[480:, 20] = 1.5
    found = find_faults(worn, NAMES, neighbours_in_file(PLACE))
    assert set(found.faulty) == {7, 20}
    assert found.fault[7] == Fault.DEAD
    died = int(found.evidence[7].rsplit(" ", 1)[1].replace(",", ""))
    assert 540 <= died <= 660
    assert found.evidence[20] == "reads 1.5 from touch 480 on, whatever is touched"


def test_a_dead_board_is_seen_where_joints_put_touches_on_it(felt):
    worn, _, at = put_in("dead board", felt, PLACE, np.random.default_rng(0))
    kept = worn.any(axis=1)
    nearest = np.bincount(felt[kept].argmax(axis=1), minlength=NUMBER)
    found = find_faults(worn[kept], NAMES, neighbours_in_file(PLACE), nearest)
    assert set(found.faulty) == set(at)
    assert named_right("dead board", found, at)


def test_what_was_never_touched_is_not_called_dead():
    found = find_faults(touches(below=0.3), NAMES, neighbours_in_file(PLACE))
    never = np.flatnonzero(found.felt == 0)
    assert len(never) > 5
    assert len(found.faulty) == 0
    assert (found.fault[never] == Fault.UNKNOWN).all()


def test_where_fields_hardly_overlap_nobody_is_blamed():
    at = np.random.default_rng(0).normal(size=(4000, 3))
    at /= np.linalg.norm(at, axis=1, keepdims=True)
    strip = at[np.abs(at[:, 0]) < 0.25][:400]
    narrow = np.maximum(0.0, 1 - cdist(strip, PLACE) / 0.5)
    narrow[:, 7] = 0.4
    found = find_faults(narrow, NAMES, neighbours_in_file(PLACE))
    assert not found.overlap
    assert {n: str(found.fault[n]) for n in found.faulty.tolist()} == {7: "stuck"}


def test_on_the_rim_of_what_was_touched_only_a_receptor_that_is_far_away_is_moved():
    likeness = np.full((5, 5), 0.1) + 0.8 * np.eye(5)
    likeness[0, :2] = 0.5, 0.9
    likeness[2, 2:4] = 0.05, 0.9
    counted = SimpleNamespace(felt=np.full(5, 50))
    for rim, moved in ((False, {0: 1, 2: 3}), (True, {2: 3})):
        found, at = _misplaced(likeness, likeness, counted, np.full(5, rim), NAMES)
        assert at == moved
        assert set(found) == set(moved)


def test_without_places_loose_contacts_are_found_and_nobody_is_moved(felt):
    random = np.random.default_rng(1)
    loose, _, at = put_in("flickers", felt, PLACE, random)
    loose[:, [3, 40]] = loose[:, [40, 3]]
    found = find_faults(loose, NAMES)
    (bad,) = {{3: 40, 40: 3}.get(n, n) for n in at}
    assert found.faulty.tolist() == [bad]
    assert found.fault[bad] == Fault.FLICKERS


def test_weights_of_neighbours_sum_to_one(felt):
    for weight in (neighbours_in_file(PLACE), neighbours_by_touch(felt)):
        np.testing.assert_allclose(weight.sum(axis=1), 1.0)
        assert (np.diag(weight) == 0).all()
    alone = np.zeros((50, 4))
    alone[np.arange(50), np.arange(50) % 4] = 1.0
    assert not neighbours_by_touch(alone).any()


def test_rings_are_closed():
    assert rings({1: 2, 2: 1, 3: 1, 4: 5}) == [[1, 2]]
    assert rings({7: 8, 8: 9, 9: 7}) == [[7, 8, 9]]
