"""Cuts wide cells into pieces, so that the body is sampled evenly.

Target sensations are evenly spaced. Where receptors are missing, a wide stretch of skin feels alike
and becomes one kernel. That leaves a gap in the layout, and a false loop around it. But a quotient
map is smooth, and separates the motor configurations within such a kernel.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from selftouch_drake.agent.clusters import clusters
from selftouch_drake.agent.representation.kernels import KernelSets
from selftouch_drake.agent.representation.neighbours import neighbour_edges, one_ring
from selftouch_drake.agent.shape.cells import Cells

#: Largest area of a piece, over the area of the cells around it. Cut from 1.5 times that area on,
#: not from twice, worn tori have wider margins.
_LARGEST = 0.75

#: Fewest configurations per piece, on average: its width cannot be measured with fewer.
_LEAST_SIZE = 20


def cut_wide_cells(sets: KernelSets, cells: Cells) -> tuple[KernelSets, np.ndarray]:
    """Cuts each cell at least 1.5 times as large as those around it into pieces.

    k-means in the cell's own tangent plane finds the pieces.

    Args:
        sets: K sets in coordinates of a quotient map.
        cells: of these.

    Returns:
        The same coordinates as P sets, one for each piece, and `(P,)` the kernel of each piece,
        ascending.
    """
    sizes = sets.sizes
    number = np.minimum((_times_larger(cells) / _LARGEST).astype(int), sizes // _LEAST_SIZE)
    if number.max() < 2:
        return sets, np.arange(len(sizes))
    piece = np.zeros(len(sets.x), dtype=int)
    for kernel in np.flatnonzero(number > 1).tolist():
        along = (sets.members(kernel) - cells.mean[kernel]) @ cells.tangent[kernel]
        rows = slice(*sets.offsets[kernel : kernel + 2])
        piece[rows] = clusters(along, number[kernel])
    owner = sets.kernel
    order = np.lexsort((piece, owner))
    first = np.flatnonzero(np.diff(owner, prepend=-1) | np.diff(piece[order], prepend=-1))
    return KernelSets(sets.x[order], np.append(first, len(order))), owner[first]


def _times_larger(cells: Cells) -> np.ndarray:
    """`(K,)` area of each cell over the median area of itself and two rings of neighbours."""
    ring = one_ring(neighbour_edges(cells.distances()), len(cells.area))
    rings = (ring @ ring).tocsr()
    typical = [
        np.median(cells.area[rings.indices[start:stop]])
        for start, stop in pairwise(rings.indptr.tolist())
    ]
    return cells.area / np.array(typical)
