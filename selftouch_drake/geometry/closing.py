"""Turns the geometry of a link into one closed surface that can wear a skin.

The volume that the geometry encloses becomes a depth field on a grid, is rounded by rolling balls,
and triangulated evenly.
"""

import math
import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Self

import manifold3d
import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from selftouch_drake.geometry.geodesics import neighbouring_vertices
from selftouch_drake.geometry.hollow import hollow_skin, point_text
from selftouch_drake.geometry.triangles import sample_triangles
from selftouch_drake.lazy import ndimage, trimesh

# In units of the resolution: the cells of the grid, so small that their steps do not show.
_CELL = 1 / 3
# Likewise: the radius of the ball that closes gaps.
_GAP_RADIUS = 0.7
# Likewise: the radius of the ball that rounds edges, so that triangles can follow them.
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

# Most cells of a grid: about 600 MB.
_MOST_CELLS = 2e7

# Edge of the tetrahedral grid, in mean edges of the triangles that it makes.
_LEVEL_SET_EDGE = 1.17

# Rounds in which each vertex moves half-way to the mean of its neighbours.
_RELAXATIONS = 10


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
    closed = [_closed_triangles(piece) for piece in pieces if len(piece.faces)]
    if not closed:
        raise ValueError("surface has no triangles; choose a shape, or another link")
    triangles = np.concatenate(closed)
    surface, share = _rounded_surface(triangles, resolution, thickness, 1.0)
    for wider in _WIDER if thickness else ():
        with suppress(ValueError):
            hollow_skin(surface, thickness)
            break  # The skin fits.
        try:
            surface, share = _rounded_surface(triangles, resolution, thickness, wider)
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
    part = trimesh.graph.connected_component_labels(rim, len(piece.vertices))
    _, loop = np.unique(part[rim[:, 0]], return_inverse=True)
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Solid:
    """Depth of the points of a grid in a solid.

    Attributes:
        origin: `(3,)` m, the first point of the grid.
        cell: m, between its points.
        depth: `(X, Y, Z)` m, below the surface, negative outside; valid only near the surface.
        share: of the volume that is left after the edges were rounded.
    """

    origin: np.ndarray
    cell: float
    depth: np.ndarray
    share: float

    def depth_at(self, p: np.ndarray) -> np.ndarray:
        """`(N,)` m, depth at points `(N, 3)` m."""
        at = (p - self.origin) / self.cell
        return ndimage.map_coordinates(self.depth, at.T, order=1, mode="nearest")


def rounded_solid(triangles: np.ndarray, cell: float, *, gap: float, edge: float) -> Solid:
    """Fills the volume that triangles enclose, closes its gaps, and rounds its edges.

    Balls roll over the surface: one outside, one inside the result, and one outside again. Parts
    that the inner ball does not fit into are removed.

    The `(F, 3, 3)` triangles are closed. The radius of the outer ball, `gap`, is larger than a cell
    of the grid, or walls would leak; that of the inner ball is `edge`; all in m.

    Raises:
        ValueError: If the grid would be too large.
    """
    corners = triangles.reshape(-1, 3)
    grid = _Grid.around(corners, cell, margin=gap + 3 * cell)
    points, _ = sample_triangles(triangles, cell / 2)
    away = grid.distance(points, gap + 2 * cell)
    inside = ~_joined_to_outside(away > gap)
    depth = grid.depth_below(inside, away, gap, gap + edge + 2 * cell) - gap
    whole = np.count_nonzero(depth > 0)
    if not (depth > edge).any():
        nothing = np.full(grid.shape, -edge)
        return Solid(origin=grid.origin, cell=cell, depth=nothing, share=0.0)
    depth = grid.depth_below(depth > edge, depth, edge, edge + gap + 2 * cell) + edge
    # Triangulation reads the depth this far on either side, for triangles of five cells.
    depth = grid.depth_below(depth > -gap, depth, -gap, gap + 5 * cell) - gap
    depth = np.where(_joined_to_outside(depth <= 0), depth, np.abs(depth))
    share = np.count_nonzero(depth > 0) / whole
    return Solid(origin=grid.origin, cell=cell, depth=depth, share=share)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Grid:
    """The points of a grid.

    Attributes:
        origin: `(3,)` m, the first point.
        cell: m, between its points.
        shape: `(3,)` numbers of points along the axes.
    """

    origin: np.ndarray
    cell: float
    shape: np.ndarray

    @classmethod
    def around(cls, points: np.ndarray, cell: float, *, margin: float) -> Self:
        """A grid around `(N, 3)` points and a margin, m.

        Raises:
            ValueError: It would be too large.
        """
        origin = points.min(axis=0) - margin
        shape = np.ceil((points.max(axis=0) + margin - origin) / cell).astype(int) + 1
        if shape.prod(dtype=float) > _MOST_CELLS:
            raise ValueError(
                f"surface.resolution is too fine for geometry {np.ptp(points, axis=0).max():g} m "
                f"across: it needs {shape.prod(dtype=float):.1g} cells; give a coarser one, and "
                "all lengths in metres"
            )
        return cls(origin=origin, cell=cell, shape=shape)

    def distance(self, points: np.ndarray, reach: float) -> np.ndarray:
        """`(X, Y, Z)` m, distance from the grid to the nearest of `points`, up to `reach`."""
        empty = np.ones(self.shape, dtype=bool)
        empty[tuple(np.round((points - self.origin) / self.cell).astype(int).T)] = False
        # A point is at most half the diagonal of a cell from the nearest grid point.
        near = ndimage.distance_transform_edt(empty) <= reach / self.cell + 0.87
        found, _ = cKDTree(points).query(
            self.origin + self.cell * np.argwhere(near), distance_upper_bound=reach
        )
        field = np.full(self.shape, reach)
        field[near] = np.minimum(found, reach)
        return field

    def depth_below(
        self, inside: np.ndarray, field: np.ndarray, level: float, reach: float
    ) -> np.ndarray:
        """`(X, Y, Z)` m, depth below the surface around `inside` where `field` is `level`."""
        surface = np.concatenate([self._crossings(axis, inside, field, level) for axis in range(3)])
        found = self.distance(surface, reach)
        return np.where(inside, found, -found)

    def _crossings(
        self, axis: int, inside: np.ndarray, field: np.ndarray, level: float
    ) -> np.ndarray:
        """`(N, 3)` m, where lines along an axis cross the surface around `inside`."""
        here, there = (np.delete(np.arange(self.shape[axis]), end) for end in (-1, 0))
        one, other = (np.take(field, index, axis=axis) - level for index in (here, there))
        crosses = np.take(inside, here, axis=axis) != np.take(inside, there, axis=axis)
        at = np.argwhere(crosses).astype(float)
        at[:, axis] += one[crosses] / (one[crosses] - other[crosses])
        return self.origin + self.cell * at


