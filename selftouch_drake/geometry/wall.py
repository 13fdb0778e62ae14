"""Samples the wall of a skin."""

from __future__ import annotations

import numpy as np

from selftouch_drake.geometry.hollow import HollowSkin
from selftouch_drake.lazy import trimesh


def wall_points(skin: HollowSkin, spacing: float) -> np.ndarray:
    """Points on the outer, middle and inner layer of a skin's wall.

    In a triangle with edges up to e, every point is within e / sqrt(3) of a corner. So every point
    of a layer is that near to a sample, with e = `spacing`.

    Args:
        skin: In its link's frame L.
        spacing: m, the longest edge between neighbouring points of a layer.

    Returns:
        `(N, 3)` m, in the link's frame.
    """
    num_vertices = len(skin.vertices)
    layers = np.concatenate([skin.faces + layer * num_vertices for layer in range(3)])
    points, _ = trimesh.remesh.subdivide_to_size(skin.tet_vertices, layers, max_edge=spacing)
    return points
