"""A reference that is not naive: quotient coordinates found by knowing that all joints turn.

The fingertip position of an arm with revolute joints is a sum of products of 1, cos q and sin q,
one factor per joint. Linear discriminants of all these products find it without further learning.
"""

from __future__ import annotations

import numpy as np

from selftouch_drake.agent.shape.quotient_map import discriminants

#: Most configurations per kernel; more do not change the discriminants of 729 products.
_MAX_ROWS = 150
_MAX_PRODUCTS = 3**7

#: A position has three coordinates. On a torus with a million touches, three explain the position
#: (0.1 % is left over). A fourth varied little within kernels, but was not one, and bent the shape.
_NUM_COORDINATES = 3


def revolute_coordinates(
    kernel_q: np.ndarray, kernel_offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Finds quotient coordinates among the products of 1, cos q and sin q.

    Args:
        kernel_q: `(R, J)` rad, grouped by kernel.
        kernel_offsets: `(K + 1,)` kernel k owns rows `kernel_offsets[k]:kernel_offsets[k + 1]`.

    Returns:
        `(M, 3)` coordinates of some of the configurations, in cell widths, and `(K + 1,)` their
        offsets.

    Raises:
        ValueError: there are more than 7 joints.
    """
    if 3 ** kernel_q.shape[1] > _MAX_PRODUCTS:
        raise ValueError(
            f"q has {kernel_q.shape[1]} joints, more than the 7 of the revolute reference: choose "
            "the learned metric"
        )
    sizes = np.minimum(np.diff(kernel_offsets), _MAX_ROWS)
    rows = np.concatenate(
        [
            start + (np.arange(size) * (stop - start)) // size
            for start, stop, size in zip(kernel_offsets, kernel_offsets[1:], sizes, strict=False)
        ]
    )
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    products = np.ones((len(rows), 1), dtype=np.float32)
    for angle in kernel_q[rows].astype(np.float32).T:
        factors = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
        products = (products[:, :, None] * factors[:, None, :]).reshape(len(rows), -1)
    # The first product is constant.
    found = discriminants(products[:, 1:], offsets, max_directions=_NUM_COORDINATES)
    # Cells are equally wide in all directions: in their widths, a flat body stays flat.
    middle = np.add.reduceat(found, offsets[:-1]) / sizes[:, None]
    return found / (found - np.repeat(middle, sizes, axis=0)).std(axis=0), offsets
