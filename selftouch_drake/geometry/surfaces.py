"""Closed surfaces, evenly triangulated and watertight.

Shapes are centred on the origin of their frame; a mesh file keeps its own frame.
"""

import math
import warnings
from os import PathLike
from pathlib import Path

import numpy as np

from selftouch_drake.geometry.closing import SimplifiedWarning, closed_surface
from selftouch_drake.geometry.hollow import point_text
from selftouch_drake.geometry.solids import from_manifold, to_manifold
from selftouch_drake.geometry.triangles import first_self_intersection
from selftouch_drake.lazy import trimesh

MESH_SUFFIXES = (".obj", ".ply", ".stl")

# Ten times as many as a torso at 2 cm has, and 300,000 tetrahedra. A mesh in millimetres would need
# a million times more, and fill the memory before an error could be shown.
MAX_TRIANGLES = 50_000

# A mesh is simplified if it has more than this multiple of the triangles that its resolution needs.
MOST_DETAIL = 4

# m, largest distance from the origin: beyond it, rounding merges vertices.
_FARTHEST = 1e6


def sphere(radius: float, *, resolution: float = 0.02) -> trimesh.Trimesh:
    """Returns a sphere of `radius` m, with edges of about `resolution` m."""
    _require_lengths(radius=radius, resolution=resolution)
    return ellipsoid((radius, radius, radius), resolution=resolution)


def ellipsoid(
    semi_axes: tuple[float, float, float], *, resolution: float = 0.02
) -> trimesh.Trimesh:
    """Returns an ellipsoid with `semi_axes` m along x, y and z, edges of about `resolution` m."""
    _require_lengths(semi_axes=semi_axes, resolution=resolution)
    # Knud Thomsen's formula gives the area of an ellipsoid within 1.1 %.
    a, b, c = (axis**1.6075 for axis in semi_axes)
    area = 4 * math.pi * ((a * b + b * c + c * a) / 3) ** (1 / 1.6075)
    # 20 n^2 equilateral triangles with edges as long as the resolution cover that area.
    pieces = max(round(math.sqrt(area / (20 * _equilateral_area(resolution)))), 2)
    _require_triangles(20 * pieces**2, resolution)
    surface = _split_edges(trimesh.creation.icosahedron(), pieces=pieces)
    directions = surface.vertices / np.linalg.norm(surface.vertices, axis=1, keepdims=True)
    return trimesh.Trimesh(directions * semi_axes, surface.faces, process=False)


def cube(side: float, *, resolution: float = 0.02) -> trimesh.Trimesh:
    """Returns a cube with edges of `side` m, a regular grid of `resolution` m on each face."""
    _require_lengths(side=side, resolution=resolution)
    pieces = max(round(side / resolution), 1)
    _require_triangles(12 * pieces**2, resolution)
    return _split_edges(trimesh.creation.box(extents=(side, side, side)), pieces=pieces)


def torus(major_radius: float, minor_radius: float, *, resolution: float = 0.02) -> trimesh.Trimesh:
    """Returns a torus about the z axis, with edges of about `resolution` m.

    The major radius, m, is from the origin to the centre of the tube, the minor one that of the
    tube.

    Raises:
        ValueError: If a length is not positive, or the tube closes the hole.
    """
    _require_lengths(major_radius=major_radius, minor_radius=minor_radius, resolution=resolution)
    if minor_radius >= major_radius:
        raise ValueError(
            f"surface.minor_radius is {minor_radius:g} m, which closes the hole of a torus with "
            f"surface.major_radius {major_radius:g} m; make it smaller"
        )
    # Multiples of four keep the extreme points, and so the bounding box, exact.
    around, across = (
        4 * max(round(math.pi / 2 * radius / resolution), 1)
        for radius in (major_radius, minor_radius)
    )
    _require_triangles(2 * around * across, resolution)
    return _clean(
        trimesh.creation.torus(
            major_radius, minor_radius, major_sections=around, minor_sections=across
        )
    )


def cylinder(radius: float, height: float, *, resolution: float = 0.02) -> trimesh.Trimesh:
    """Returns a cylinder of `radius` m and `height` m along z, with sharp rims."""
    _require_lengths(radius=radius, height=height, resolution=resolution)
    # A hexagonal prism with equilateral caps and nearly square sides, all edges split equally; its
    # concentric hexagons are then stretched into circles.
    pieces = max(round(math.pi / 3 * radius / resolution), 1)
    rows = max(round(height / resolution / pieces), 1)
    _require_triangles(12 * (rows + 1) * pieces**2, resolution)
    z = np.linspace(-height / 2, height / 2, rows + 1)
    profile = [(0, z[0]), *((radius, level) for level in z), (0, z[-1])]
    prism = _split_edges(trimesh.creation.revolve(profile, sections=6), pieces=pieces)
    normals = (np.arange(6) + 0.5) * math.pi / 3
    apothem = radius * math.cos(math.pi / 6)
    xy = prism.vertices[:, :2]
    ring = (xy @ np.stack([np.cos(normals), np.sin(normals)])).max(axis=1) / apothem
    distance = np.maximum(np.linalg.norm(xy, axis=1), 1e-12 * radius)
    vertices = prism.vertices.copy()
    vertices[:, :2] *= (radius * ring / distance)[:, None]
    return trimesh.Trimesh(vertices, prism.faces, process=False)


