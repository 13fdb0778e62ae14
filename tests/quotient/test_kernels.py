import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from selftouch_drake.quotient.kernels import KernelSets, sample_rows

labels = st.lists(st.integers(0, 5), min_size=1, max_size=80).map(np.array)


@settings(deadline=None)
@given(labels, st.integers(1, 10))
def test_a_kernel_keeps_as_many_rows_as_it_may(label, max_size):
    rows = sample_rows(label, max_size, seed=1)
    kept = np.bincount(label[rows], minlength=6)
    assert kept.tolist() == np.minimum(np.bincount(label, minlength=6), max_size).tolist()
    assert rows.tolist() == sorted(rows.tolist(), key=lambda row: (label[row], row))


def test_every_row_has_an_equal_chance():
    kept = np.zeros(40)
    for seed in range(2000):
        kept[sample_rows(np.zeros(40, dtype=int), 10, seed=seed)] += 1
    # 2000 draws with probability 1/4: mean 500, standard deviation 19.
    assert np.abs(kept - 500).max() < 5 * 19


def test_firm_sets_keep_the_stronger_half():
    sets = KernelSets(np.arange(7.0)[:, None], np.array([0, 3, 7]))
    firm = sets.stronger_half(np.array([1.0, 3.0, 2.0, 9.0, 8.0, 7.0, 8.5]))
    assert firm.offsets.tolist() == [0, 2, 4]
    assert firm.x.ravel().tolist() == [1, 2, 3, 6]


def test_thinned_sets_keep_evenly_strided_configurations():
    sets = KernelSets(np.arange(12.0)[:, None], np.array([0, 1, 8, 12]))
    few = sets.thinned(3)
    assert few.offsets.tolist() == [0, 1, 4, 7]
    assert few.x.ravel().tolist() == [0, 1, 3, 5, 8, 9, 10]
    assert sets.thinned(9).x.tolist() == sets.x.tolist()
