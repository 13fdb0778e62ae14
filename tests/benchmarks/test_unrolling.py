import sys

import numpy as np
import pytest
from bodies_by_hand import along_sphere, sphere, torus

from benchmarks.accuracy.unrolling import double_cover, landmarks, torsion, turns


def modulo_turns(num_points: int, order: int) -> np.ndarray:
    """Distances in the three-sphere modulo rotations by an `order`th of a turn."""
    x = np.random.default_rng(0).standard_normal((4000, 4))
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    z = x[:, :2] + 1j * x[:, 2:]
    turn = np.exp(2j * np.pi * np.arange(order) / order)

    def apart(a, b):
        overlap = (a.conj() @ b.T)[..., None] * turn
        return np.arccos(np.clip(overlap.real.max(axis=-1), -1, 1))

    picked, near = [0], apart(z[:1], z)[0]
    while len(picked) < num_points:
        picked.append(int(near.argmax()))
        near = np.minimum(near, apart(z[picked[-1:]], z)[0])
    distances = apart(z[picked], z[picked])
    np.fill_diagonal(distances, 0)
    return (distances + distances.T) / 2


@pytest.mark.parametrize(("order", "num"), [(1, 80), (2, 80), (4, 130)])
def test_counts_the_turns_that_come_undone(order, num):
    found = turns(modulo_turns(num, order))
    assert found.order == order
    assert [cover.found for cover in found.covers] == [True] * (len(found.covers) - 1) + [False]
    assert len(found.distances) == num * order


def test_a_loop_of_order_three_is_none_to_z2():
    found = torsion(modulo_turns(150, 3))
    assert not found.found
    assert found.stretch == 1.0


def test_free_loops_are_no_torsion():
    flat = np.random.default_rng(0).uniform(0, 1, (150, 2))
    apart = np.abs(flat[:, None] - flat[None])
    found = torsion(np.linalg.norm(np.minimum(apart, 1 - apart), axis=2))
    assert not found.found
    assert len(found.bars2) == len(found.bars3)
    assert turns(along_sphere(sphere(100))).order == 1


def test_noisy_distances_keep_the_order():
    noise = 0.1 * np.random.default_rng(1).standard_normal((100, 100))
    distances = modulo_turns(100, 2) * np.exp((noise + noise.T) / 2)
    assert turns(distances).order == 2


def test_a_double_cover_has_two_points_over_each():
    distances = modulo_turns(120, 2)
    found = torsion(distances)
    unrolled = double_cover(distances, found)
    np.testing.assert_allclose(unrolled, unrolled.T)
    # Short distances are the same on each sheet; the two points over one are a turn apart.
    sheets = np.minimum(unrolled[:120, :120], unrolled[:120, 120:])
    near = distances <= found.middle
    np.testing.assert_allclose(sheets[near], distances[near], rtol=1e-6)
    assert np.diag(unrolled[:120, 120:]).min() > 2 * found.middle


@pytest.mark.slow
def test_swapping_the_ends_of_a_chord_takes_four_turns_to_come_undone():
    rng = np.random.default_rng(0)
    middle, across = rng.standard_normal((2, 3000, 3))
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    across -= np.einsum("nx,nx->n", across, middle)[:, None] * middle
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    ends = np.stack([middle + across, middle - across]) / np.sqrt(2)

    def chords_apart(told_apart):
        angle = np.arccos(np.clip(np.einsum("anx,bmx->abnm", ends, ends), -1, 1))
        kept = np.hypot(angle[0, 0], angle[1, 1])
        return kept if told_apart else np.minimum(kept, np.hypot(angle[0, 1], angle[1, 0]))

    for told_apart, order in ((False, 4), (True, 2)):
        distances = chords_apart(told_apart)
        # Measured: 180 points show the loop of chords, 150 are too few.
        picked = landmarks(distances, 180)
        chosen = distances[np.ix_(picked, picked)]
        np.fill_diagonal(chosen, 0)
        assert turns((chosen + chosen.T) / 2).order == order


def test_landmarks_spread_evenly():
    points = torus(400)
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    picked = landmarks(distances, 50)
    assert len(set(picked.tolist())) == 50
    apart = distances[np.ix_(picked, picked)] + 9 * np.eye(50)
    assert apart.min() >= distances[:, picked].min(axis=1).max()
    np.testing.assert_array_equal(
        landmarks(distances[:20, :20], 50), landmarks(distances[:20, :20])
    )


def test_distances_must_be_finite():
    distances = modulo_turns(20, 1)
    distances[3, 4] = np.inf
    with pytest.raises(ValueError, match=r"^distances hold NaN or infinity: connect the quotient"):
        torsion(distances)


def test_without_ripser_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "ripser", None)
    with pytest.raises(ImportError, match=r"pip install 'selftouch-drake\[homology\]'$"):
        turns(modulo_turns(20, 1))