def capsule(radius: float, length: float, *, resolution: float = 0.02) -> trimesh.Trimesh:
    """Returns a capsule along z: a cylinder between two half spheres of `radius` m.

    Their centres are `length` m apart, and edges are of about `resolution` m.

    Raises:
        ValueError: If a length is not positive, or the triangles are too many.
    """
    _require_lengths(radius=radius, length=length, resolution=resolution)
    # A sphere has 20 n^2 equilateral triangles; if n is even, edges run along its equator.
    sphere_triangles = 4 * math.pi * radius**2 / _equilateral_area(resolution)
    pieces = 2 * max(round(math.sqrt(sphere_triangles / 20) / 2), 1)
    around = 5 * pieces
    # Each row of equilateral triangles is shifted by half an edge relative to the row below.
    turn = math.pi / around
    rows = max(round(length / (math.sqrt(3) * radius * turn)), 1)
    _require_triangles(20 * pieces**2 + 2 * around * rows, resolution)
    cap, cap_faces = _half_sphere(pieces)
    angles = turn * (2 * np.arange(around) + np.arange(rows + 1)[:, None])
    levels = np.linspace(-length / 2, length / 2, rows + 1)[:, None]
    side = [radius * np.cos(angles), radius * np.sin(angles), np.broadcast_to(levels, angles.shape)]
    i, j = np.arange(around), np.roll(np.arange(around), -1)
    row = np.concatenate([[i, j, i + around], [j, j + around, i + around]], axis=1).T
    side_faces = (row + around * np.arange(rows)[:, None, None]).reshape(-1, 3)
    # The equator is the first ring of each cap; it is dropped, since the side has these vertices.
    last_turn = trimesh.transformations.rotation_matrix(rows * turn, (0, 0, 1))[:3, :3]
    upper = radius * cap[around:] @ last_turn.T + (0, 0, length / 2)
    lower = radius * cap[around:] * (1, 1, -1) - (0, 0, length / 2)
    num_side = around * (rows + 1)
    upper_faces = cap_faces + num_side - around
    lower_faces = np.where(cap_faces < around, 0, num_side + len(upper) - around) + cap_faces
    return trimesh.Trimesh(
        np.concatenate([np.stack(side, axis=-1).reshape(-1, 3), upper, lower]),
        np.concatenate([side_faces, upper_faces, lower_faces[:, ::-1]]),
        process=False,
    )


def _half_sphere(pieces: int) -> tuple[np.ndarray, np.ndarray]:
    """Half a unit sphere above z = 0, its edges split into an even number of `pieces`.

    Returns `(V, 3)` vertices, first the `5 * pieces` on the equator, evenly spaced from the x axis;
    and `(F, 3)` faces, outward.
    """
    angles = 2 * math.pi / 5 * (np.arange(10) % 5 + 0.5 * (np.arange(10) >= 5) - 0.25)
    ring = 2 / math.sqrt(5) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    heights = np.repeat([1, -1], 5)[:, None] / math.sqrt(5)
    vertices = np.concatenate([[(0, 0, 1)], np.hstack([ring, heights]), [(0, 0, -1)]])
    k, n = np.arange(1, 6), np.roll(np.arange(1, 6), -1)
    bands = [(0 * k, k, n), (k, k + 5, n), (k + 5, n + 5, n), (0 * k + 11, n + 5, k + 5)]
    coarse = trimesh.Trimesh(vertices, np.concatenate(bands, axis=1).T, process=False)
    sphere = _split_edges(coarse, pieces=pieces)
    directions = sphere.vertices / np.linalg.norm(sphere.vertices, axis=1, keepdims=True)
    faces = sphere.faces[directions[sphere.faces, 2].mean(axis=1) > 0]
    step = 2 * math.pi / (5 * pieces)
    on_equator = np.flatnonzero(np.abs(directions[:, 2]) < 1e-9)
    place = np.round(np.arctan2(*directions[on_equator, 1::-1].T) / step).astype(int)
    on_equator = on_equator[np.argsort(place % (5 * pieces))]
    # Splitting flat triangles leaves the angles on the equator slightly uneven.
    even = step * np.arange(5 * pieces)
    directions[on_equator] = np.stack([np.cos(even), np.sin(even), 0 * even], axis=1)
    above = np.setdiff1d(np.unique(faces), on_equator)
    order = np.concatenate([on_equator, above])
    new = np.empty(len(directions), dtype=int)
    new[order] = np.arange(len(order))
    return directions[order], new[faces]