def _joined_to_outside(free: np.ndarray) -> np.ndarray:
    """`(X, Y, Z)` whether a grid point is free and connected to the first one."""
    label, _ = ndimage.label(free)
    return label == label[0, 0, 0]


def triangulated(solid: Solid, edge: float) -> trimesh.Trimesh:
    """Triangulates the surface of a solid evenly, with edges of about `edge` m."""
    edge = _LEVEL_SET_EDGE * edge
    # manifold3d asks for one depth at a time: the first call collects the points, the second
    # answers.
    asked: list[tuple[float, float, float]] = []

    def gather(x: float, y: float, z: float) -> float:
        asked.append((x, y, z))
        return -1.0

    bounds = np.concatenate([solid.origin, solid.origin + solid.cell * np.array(solid.depth.shape)])
    manifold3d.Manifold.level_set(gather, bounds, edge)
    depths = dict(zip(asked, solid.depth_at(np.array(asked)).tolist(), strict=True))
    level_set = manifold3d.Manifold.level_set(lambda x, y, z: depths[x, y, z], bounds, edge)
    return _relaxed(from_manifold(level_set), solid)


def from_manifold(manifold: manifold3d.Manifold) -> trimesh.Trimesh:
    """The surface of a solid of manifold3d."""
    mesh = manifold.to_mesh64()
    # A copy: a view would keep manifold3d's mesh alive, which warns when Python exits.
    vertices = mesh.vert_properties[:, :3].copy()
    return trimesh.Trimesh(vertices, mesh.tri_verts.astype(np.int64), process=False)


def _relaxed(surface: trimesh.Trimesh, solid: Solid) -> trimesh.Trimesh:
    """Evens out the triangles while keeping their vertices on the surface of the solid."""
    edges = neighbouring_vertices(surface)
    num_neighbours = edges.sum(axis=1)[:, None]
    p, steps = np.array(surface.vertices), solid.cell * np.eye(3)
    for _ in range(_RELAXATIONS):
        p = (p + edges @ p / num_neighbours) / 2
        for _ in range(2):
            ahead, behind = (
                np.stack([solid.depth_at(p + step) for step in sign * steps], axis=1)
                for sign in (1, -1)
            )
            gradient = (ahead - behind) / (2 * solid.cell)
            slope = np.einsum("ni,ni->n", gradient, gradient)
            # In a crease the gradient is nearly zero: this bounds the steps.
            p -= (solid.depth_at(p) / np.maximum(slope, 0.25))[:, None] * gradient
    return trimesh.Trimesh(p, surface.faces, process=False)
