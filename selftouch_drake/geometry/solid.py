"""A solid as a depth field on a grid: rounded by rolling balls, and triangulated evenly."""

from __future__ import annotations

from dataclasses import dataclass

import manifold3d
import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.geometry.geodesics import neighbouring_vertices
from selftouch_drake.geometry.triangles import sample_triangles
from selftouch_drake.lazy import ndimage, trimesh

# Most cells of a grid: about 600 MB.
_MOST_CELLS = 2e7

# Edge of the tetrahedral grid, in mean edges of the triangles that it makes.
_LEVEL_SET_EDGE = 1.17

# Rounds in which each vertex moves half-way to the mean of its neighbours.
_RELAXATIONS = 10


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

    def gradient_at(self, p: np.ndarray) -> np.ndarray:
        """`(N, 3)` gradient of the depth at points `(N, 3)` m."""
        steps = self.cell * np.eye(3)
        ahead, behind = (
            np.stack([self.depth_at(p + sign * step) for step in steps], axis=1) for sign in (1, -1)
        )
        return (ahead - behind) / (2 * self.cell)


def rounded_solid(triangles: np.ndarray, cell: float, *, gap: float, edge: float) -> Solid:
    """Fills the volume that triangles enclose, closes its gaps, and rounds its edges.

    Balls roll over the surface: one outside, one inside the result, and one outside again. Parts
    that the inner ball does not fit into are removed.

    Args:
        triangles: `(F, 3, 3)` m, closed.
        cell: m, of the grid.
        gap: m, radius of the outer ball; larger than a cell, or walls would leak.
        edge: m, radius of the inner ball.

    Raises:
        ValueError: If the grid would be too large.
    """
    corners = triangles.reshape(-1, 3)
    margin = gap + 3 * cell
    origin = corners.min(axis=0) - margin
    shape = np.ceil((corners.max(axis=0) + margin - origin) / cell).astype(int) + 1
    if shape.prod(dtype=float) > _MOST_CELLS:
        raise ValueError(
            f"surface.resolution is too fine for geometry {np.ptp(corners, axis=0).max():g} m "
            f"across: it needs {shape.prod(dtype=float):.1g} cells; give a coarser one, and "
            "all lengths in metres"
        )

    def distance(points: np.ndarray, reach: float) -> np.ndarray:
        """`(X, Y, Z)` m, distance from the grid to the nearest of `points`, up to `reach`."""
        empty = np.ones(shape, dtype=bool)
        empty[tuple(np.round((points - origin) / cell).astype(int).T)] = False
        # A point is at most half the diagonal of a cell from the nearest grid point.
        near = ndimage.distance_transform_edt(empty) <= reach / cell + 0.87
        found, _ = cKDTree(points).query(
            origin + cell * np.argwhere(near), distance_upper_bound=reach
        )
        field = np.full(shape, reach)
        field[near] = np.minimum(found, reach)
        return field

    def depth_below(
        inside: np.ndarray, field: np.ndarray, level: float, reach: float
    ) -> np.ndarray:
        """`(X, Y, Z)` m, depth below the surface around `inside` where `field` is `level`."""
        front = []
        for axis in range(3):
            here, there = (np.delete(np.arange(shape[axis]), end) for end in (-1, 0))
            one, two = (np.take(field, index, axis=axis) - level for index in (here, there))
            crosses = np.take(inside, here, axis=axis) != np.take(inside, there, axis=axis)
            at = np.argwhere(crosses).astype(float)
            at[:, axis] += one[crosses] / (one[crosses] - two[crosses])
            front.append(origin + cell * at)
        found = distance(np.concatenate(front), reach)
        return np.where(inside, found, -found)

    points, _ = sample_triangles(triangles, cell / 2)
    away = distance(points, gap + 2 * cell)
    inside = ~_joined_to_outside(away > gap)
    depth = depth_below(inside, away, gap, gap + edge + 2 * cell) - gap
    whole = np.count_nonzero(depth > 0)
    if not (depth > edge).any():
        return Solid(origin=origin, cell=cell, depth=np.full(shape, -edge), share=0.0)
    depth = depth_below(depth > edge, depth, edge, edge + gap + 2 * cell) + edge
    # Triangulation reads the depth this far on either side, for triangles of five cells.
    depth = depth_below(depth > -gap, depth, -gap, gap + 5 * cell) - gap
    depth = np.where(_joined_to_outside(depth <= 0), depth, np.abs(depth))
    return Solid(origin=origin, cell=cell, depth=depth, share=np.count_nonzero(depth > 0) / whole)


def _joined_to_outside(free: np.ndarray) -> np.ndarray:
    """`(X, Y, Z)` whether a grid point is free and connected to the first one."""
    label, _ = ndimage.label(free)
    return label == label[0, 0, 0]


def triangulated(solid: Solid, edge: float) -> trimesh.Trimesh:
    """Triangulates the surface of a solid evenly, with edges of about `edge` m."""
    return _relaxed(_level_set(solid, _LEVEL_SET_EDGE * edge), solid)


def _level_set(solid: Solid, edge: float) -> trimesh.Trimesh:
    # manifold3d asks for one depth at a time: the first call collects the points, the second
    # answers.
    asked: list[tuple[float, float, float]] = []

    def gather(x: float, y: float, z: float) -> float:
        asked.append((x, y, z))
        return -1.0

    bounds = np.concatenate([solid.origin, solid.origin + solid.cell * np.array(solid.depth.shape)])
    manifold3d.Manifold.level_set(gather, bounds, edge)
    depths = dict(zip(asked, solid.depth_at(np.array(asked)).tolist(), strict=True))
    return from_manifold(
        manifold3d.Manifold.level_set(lambda x, y, z: depths[x, y, z], bounds, edge)
    )


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
    p = np.array(surface.vertices)
    for _ in range(_RELAXATIONS):
        p = (p + edges @ p / num_neighbours) / 2
        for _ in range(2):
            gradient = solid.gradient_at(p)
            slope = np.einsum("ni,ni->n", gradient, gradient)
            # In a crease the gradient is nearly zero: this bounds the steps.
            p -= (solid.depth_at(p) / np.maximum(slope, 0.25))[:, None] * gradient
    return trimesh.Trimesh(p, surface.faces, process=False)
