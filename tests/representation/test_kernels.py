import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from selftouch_drake.representation.kernels import merge_kernels, sample_kernels

labels = st.lists(st.integers(0, 5), min_size=1, max_size=80).map(np.array)


@given(labels)
def test_large_enough_kernels_partition_the_rows(label):
    sample = sample_kernels(label, len(label), seed=1)
    offsets = sample.offsets(6)
    assert sorted(sample.row.tolist()) == list(range(len(label)))
    for kernel in range(6):
        rows = sample.row[offsets[kernel] : offsets[kernel + 1]]
        assert rows.tolist() == np.flatnonzero(label == kernel).tolist()


@given(labels, st.integers(1, 10))
def test_no_kernel_keeps_more_than_it_may(label, max_size):
    sample = sample_kernels(label, max_size, seed=1)
    kept = np.diff(sample.offsets(6))
    assert kept.tolist() == np.minimum(np.bincount(label, minlength=6), max_size).tolist()
    assert (label[sample.row] == sample.kernel).all()


@settings(deadline=None)
@given(labels, st.integers(1, 10), st.data())
def test_batches_in_any_order_give_the_same_kernels(label, max_size, data):
    cut = data.draw(st.integers(0, len(label)))
    whole = sample_kernels(label, max_size, seed=7)
    early = sample_kernels(label[:cut], max_size, seed=7)
    late = sample_kernels(label[cut:], max_size, seed=7, first_row=cut)
    for merged in (merge_kernels(early, late, max_size), merge_kernels(late, early, max_size)):
        assert merged.row.tolist() == whole.row.tolist()
        assert merged.kernel.tolist() == whole.kernel.tolist()


def test_every_row_has_an_equal_chance():
    kept = np.zeros(40)
    for seed in range(2000):
        kept[sample_kernels(np.zeros(40, dtype=int), 10, seed=seed).row] += 1
    # 2000 draws of chance 1/4: 500, standard deviation 19.
    assert np.abs(kept - 500).max() < 5 * 19
