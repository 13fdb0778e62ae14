"""Turns the geometry of a link into one closed surface that can wear a skin."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from selftouch_drake.geometry.hollow import hollow_skin, point_text
from selftouch_drake.geometry.solid import rounded_solid, triangulated
from selftouch_drake.lazy import ndimage, trimesh

# In units of the resolution: cells of the grid, so small that their steps do not show; the ball
# that closes gaps; and the ball that rounds edges, so that triangles can follow them.
_CELL = 1 / 3
_GAP_RADIUS = 0.7
_EDGE_RADIUS = 0.7

# In units of the skin's thickness: under a surface rounded this much, inner walls do not meet.
_ROOM = 1.25

# Factors on the balls' radii in further tries: triangles follow the surface only in steps.
_WIDER = (1.3, 1.6)

# A detached part with less than this share of the volume is debris of the drawing.
_DEBRIS = 0.01

# An open piece is a sheet if, closed by lids, it encloses less than this share of its convex hull.
_SHEET = 0.1

# Share of the volume that a surface must keep; below it, the user is warned.
_MOSTLY_KEPT = 0.9


class SimplifiedWarning(UserWarning):
    """A surface has less detail than the mesh it was made from."""


def closed_surface(
    pieces: Sequence[trimesh.Trimesh], *, resolution: float = 0.02, thickness: float = 0.0
) -> trimesh.Trimesh:
    """Makes one closed, evenly triangulated surface around pieces that overlap or touch.

    This is the outer surface of all pieces together: cavities are filled. Two balls with a radius
    of 0.7 times the resolution roll over it. The outer one closes gaps that it does not fit into.
    The inner one rounds edges, and removes parts thinner than itself. For a thick skin its radius
    is at least 1.25 times the thickness, so that the skin fits. An open piece gets lids over its
    rims; if it still encloses next to nothing, its convex hull replaces it.

    Args:
        pieces: In the link's frame, m: primitives or meshes with triangles of any size, nested or
            overlapping.
        resolution: m, edge length of the triangles; their mean is 0.8 to 1 times as long.
        thickness: m, of the skin that must fit under the surface; 0 without skin.

    Raises:
        ValueError: If the pieces have no triangles, do not touch each other, are thinner than the
            ball everywhere, or the resolution is too fine for their size.

    Warns:
        SimplifiedWarning: If more than a tenth of the volume was removed.
    """
    if not (math.isfinite(resolution) and resolution > 0):
        raise ValueError(f"surface.resolution is {resolution}; give a positive length in metres")
    triangles = [_closed_triangles(piece) for piece in pieces if len(piece.faces)]
    if not triangles:
        raise ValueError("surface has no triangles; choose a shape, or another link")
    surface, share = _rounded_surface(np.concatenate(triangles), resolution, thickness, 1.0)
    for wider in _WIDER:
        if thickness == 0 or _fits(surface, thickness):
            break
        try:
            surface, share = _rounded_surface(
                np.concatenate(triangles), resolution, thickness, wider
            )
        except ValueError:
            break  # More rounding would split the surface.
    if share < _MOSTLY_KEPT:
        skin = f" and a skin of {thickness:g} m" if thickness else ""
        warnings.warn(
            f"surface keeps {share:.0%} of the volume of the link's geometry: the rest is in parts "
            f"too thin for triangles of {resolution:g} m{skin}",
            SimplifiedWarning,
            stacklevel=2,
        )
    return surface


def _rounded_surface(
    triangles: np.ndarray, resolution: float, thickness: float, wider: float
) -> tuple[trimesh.Trimesh, float]:
    """Surface around closed triangles `(F, 3, 3)`, and the share of the volume that it keeps."""
    edge = wider * max(_EDGE_RADIUS * resolution, _ROOM * thickness)
    gap = wider * _GAP_RADIUS * resolution
    solid = rounded_solid(triangles, _CELL * resolution, gap=gap, edge=edge)
    label, num_parts = ndimage.label(solid.depth > 0)
    if num_parts == 0:
        raise ValueError(
            f"surface is thinner than {2 * edge:.3g} m everywhere, too thin for triangles of "
            f"{resolution:g} m and a skin of {thickness:g} m; give a finer surface.resolution, or "
            "a thinner skin"
        )
    volume = np.bincount(label.ravel())[1:]
    large = 1 + np.flatnonzero(volume >= _DEBRIS * volume.sum())
    if len(large) > 1:
        centres = ndimage.center_of_mass(label > 0, label, large[:2])
        near = " and ".join(point_text(solid.origin + solid.cell * np.array(c)) for c in centres)
        raise ValueError(
            f"surface has {len(large)} parts that do not touch each other, or only where they are "
            f"thinner than {2 * edge:.3g} m: near {near} m; give a mesh file that joins them, or a "
            "finer resolution"
        )
    solid.depth[(label != large[0]) & (label > 0)] = -resolution
    return triangulated(solid, resolution), solid.share


def _fits(surface: trimesh.Trimesh, thickness: float) -> bool:
    try:
        hollow_skin(surface, thickness, None)
    except ValueError:
        return False
    return True


def _closed_triangles(piece: trimesh.Trimesh) -> np.ndarray:
    """Returns `(F, 3, 3)` m, the triangles of a piece and of the lids that close it."""
    piece = trimesh.Trimesh(piece.vertices, piece.faces, process=False)
    piece.merge_vertices()
    _, first, count = np.unique(piece.edges_unique_inverse, return_index=True, return_counts=True)
    rim = piece.edges[first[count % 2 == 1]]
    if not len(rim):
        return piece.triangles
    # Edges with an odd number of triangles form closed loops. A fan of triangles around its middle
    # closes each.
    shape = (len(piece.vertices), len(piece.vertices))
    graph = coo_array((np.ones(len(rim)), tuple(rim.T)), shape=shape)
    _, loop = connected_components(graph, directed=False)
    _, loop = np.unique(loop[rim[:, 0]], return_inverse=True)
    ends = piece.vertices[rim]
    sums = np.zeros((loop.max() + 1, 3))
    np.add.at(sums, loop, ends.mean(axis=1))
    middles = sums / np.bincount(loop)[:, None]
    lids = np.stack([ends[:, 1], ends[:, 0], middles[loop]], axis=1)
    closed = np.concatenate([piece.triangles, lids])
    try:
        hull = ConvexHull(piece.vertices)
    except QhullError:
        return closed  # It is flat, and encloses nothing anyway.
    enclosed = np.linalg.det(closed - piece.vertices.mean(axis=0)).sum() / 6
    return closed if abs(enclosed) > _SHEET * hull.volume else hull.points[hull.simplices]
