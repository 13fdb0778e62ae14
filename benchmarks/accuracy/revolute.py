"""A reference that is not naive: quotient coordinates found by knowing that all joints turn.

The fingertip position of an arm with revolute joints is a sum of products of 1, cos q and sin q,
one factor per joint. Linear discriminants of all these products find it without further learning.
"""

from __future__ import annotations

import numpy as np

from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.shape.metrics import Progress, between_cells
from selftouch_drake.agent.shape.quotient_map import discriminants
from selftouch_drake.quotient.kernels import KernelSets
from selftouch_drake.quotient.lengths import BodyGraph

#: Most configurations per kernel; more do not change the discriminants of 729 products.
_MAX_ROWS = 150
_MAX_PRODUCTS = 3**7

#: A position has three coordinates. On a torus with a million touches, three explain the position
#: (0.1 % is left over). A fourth varied little within kernels, but was not one, and bent the shape.
_NUM_COORDINATES = 3


def revolute_reference(
    representation: QuotientRepresentation, skin: int, seed: int, progress: Progress
) -> BodyGraph:
    """A shape metric: neighbours and lengths in these coordinates."""
    sets = KernelSets(representation.kernel_q, representation.kernel_offsets)
    return between_cells(revolute_coordinates(sets), skin)


def revolute_coordinates(sets: KernelSets) -> KernelSets:
    """Finds quotient coordinates among the products of 1, cos q and sin q.

    Args:
        sets: K sets of configurations, rad.

    Returns:
        Some of the configurations of each set in `(M, 3)` coordinates, in cell widths.

    Raises:
        ValueError: there are more than 7 joints.
    """
    num_joints = sets.x.shape[1]
    if 3**num_joints > _MAX_PRODUCTS:
        raise ValueError(f"q has {num_joints} joints, more than the 7 of the revolute reference")
    sizes = np.minimum(sets.sizes, _MAX_ROWS)
    rows = np.concatenate(
        [
            start + (np.arange(size) * (stop - start)) // size
            for start, stop, size in zip(sets.offsets, sets.offsets[1:], sizes, strict=False)
        ]
    )
    products = np.ones((len(rows), 1), dtype=np.float32)
    for angle in sets.x[rows].astype(np.float32).T:
        factors = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
        products = (products[:, :, None] * factors[:, None, :]).reshape(len(rows), -1)
    # The first product is constant.
    some = KernelSets(products[:, 1:], np.concatenate([[0], np.cumsum(sizes)]))
    found = discriminants(some)
    found = found.at(found.x[:, :_NUM_COORDINATES])
    # Cells are equally wide in all directions: in their widths, a flat body stays flat.
    middle = np.add.reduceat(found.x, found.offsets[:-1]) / sizes[:, None]
    return found.at(found.x / (found.x - np.repeat(middle, sizes, axis=0)).std(axis=0))
