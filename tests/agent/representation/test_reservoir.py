import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from selftouch_drake.agent.representation import reservoir as reservoir_module
from selftouch_drake.agent.representation.reservoir import KernelReservoir, KernelSample
from selftouch_drake.quotient.kernels import sample_rows

labels = st.lists(st.integers(0, 5), min_size=1, max_size=80).map(np.array)


def sample_kernels(label, max_size, *, seed, cuts=()) -> KernelSample:
    reservoir = KernelReservoir(6, max_size, seed=seed)
    for rows in np.split(np.arange(len(label)), cuts):
        reservoir.add(label[rows], doubled=2 * rows)
    assert reservoir.num_rows == len(label)
    return reservoir.sample()


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
def test_batches_of_any_size_give_the_same_kernels(label, max_size, data):
    cuts = sorted(data.draw(st.lists(st.integers(0, len(label)), max_size=4)))
    whole = sample_kernels(label, max_size, seed=7)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reservoir_module, "_LEAST_WAITING", 3)
        batched = sample_kernels(label, max_size, seed=7, cuts=cuts)
    assert batched.row.tolist() == whole.row.tolist()
    assert batched.kernel.tolist() == whole.kernel.tolist()
    assert batched.columns["doubled"].tolist() == (2 * whole.row).tolist()


def test_memory_does_not_grow_with_the_experience():
    reservoir = KernelReservoir(6, 500, seed=0)
    for _ in range(100):
        reservoir.add(np.arange(10_000) % 6)
        held = sum(len(part["row"]) for part in (reservoir._settled, *reservoir._waiting) if part)
        assert held < 60_000
    assert np.diff(reservoir.sample().offsets(6)).tolist() == [500] * 6


def test_every_row_has_an_equal_chance():
    kept = np.zeros(40)
    for seed in range(2000):
        kept[sample_kernels(np.zeros(40, dtype=int), 10, seed=seed).row] += 1
    # 2000 draws with probability 1/4: mean 500, standard deviation 19.
    assert np.abs(kept - 500).max() < 5 * 19


@settings(deadline=None)
@given(labels, st.integers(1, 10), st.integers(0, 9))
def test_what_comes_in_batches_is_sampled_as_what_is_there(label, max_size, seed):
    streamed = sample_kernels(label, max_size, seed=seed, cuts=[len(label) // 3])
    assert streamed.row.tolist() == sample_rows(label, max_size, seed=seed).tolist()
