"""Cuts wide cells into pieces, so that the body is sampled evenly.

Target sensations are evenly spaced. Where receptors are missing, a wide stretch of skin feels alike
and becomes one kernel. That leaves a gap in the layout, and a false loop around it. But a quotient
map is smooth, and separates the motor configurations within such a kernel.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from selftouch_drake.agent.clusters import clusters
from selftouch_drake.agent.representation.neighbours import neighbour_edges, one_ring
from selftouch_drake.agent.shape.cells import Cells

#: Largest area of a piece, over the area of the cells around it. Cut from 1.5 times that area on,
#: not from twice, worn tori have wider margins.
_LARGEST = 0.75

#: Fewest configurations per piece, on average: its width cannot be measured with fewer.
_LEAST_SIZE = 20


def cut_wide_cells(
    coordinates: np.ndarray, offsets: np.ndarray, cells: Cells
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cuts each cell at least 1.5 times as large as those around it into pieces.

    k-means in the cell's own tangent plane finds the pieces.

    Args:
        coordinates: `(R, D)` of a quotient map, grouped by kernel.
        offsets: `(K + 1,)` of the kernels.
        cells: of these.

    Returns:
        `(R, D)` the same rows grouped by piece, `(P + 1,)` offsets of the pieces, and `(P,)` the
        kernel of each piece, ascending.
    """
    sizes = np.diff(offsets)
    number = np.minimum((_times_larger(cells) / _LARGEST).astype(int), sizes // _LEAST_SIZE)
    if number.max() < 2:
        return coordinates, offsets, np.arange(len(sizes))
    piece = np.zeros(len(coordinates), dtype=int)
    for kernel in np.flatnonzero(number > 1):
        rows = slice(offsets[kernel], offsets[kernel + 1])
        along = (coordinates[rows] - cells.mean[kernel]) @ cells.tangent[kernel]
        piece[rows] = clusters(along, number[kernel])
    owner = np.repeat(np.arange(len(sizes)), sizes)
    order = np.lexsort((piece, owner))
    first = np.flatnonzero(np.diff(owner, prepend=-1) | np.diff(piece[order], prepend=-1))
    return coordinates[order], np.append(first, len(coordinates)), owner[first]


def _times_larger(cells: Cells) -> np.ndarray:
    """`(K,)` area of each cell over the median area of itself and two rings of neighbours."""
    ring = one_ring(neighbour_edges(cells.distances()), len(cells.area))
    rings = (ring @ ring).tocsr()
    typical = [
        np.median(cells.area[rings.indices[start:stop]])
        for start, stop in pairwise(rings.indptr.tolist())
    ]
    return cells.area / np.array(typical)
