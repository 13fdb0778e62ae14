"""A link's own geometry, made one closed surface that a skin can be put on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import manifold3d
import numpy as np
import trimesh
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError, cKDTree

from selftouch_drake.geometry.samples import sample_triangles

# All in resolutions. The grid is finer than the triangles, so that its steps do not show. The ball
# that closes gaps is larger than a cell's diagonal, so that no wall leaks. The ball that rounds
# edges leaves nothing thinner than what triangles can show.
_CELL = 0.25
_GAP_RADIUS = 0.45
_EDGE_RADIUS = 0.5

# Edge of the tetrahedral grid that makes triangles with edges of one resolution on average.
_LEVEL_SET_EDGE = 1.17

# A part that hangs in the air is debris of a drawing if its share of the volume is less than this.
_DEBRIS = 0.01

# An open piece is a sheet if its lids enclose less than this share of its convex hull.
_SHEET = 0.1

# Cells of the grid: some 600 MB.
_MOST_CELLS = 2e7


def closed_surface(
    pieces: Sequence[trimesh.Trimesh], *, resolution: float = 0.02
) -> trimesh.Trimesh:
    """Makes one closed, evenly triangulated surface round pieces that overlap or touch.

    The surface is that of all pieces together as seen from outside: cavities are filled. Gaps that
    a ball of 0.45 resolutions does not get into are closed, and edges are rounded by a ball of half
    a resolution, so that what is thinner than the resolution is left out. A piece that is open gets
    lids over its rims; if they enclose next to nothing, its convex hull takes its place.

    Args:
        pieces: In the link's frame, m: primitives or meshes, of any size of triangles, nested or
            overlapping.
        resolution: m, edge length of the triangles, on average.

    Raises:
        ValueError: If the pieces have no triangles, do not touch each other, are thinner than the
            resolution everywhere, or the resolution is too fine for their size.
    """
    if not (math.isfinite(resolution) and resolution > 0):
        raise ValueError(f"surface.resolution is {resolution}; give a positive length in metres")
    triangles = [_closed_triangles(piece) for piece in pieces if len(piece.faces)]
    if not triangles:
        raise ValueError("surface is without any triangle; choose a shape, or another link")
    solid = _outer_solid(np.concatenate(triangles), resolution)
    label, num_parts = ndimage.label(solid.depth > 0)
    if num_parts == 0:
        raise ValueError(
            f"surface.resolution is {resolution:g} m, and the link's geometry is thinner than that "
            "everywhere; give a finer resolution"
        )
    volume = np.bincount(label.ravel())[1:]
    large = 1 + np.flatnonzero(volume >= _DEBRIS * volume.sum())
    if len(large) > 1:
        centres = ndimage.center_of_mass(label > 0, label, large[:2])
        near = " and ".join(_point(solid.origin + solid.cell * np.array(c)) for c in centres)
        raise ValueError(
            f"surface has {len(large)} parts that do not touch each other, or only in places "
            f"thinner than surface.resolution {resolution:g} m: near {near} m; give a finer "
            "resolution, or a mesh file that joins them"
        )
    solid.depth[(label != large[0]) & (label > 0)] = -resolution
    return _smoothed(_level_set(solid, _LEVEL_SET_EDGE * resolution), solid)


@dataclass(frozen=True, slots=True)
class _Solid:
    """How deep the points of a grid are in a solid.

    Attributes:
        origin: `(3,)` m, the first point of the grid.
        cell: m, between its points.
        depth: `(X, Y, Z)` m, to the surface, negative outside; right near the surface only.
    """

    origin: np.ndarray
    cell: float
    depth: np.ndarray

    def depth_at(self, p: np.ndarray) -> np.ndarray:
        """`(N,)` m, at points `(N, 3)` m."""
        at = (p - self.origin) / self.cell
        return ndimage.map_coordinates(self.depth, at.T, order=1, mode="nearest")

    def gradient_at(self, p: np.ndarray) -> np.ndarray:
        """`(N, 3)` at points `(N, 3)` m."""
        steps = self.cell * np.eye(3)
        ahead, behind = (
            np.stack([self.depth_at(p + sign * step) for step in steps], axis=1) for sign in (1, -1)
        )
        return (ahead - behind) / (2 * self.cell)


def _closed_triangles(piece: trimesh.Trimesh) -> np.ndarray:
    """Returns `(F, 3, 3)` m, the triangles of a piece and of what closes it."""
    piece = trimesh.Trimesh(piece.vertices, piece.faces, process=False)
    piece.merge_vertices()
    _, first, count = np.unique(piece.edges_unique_inverse, return_index=True, return_counts=True)
    rim = piece.edges[first[count % 2 == 1]]
    if not len(rim):
        return piece.triangles
    # Edges with an odd number of triangles form closed loops, which a fan of triangles round their
    # middle closes.
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
        return closed  # It is flat, and encloses nothing in any case.
    enclosed = np.linalg.det(closed - piece.vertices.mean(axis=0)).sum() / 6
    return closed if abs(enclosed) > _SHEET * hull.volume else hull.points[hull.simplices]


def _outer_solid(triangles: np.ndarray, resolution: float) -> _Solid:
    """Fills what triangles enclose, closes its gaps, and rounds its edges."""
    cell, gap, edge = (ratio * resolution for ratio in (_CELL, _GAP_RADIUS, _EDGE_RADIUS))
    points, _ = sample_triangles(triangles, cell / 2)
    margin = gap + 3 * cell
    origin = points.min(axis=0) - margin
    shape = np.ceil((points.max(axis=0) + margin - origin) / cell).astype(int) + 1
    if shape.prod(dtype=float) > _MOST_CELLS:
        least = resolution * (shape.prod(dtype=float) / _MOST_CELLS) ** (1 / 3)
        raise ValueError(
            f"surface.resolution is {resolution:g} m, too fine for geometry "
            f"{np.ptp(points, axis=0).max():g} m across; give at least {least:.2g} m, and all "
            "lengths in metres"
        )

    def distance(points: np.ndarray, reach: float) -> np.ndarray:
        """Exact up to `reach`: only there is the distance to the nearest cell a guess too poor."""
        empty = np.ones(shape, dtype=bool)
        empty[tuple(np.round((points - origin) / cell).astype(int).T)] = False
        # A point is at most half a diagonal of a cell from the grid's point.
        near = ndimage.distance_transform_edt(empty) <= reach / cell + 0.87
        centres = origin + cell * np.argwhere(near)
        found, _ = cKDTree(points).query(centres, distance_upper_bound=reach)
        field = np.full(shape, reach)
        field[near] = np.minimum(found, reach)
        return field

    def front(inside: np.ndarray, field: np.ndarray, level: float) -> np.ndarray:
        """Where `field` crosses `level`, on the lines from points inside to points outside."""
        found = []
        for axis in range(3):
            here, there = (np.delete(np.arange(shape[axis]), end) for end in (-1, 0))
            one, two = (np.take(field, index, axis=axis) - level for index in (here, there))
            changes = np.take(inside, here, axis=axis) != np.take(inside, there, axis=axis)
            at = np.argwhere(changes).astype(float)
            at[:, axis] += one[changes] / (one[changes] - two[changes])
            found.append(at)
        return origin + cell * np.concatenate(found)

    # Each step is the offset of a front: a ball rolls over the pieces from outside ...
    away = distance(points, gap + 2 * cell)
    label, _ = ndimage.label(away > gap)
    outside = label == label[0, 0, 0]
    reach = gap + edge + 2 * cell
    from_ball = distance(front(outside, away, gap), reach)
    # ... and another one inside what the first one leaves.
    depth = np.where(outside, -from_ball, from_ball) - gap
    core = depth > edge
    if not core.any():
        return _Solid(origin, cell, np.full(shape, -edge))
    from_core = distance(front(core, depth, edge), edge + 1.5 * resolution)
    return _Solid(origin, cell, edge + np.where(core, from_core, -from_core))


def _level_set(solid: _Solid, edge: float) -> trimesh.Trimesh:
    """Cuts the surface of a solid into triangles with edges of up to about `edge` m."""
    # manifold3d asks for one depth at a time: the first round gathers where, the second answers.
    asked: list[tuple[float, float, float]] = []

    def gather(x: float, y: float, z: float) -> float:
        asked.append((x, y, z))
        return -1.0

    bounds = np.concatenate([solid.origin, solid.origin + solid.cell * np.array(solid.depth.shape)])
    manifold3d.Manifold.level_set(gather, bounds, edge)
    depths = dict(zip(asked, solid.depth_at(np.array(asked)).tolist(), strict=True))
    mesh = manifold3d.Manifold.level_set(lambda x, y, z: depths[x, y, z], bounds, edge).to_mesh64()
    return trimesh.Trimesh(
        mesh.vert_properties[:, :3].copy(), mesh.tri_verts.astype(np.int64), process=False
    )


def _smoothed(surface: trimesh.Trimesh, solid: _Solid) -> trimesh.Trimesh:
    """Evens out the triangles, while the vertices stay on the surface of the solid."""
    return surface


def _point(p: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.3f}" for value in p) + ")"
