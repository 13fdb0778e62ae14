"""Turns the geometry of a link into one closed surface that can wear a skin.

Geometry with sharp edges is united exactly, and keeps them. Where that gives no surface that a skin
fits under, and where all is round, the volume that the geometry encloses becomes a depth field on a
grid, is rounded by rolling balls, and triangulated evenly.
"""

import math
import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Self

import manifold3d
import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.geometry.geodesics import neighbouring_vertices
from selftouch_drake.geometry.hollow import hollow_skin, point_text
from selftouch_drake.geometry.remeshing import SHARP, even_triangles, has_sharp_edges
from selftouch_drake.geometry.solids import (
    DEBRIS,
    Pieces,
    closed_pieces,
    from_manifold,
)
from selftouch_drake.geometry.triangles import first_self_intersection, sample_triangles
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

# Share of the area and of the volume that a surface must keep; otherwise the user is warned.
_AREA_KEPT, _VOLUME_KEPT = 0.98, 0.9
# Tries to keep the area of round geometry by shorter edges, and the loss that they aim at. The loss
# of a surface of flat triangles grows with the square of their edges.
_FINER, _AIM = 3, 0.015

# Rounds of repairing the wall below a sharp surface: more take seconds, and hardly ever help.
_SHARP_MENDINGS = 3
# A triangle with less than this share of the mean area is flat.
_FLAT = 1e-6
# Detail of sharp geometry below this share of the edge length is left out.
_DETAIL = 0.01
# A sharp surface has at most as many sharp edges as this share of the triangles that its area
# needs, and some more: a mesh with more has detail that such triangles cannot show.
_MOST_DETAIL, _SOME_DETAIL = 1, 1000

# Most cells of a grid: about 600 MB.
_MOST_CELLS = 2e7

# Edge of the tetrahedral grid, in mean edges of the triangles that it makes.
_LEVEL_SET_EDGE = 1.17

# Rounds in which each vertex moves half-way to the mean of its neighbours.
_RELAXATIONS = 10


class SimplifiedWarning(UserWarning):
    """A surface has less detail than the mesh it was made from."""


class RepairedWarning(UserWarning):
    """The mesh that a surface was made from had holes, or faced inwards."""


def closed_surface(
    pieces: Sequence[trimesh.Trimesh],
    *,
    resolution: float = 0.02,
    thickness: float = 0.0,
    sharp: bool = True,
) -> trimesh.Trimesh:
    """Makes one closed surface around pieces that overlap or touch, with the area that they have.

    This is the outer surface of all pieces together: cavities are filled. An open piece gets lids
    over its rims; if it still encloses next to nothing, its convex hull replaces it. Pieces that
    face inwards are turned.

    Sharp edges stay sharp. Round geometry is triangulated evenly, with shorter edges where the
    area asks for them. Both lose at most 2 % of the area.

    Otherwise the surface is rounded, and the user is told what that costs: where the skin would not
    fit, where pieces do not quite touch, where the mesh has much finer detail than the resolution.
    Two balls with a radius of 0.7 times the resolution roll over it. The outer one closes gaps that
    it does not fit into. The inner one rounds edges, and removes parts thinner than itself. For a
    thick skin its radius is at least 1.25 times the thickness, so that the skin fits.

    Args:
        pieces: In the link's frame, m: primitives or meshes with triangles of any size, nested or
            overlapping.
        resolution: m, edge length of the triangles; the mean is 0.7 to 1 times as long, and
            shorter on round geometry that is small.
        thickness: m, of the skin that must fit under the surface; 0 without skin.
        sharp: Whether to keep sharp edges and area; False to round in any case.

    Raises:
        ValueError: If the pieces have no triangles, do not touch each other, are thinner than the
            ball everywhere, or the resolution is too fine for their size.

    Warns:
        SimplifiedWarning: If more than 2 % of the area or a tenth of the volume was lost.
        RepairedWarning: If the pieces had holes, or faced inwards.
    """
    if not (math.isfinite(resolution) and resolution > 0):
        raise ValueError(f"surface.resolution is {resolution}; give a positive length in metres")
    closed = closed_pieces(pieces)
    if closed.remarks:
        warnings.warn(f"surface: {'; '.join(closed.remarks)}", RepairedWarning, stacklevel=2)
    solid = closed.solid if sharp else None
    if solid is None:
        surface, share = _fitting_surface(closed.triangles, resolution, thickness)
    elif not has_sharp_edges(from_manifold(solid)):
        surface, share = _round_surface(closed, resolution, thickness)
    else:
        exact = _sharp_surface(solid, resolution, thickness)
        if exact is not None:
            return exact
        surface, share = _fitting_surface(closed.triangles, resolution, thickness)
    _warn_of_loss(surface, share, closed.area if sharp else None, resolution, thickness)
    return surface


