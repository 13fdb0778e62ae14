"""What changed in a skin between two recordings."""

import numpy as np
import pytest
from made_up import sphere_points
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from benchmarks.accuracy.skin_faults import CHANGES, put_in
from selftouch_drake.agent.readings.skin_drift import compare_skins, field_centres, skin_move

NUMBER = 60
PLACE, _ = sphere_points(NUMBER)
NAMES = [f"taxel {n}" for n in range(NUMBER)]


def touched(number=1200, seed=0):
    """Places of touches, and touches, of a ball of skin."""
    rng = np.random.default_rng(seed)
    at = rng.normal(size=(number, 3))
    at /= np.linalg.norm(at, axis=1, keepdims=True)
    return at, np.maximum(0.0, 1 - cdist(at, PLACE) / 0.65) * rng.uniform(0.3, 2.0, (number, 1))


@pytest.fixture(scope="module")
def both():
    return touched(seed=0)[1], touched(seed=1)[1]


@pytest.mark.parametrize("kind", CHANGES)
def test_a_change_is_named_and_nobody_else_changed(both, kind):
    before, after = both
    worn, _, at = put_in(kind, after, PLACE, np.random.default_rng(3))
    found = compare_skins(before, worn[worn.any(axis=1)], NAMES, _no_file(kind))
    assert {number for number, _, _ in found.changes} == set(at)
    assert all(CHANGES[kind] in what for _, what, _ in found.changes)


def _no_file(kind):
    """A dead board needs a file: in its middle nobody feels anything."""
    from selftouch_drake.agent.readings.receptor_faults import neighbours_in_file

    return neighbours_in_file(PLACE) if kind == "dead board" else None


def test_a_gain_comes_with_its_error(both):
    before, after = both
    weaker = after.copy()
    weaker[:, 5] *= 0.5
    found = compare_skins(before, 3.0 * weaker, NAMES)  # all press three times as firmly
    assert [(number, what) for number, what, _ in found.changes] == [(5, "weaker")]
    assert abs(np.log(found.gain[5] / 0.5)) < 4 * found.gain_sigma[5]
    others = np.delete(np.arange(NUMBER), 5)
    assert np.nanmax(np.abs(np.log(found.gain[others]))) < 0.2


def test_a_skin_that_shifted_and_turned_is_measured():
    (first, before), (second, after) = touched(3000, 0), touched(3000, 1)
    angle, shift = 0.1, np.array([0.05, 0.0, 0.1])
    turn = Rotation.from_rotvec([0, 0, angle]).as_matrix()
    start = field_centres(first, before)
    extent = np.linalg.norm(np.ptp(start, axis=0))
    same = skin_move(start, field_centres(second, after))
    assert not same.surely
    moved = skin_move(start, field_centres(second @ turn.T + shift, after))
    assert moved.surely
    assert abs(moved.turn - angle) < 4 * moved.turn_sigma
    assert abs(moved.shift - np.linalg.norm(shift) / extent) < 4 * moved.shift_sigma


def test_a_few_receptors_tell_no_move():
    start = field_centres(*touched(60))
    start[5:] = np.nan
    assert skin_move(start, start) is None
