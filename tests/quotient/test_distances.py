import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from selftouch_drake.quotient.distances import (
    SET_DISTANCES,
    linked_nearest,
    quantile,
    set_distances,
)
from selftouch_drake.quotient.kernels import KernelSets

REFERENCE = {
    "minimum": (lambda near: near.min(axis=1), np.minimum),
    "quantile": (lambda near: np.quantile(near, 0.1, axis=1), lambda a, b: (a + b) / 2),
}


def reference(sets, name):
    reduce, symmetrise = REFERENCE[name]
    there = np.array([[reduce(cdist(a, b).min(axis=1)[None])[0] for b in sets] for a in sets])
    return symmetrise(there, there.T)


def random_sets(sizes, num_joints, seed):
    rng = np.random.default_rng(seed)
    sets = [rng.uniform(-3, 3, (size, num_joints)).astype(np.float32) for size in sizes]
    return sets, KernelSets(np.concatenate(sets), np.cumsum([0, *sizes]))


@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(1, 9), min_size=1, max_size=6), st.integers(1, 8), st.integers(0, 99))
def test_compiled_equals_reference(sizes, num_joints, seed):
    parts, sets = random_sets(sizes, num_joints, seed)
    found = [set_distances(sets, name) for name in SET_DISTANCES]
    for name, distance in zip(SET_DISTANCES, found, strict=True):
        np.testing.assert_allclose(distance, reference(parts, name), rtol=1e-4, atol=1e-4)
        assert (distance == distance.T).all()
        assert (np.diag(distance) == 0).all()
        assert (distance >= 0).all()


def test_by_hand():
    q = np.array([[0.0], [10.0], [1.0], [13.0]])
    sets = KernelSets(q, np.array([0, 2, 4]))
    found = [set_distances(sets, name) for name in ("minimum", "quantile")]
    np.testing.assert_allclose([distance[0, 1] for distance in found], [1.0, 1.2])


@settings(deadline=None)
@given(st.integers(1, 130), st.integers(0, 99))
def test_quantile_is_that_of_numpy_to_the_bit(num_queries, seed):
    near = np.random.default_rng(seed).random((num_queries, 5), dtype=np.float32)
    found = quantile(near, 0.1)
    assert found.dtype == np.float32
    assert np.array_equal(found, np.quantile(near, 0.1, axis=0))


def test_few_queries_stand_for_many():
    _, sets = random_sets([700, 900, 800], 3, 0)
    all_ask = set_distances(sets, "quantile", max_queries=1000)
    few_ask = set_distances(sets, "quantile", max_queries=200)
    np.testing.assert_allclose(few_ask, all_ask, rtol=0.1)


def test_rough_distances_are_near_and_the_others_exact():
    _, sets = random_sets([700, 900, 800, 600], 3, 0)
    rough = np.zeros((4, 4), dtype=bool)
    rough[0, 1:] = rough[1:, 0] = True
    exact = set_distances(sets, "quantile")
    mixed = set_distances(sets, "quantile", rough=rough)
    np.testing.assert_array_equal(mixed[~rough], exact[~rough])
    np.testing.assert_allclose(mixed[rough], exact[rough], rtol=0.5)
    assert (mixed[rough] != exact[rough]).all()


@pytest.mark.parametrize("num_threads", [1, 2, 7])
def test_any_number_of_threads_gives_the_same_bytes(num_threads, monkeypatch):
    _, sets = random_sets([30, 70, 1, 40, 55], 6, 0)
    monkeypatch.setattr("selftouch_drake.quotient.threads.num_cores", lambda: num_threads)
    found = [set_distances(sets, name) for name in SET_DISTANCES]
    monkeypatch.undo()
    for here, there in zip(
        found, (set_distances(sets, name) for name in SET_DISTANCES), strict=True
    ):
        assert here.tobytes() == there.tobytes()


def test_progress_rises_to_one():
    fractions = []
    _, sets = random_sets([3, 4], 2, 0)
    set_distances(sets, "minimum", progress=fractions.append)
    assert fractions == [0.5, 1.0]


def test_an_empty_kernel_is_refused():
    sets = KernelSets(np.zeros((4, 2)), np.array([0, 4, 4]))
    with pytest.raises(ValueError, match=r"^kernel 1 holds no configuration: drop it from its"):
        set_distances(sets, "minimum")


@pytest.mark.parametrize("num_joints", [1, 6])
def test_the_nearest_over_each_link_is_the_nearest_of_all(num_joints):
    rng = np.random.default_rng(0)
    offsets = np.cumsum([0, 7, 1, 13, 4])
    q = rng.normal(size=(offsets[-1], num_joints)).astype(np.float32)
    links = np.array([[0, 2], [2, 0], [1, 3], [3, 1], [0, 1]])
    of_link, row, nearest = linked_nearest(KernelSets(q, offsets), links)
    for link, (tail, head) in enumerate(links):
        entries = slice(*of_link[link : link + 2])
        here, there = (slice(*offsets[k : k + 2]) for k in (tail, head))
        squared = np.square(q[here, None].astype(float) - q[there]).sum(axis=2)
        assert np.array_equal(row[entries], offsets[head] + squared.argmin(axis=1))
        assert np.allclose(nearest[entries], squared.min(axis=1), rtol=1e-5)


def test_distances_are_measured_again_where_kernels_changed():
    rng = np.random.default_rng(0)
    offsets = np.cumsum([0, *rng.integers(3, 200, 20)])
    x = rng.normal(size=(offsets[-1], 4)).astype(np.float32)
    before = set_distances(KernelSets(x, offsets), "quantile")
    changed = np.isin(np.arange(20), [3, 11])
    x[np.repeat(changed, np.diff(offsets))] += 1.0
    after = set_distances(KernelSets(x, offsets), "quantile")
    again = set_distances(KernelSets(x, offsets), "quantile", changed=changed)
    np.testing.assert_array_equal(np.where(changed[:, None] | changed, again, before), after)