def _sharp_surface(
    solid: manifold3d.Manifold, resolution: float, thickness: float
) -> trimesh.Trimesh | None:
    """The surface of a solid with its edges; None if it has too much detail, or no skin fits."""
    area, edge = solid.surface_area(), resolution
    if area / _equilateral_area(resolution) > _MOST_CELLS:
        return None
    misfits = 0
    for _ in range(1 + _FINER):
        plain = solid.simplify(_DETAIL * edge)
        if _num_sharp(plain) > _MOST_DETAIL * area / _equilateral_area(edge) + _SOME_DETAIL:
            return None
        surface = even_triangles(from_manifold(plain), edge)
        lost = 1 - surface.area / area
        if lost <= 1 - _AREA_KEPT:
            if _is_sound(surface, thickness):
                return surface
            # A skin that does not fit under coarse triangles may fit under finer ones.
            misfits += 1
            if misfits == 2:
                return None
        edge *= np.clip(math.sqrt(_AIM / max(lost, 1e-9)), 0.5, 0.7)
    return None


def _num_sharp(solid: manifold3d.Manifold) -> int:
    return int((from_manifold(solid).face_adjacency_angles > SHARP).sum())


def _is_sound(surface: trimesh.Trimesh, thickness: float) -> bool:
    """Whether a surface is closed, does not cross itself, and a skin fits under it."""
    if not surface.is_volume or surface.area_faces.min() <= _FLAT * surface.area_faces.mean():
        return False
    if not thickness:
        return first_self_intersection(surface.vertices, surface.faces) is None
    try:
        hollow_skin(surface, thickness, mendings=_SHARP_MENDINGS)
    except ValueError:
        return False
    return True


def _equilateral_area(edge: float) -> float:
    return math.sqrt(3) / 4 * edge**2


def _round_surface(
    closed: Pieces, resolution: float, thickness: float
) -> tuple[trimesh.Trimesh, float]:
    """The even surface of round pieces, with edges so short that it keeps their area."""
    edge, best, refusal = resolution, None, None
    for _ in range(1 + _FINER):
        try:
            best = surface, _ = _fitting_surface(closed.triangles, edge, thickness)
        except ValueError as error:
            if best is not None:
                break
            refusal, edge = error, edge / 2  # It may be too thin for edges of this length only.
            continue
        lost = 0.0 if closed.area is None else 1 - surface.area / closed.area
        if lost <= 1 - _AREA_KEPT:
            break
        edge *= max(math.sqrt(_AIM / lost), 0.5)
    if best is None:
        assert refusal is not None
        raise refusal
    return best


def _fitting_surface(
    triangles: np.ndarray, resolution: float, thickness: float
) -> tuple[trimesh.Trimesh, float]:
    """The rounded surface that a skin fits under, and the share of the volume that it keeps."""
    surface, share = _rounded_surface(triangles, resolution, thickness, 1.0)
    for wider in _WIDER if thickness else ():
        with suppress(ValueError):
            hollow_skin(surface, thickness)
            break  # The skin fits.
        try:
            surface, share = _rounded_surface(triangles, resolution, thickness, wider)
        except ValueError:
            break  # More rounding would split the surface.
    return surface, share


def _warn_of_loss(
    surface: trimesh.Trimesh,
    share: float,
    area: float | None,
    resolution: float,
    thickness: float,
) -> None:
    kept = 1.0 if area is None else surface.area / area
    if share >= _VOLUME_KEPT and kept >= _AREA_KEPT:
        return
    skin = f" and a skin of {thickness:g} m" if thickness else ""
    of_area = "" if area is None else f" and {kept:.0%} of the area"
    warnings.warn(
        f"surface keeps {share:.0%} of the volume{of_area} of the link's geometry: the rest is in "
        f"edges and parts too thin for triangles of {resolution:g} m{skin}; give a finer "
        f"surface.resolution{', or a thinner skin' if thickness else ''}",
        SimplifiedWarning,
        stacklevel=3,
    )


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
    large = 1 + np.flatnonzero(volume >= DEBRIS * volume.sum())
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