def mesh_file(
    path: str | PathLike[str], *, resolution: float = 0.02, scale: float = 1.0
) -> trimesh.Trimesh:
    """Reads a closed surface from a mesh file and adapts its triangles to `resolution`.

    The mesh keeps its frame. If all triangles face inwards, they are flipped. Longer edges are
    split; a dense scan is simplified, with a `SimplifiedWarning`.

    Args:
        path: An `.obj`, `.ply` or `.stl` file.
        resolution: m; longer edges are split into 0.7 to 1.4 times this length.
        scale: m, length of one unit of the file: 0.001 for millimetres.

    Raises:
        ValueError: If the file is missing, unreadable, empty, open, in several pieces, not
            orientable, self-intersecting, or too large to be in metres.
    """
    _require_lengths(resolution=resolution, scale=scale)
    path = Path(path)
    surface = _outward(_read(path, scale), path)
    num_triangles = surface.area / _equilateral_area(resolution)
    if num_triangles > MAX_TRIANGLES:
        raise ValueError(
            f"surface.mesh {path} is {surface.extents.max():g} m across, which makes "
            f"{num_triangles:.0f} triangles at {resolution:g} m; set surface.scale, or a coarser "
            "surface.resolution"
        )
    if len(surface.faces) > MOST_DETAIL * num_triangles:
        dense, surface = surface, closed_surface([surface], resolution=resolution)
        warnings.warn(
            f"surface.mesh {path} was simplified from {len(dense.faces)} to {len(surface.faces)} "
            f"triangles, for edges of {resolution:g} m",
            SimplifiedWarning,
            stacklevel=2,
        )
    else:
        manifold = to_manifold(surface)
        for _ in range(3):  # The first split leaves longer edges inside large triangles.
            manifold = manifold.refine_to_length(1.4 * resolution)
        surface = from_manifold(manifold)
    crossing = first_self_intersection(surface.vertices, surface.faces)
    if crossing is not None:
        raise ValueError(
            f"surface.mesh {path} intersects itself near {point_text(crossing)} m; "
            "repair it so that its surface never crosses itself"
        )
    return surface


def _outward(surface: trimesh.Trimesh, path: Path) -> trimesh.Trimesh:
    """Turns all triangles of a surface outwards; a ValueError if it encloses no single solid."""
    if not surface.is_watertight:
        raise ValueError(f"surface.mesh {path} is open; close its holes so that it is watertight")
    if surface.body_count != 1:
        raise ValueError(f"surface.mesh {path} has {surface.body_count} pieces; join them into one")
    if not surface.is_winding_consistent:
        trimesh.repair.fix_winding(surface)
    if surface.volume < 0:
        surface.invert()
    if not (surface.is_winding_consistent and surface.volume > 0):
        raise ValueError(f"surface.mesh {path} has no inside; orient all its triangles outwards")
    return surface


def _read(path: Path, scale: float) -> trimesh.Trimesh:
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise ValueError(
            f"surface.mesh {path} is not one of {', '.join(MESH_SUFFIXES)}; convert it"
        )
    if not path.is_file():
        raise ValueError(f"surface.mesh {path} does not exist; give the path of a mesh file")
    try:
        surface = trimesh.load_mesh(path, process=False)
    except Exception as error:  # Each of trimesh's readers fails in its own way.
        raise ValueError(
            f"surface.mesh {path} cannot be read ({error}); export it again"
        ) from error
    if not isinstance(surface, trimesh.Trimesh) or surface.is_empty:
        raise ValueError(f"surface.mesh {path} has no triangles; export it again as triangles")
    if not np.isfinite(surface.vertices).all():
        raise ValueError(f"surface.mesh {path} has vertices that are not finite; export it again")
    surface.vertices = surface.vertices * scale
    if (reach := np.abs(surface.vertices).max()) > _FARTHEST:
        raise ValueError(
            f"surface.mesh {path} reaches {reach:g} m from its origin; give its unit as "
            "surface.scale, in metres"
        )
    if surface.faces.min() < 0 or surface.faces.max() >= len(surface.vertices):
        raise ValueError(f"surface.mesh {path} has triangles without corners; export it again")
    try:
        return _clean(surface)
    except (ValueError, ArithmeticError, LookupError) as error:
        raise ValueError(
            f"surface.mesh {path} is not a surface ({error}); export it again"
        ) from error


def _clean(surface: trimesh.Trimesh) -> trimesh.Trimesh:
    """Returns the bare geometry, with vertices merged and without flat triangles."""
    surface = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    surface.merge_vertices()
    surface.update_faces(surface.nondegenerate_faces())
    surface.remove_unreferenced_vertices()
    return surface


def _split_edges(surface: trimesh.Trimesh, *, pieces: int) -> trimesh.Trimesh:
    return from_manifold(to_manifold(surface).refine(pieces))


def _equilateral_area(edge: float) -> float:
    return math.sqrt(3) / 4 * edge**2


def _require_lengths(**lengths: float | tuple[float, ...]) -> None:
    for name, value in lengths.items():
        if not all(math.isfinite(length) and length > 0 for length in np.atleast_1d(value)):
            raise ValueError(f"surface.{name} is {value}; give positive lengths in metres")


def _require_triangles(num_triangles: float, resolution: float) -> None:
    if num_triangles > MAX_TRIANGLES:
        raise ValueError(
            f"surface.resolution {resolution:g} m cuts it into {num_triangles:.0f} triangles, "
            f"more than {MAX_TRIANGLES}; give a coarser resolution, and all lengths in metres"
        )
