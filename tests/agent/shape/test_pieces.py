import numpy as np
from bodies_by_hand import sphere

from selftouch_drake.agent.shape.cells import Cells, cut_wide_cells
from selftouch_drake.quotient.kernels import KernelSets


def cells_on_a_sphere(centres, points):
    """`points`, grouped by the nearest of `centres`."""
    owner = np.argmax(points @ centres.T, axis=1)
    order = np.argsort(owner, kind="stable")
    counts = np.bincount(owner, minlength=len(centres))
    return KernelSets(points[order], np.concatenate([[0], np.cumsum(counts)]))


def test_a_wide_cell_is_cut_in_parts_and_others_are_left():
    centres, points = sphere(200), sphere(20_000)
    around = np.argsort(-centres @ centres[100])[1:7]
    left = np.delete(centres, around, axis=0)
    wide = int(np.argmax(left @ centres[100]))
    sets = cells_on_a_sphere(left, points)
    cut, kernel = cut_wide_cells(sets, Cells.of(sets))
    assert (np.diff(kernel) >= 0).all()
    number = np.bincount(kernel)
    assert number[wide] == 3
    assert (np.delete(number, wide) == 1).all()
    sizes = cut.sizes
    assert sizes[kernel == wide].min() > 0.4 * np.median(sizes)
    # The rows of a kernel stay together.
    for k in (0, wide, len(left) - 1):
        rows = np.concatenate([cut.configurations(p) for p in np.flatnonzero(kernel == k)])
        original = sets.configurations(k)
        np.testing.assert_array_equal(rows[np.lexsort(rows.T)], original[np.lexsort(original.T)])


def test_even_cells_are_left_as_they_are():
    sets = cells_on_a_sphere(sphere(200), sphere(10_000))
    cut, kernel = cut_wide_cells(sets, Cells.of(sets))
    np.testing.assert_array_equal(cut.x, sets.x)
    np.testing.assert_array_equal(cut.offsets, sets.offsets)
    np.testing.assert_array_equal(kernel, np.arange(200))


def test_a_cell_of_few_configurations_is_not_cut():
    centres, points = sphere(200), sphere(3000)
    left = np.delete(centres, np.argsort(-centres @ centres[100])[1:7], axis=0)
    sets = cells_on_a_sphere(left, points[::3])
    _, kernel = cut_wide_cells(sets, Cells.of(sets))
    assert len(kernel) == len(left)
