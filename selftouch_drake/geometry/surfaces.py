"""Closed outer surfaces of a body: evenly triangulated, watertight, centred on its origin."""

from __future__ import annotations

import math
from os import PathLike
from pathlib import Path

import manifold3d
import numpy as np
import trimesh

from selftouch_drake.geometry.intersections import first_self_intersection

MESH_SUFFIXES = (".obj", ".ply", ".stl")

# Ten times a standard body at 2 cm, and 300,000 tetrahedra. A mesh in millimetres asks for a
# million times more, and would fill the memory before anybody could read why.
MAX_TRIANGLES = 50_000

# m: beyond it, vertices are not told apart.
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
    # Knud Thomsen's formula: the area of an ellipsoid within 1.1 %.
    a, b, c = (axis**1.6075 for axis in semi_axes)
    area = 4 * math.pi * ((a * b + b * c + c * a) / 3) ** (1 / 1.6075)
    # 20 n^2 equilateral triangles with edges as long as the resolution cover that area.
    pieces = max(round(math.sqrt(area / (20 * _equilateral_area(resolution)))), 2)
    _require_triangles(20 * pieces**2, resolution)
    surface = _split_edges(trimesh.creation.icosahedron(), pieces=pieces)
    directions = surface.vertices / np.linalg.norm(surface.vertices, axis=1, keepdims=True)
    return _mesh(directions * semi_axes, surface.faces)


def cube(side: float, *, resolution: float = 0.02) -> trimesh.Trimesh:
    """Returns a cube with edges of `side` m, a regular grid of `resolution` m on each face."""
    _require_lengths(side=side, resolution=resolution)
    pieces = max(round(side / resolution), 1)
    _require_triangles(12 * pieces**2, resolution)
    return _split_edges(trimesh.creation.box(extents=(side, side, side)), pieces=pieces)


def torus(major_radius: float, minor_radius: float, *, resolution: float = 0.02) -> trimesh.Trimesh:
    """Returns a torus about the z axis.

    Args:
        major_radius: m, from the centre of the body to the centre of the tube.
        minor_radius: m, of the tube; less than `major_radius`.
        resolution: m, edge length of the triangles, on average.

    Raises:
        ValueError: If a length is not positive, or the tube closes the hole.
    """
    _require_lengths(major_radius=major_radius, minor_radius=minor_radius, resolution=resolution)
    if minor_radius >= major_radius:
        raise ValueError(
            f"body.minor_radius is {minor_radius:g} m, which closes the hole of a torus with "
            f"body.major_radius {major_radius:g} m; make it smaller"
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
    # A hexagonal prism of equilateral caps and nearly square sides, all edges cut alike; its
    # concentric hexagons then grow into circles.
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
    return _mesh(vertices, prism.faces)


def mesh_file(path: str | PathLike[str], *, resolution: float = 0.02) -> trimesh.Trimesh:
    """Reads a closed surface from a mesh file in metres, and splits its longer edges.

    The body's origin is the centre of the bounding box. Triangles that all look inwards are
    turned over.

    Args:
        path: An `.obj`, `.ply` or `.stl` file.
        resolution: m, to which longer edges are cut, into 0.7 to 1.4 times as much.

    Raises:
        ValueError: If the file is missing, unreadable, empty, open, in several pieces, not
            orientable, self-intersecting, too large to be in metres, or too dense.
    """
    _require_lengths(resolution=resolution)
    path = Path(path)
    surface = _read(path)
    if not surface.is_watertight:
        raise ValueError(f"body.mesh {path} is open; close its holes so that it is watertight")
    if surface.body_count != 1:
        raise ValueError(f"body.mesh {path} has {surface.body_count} pieces; join them into one")
    if not surface.is_winding_consistent:
        trimesh.repair.fix_winding(surface)
    if surface.volume < 0:
        surface.invert()
    if not (surface.is_winding_consistent and surface.volume > 0):
        raise ValueError(f"body.mesh {path} has no inside; orient all its triangles outwards")
    num_triangles = surface.area / _equilateral_area(resolution)
    if num_triangles > MAX_TRIANGLES:
        raise ValueError(
            f"body.mesh {path} is {surface.extents.max():g} m across, which makes "
            f"{num_triangles:.0f} triangles at {resolution:g} m; give it in metres"
        )
    if len(surface.faces) > MAX_TRIANGLES:
        raise ValueError(
            f"body.mesh {path} has {len(surface.faces)} triangles, more than {MAX_TRIANGLES}; "
            f"decimate it to about {num_triangles:.0f}"
        )
    surface.apply_translation(-surface.bounds.mean(axis=0))
    manifold = _to_manifold(surface)
    for _ in range(3):  # The first cut leaves longer edges inside large triangles.
        manifold = manifold.refine_to_length(1.4 * resolution)
    surface = _from_manifold(manifold)
    crossing = first_self_intersection(surface.vertices, surface.faces)
    if crossing is not None:
        raise ValueError(
            f"body.mesh {path} intersects itself near {_point(crossing)} m from its centre; "
            "repair it so that its surface never crosses itself"
        )
    return surface


def _read(path: Path) -> trimesh.Trimesh:
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise ValueError(f"body.mesh {path} is not one of {', '.join(MESH_SUFFIXES)}; convert it")
    if not path.is_file():
        raise ValueError(f"body.mesh {path} does not exist; give the path of a mesh file")
    try:
        surface = trimesh.load_mesh(path, process=False)
    except Exception as error:  # Each of trimesh's readers fails in its own way.
        raise ValueError(f"body.mesh {path} cannot be read ({error}); export it again") from error
    if not isinstance(surface, trimesh.Trimesh) or surface.is_empty:
        raise ValueError(f"body.mesh {path} has no triangles; export it again as triangles")
    if not np.isfinite(surface.vertices).all():
        raise ValueError(f"body.mesh {path} has vertices that are not finite; export it again")
    if (reach := np.abs(surface.vertices).max()) > _FARTHEST:
        raise ValueError(f"body.mesh {path} reaches {reach:g} m from its origin; give it in metres")
    if surface.faces.min() < 0 or surface.faces.max() >= len(surface.vertices):
        raise ValueError(f"body.mesh {path} has triangles without corners; export it again")
    try:
        return _clean(surface)
    except (ValueError, ArithmeticError, LookupError) as error:
        raise ValueError(f"body.mesh {path} is no surface ({error}); export it again") from error


def _clean(surface: trimesh.Trimesh) -> trimesh.Trimesh:
    """Returns the bare geometry, with vertices merged and without flat triangles."""
    surface = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    surface.merge_vertices()
    surface.update_faces(surface.nondegenerate_faces())
    surface.remove_unreferenced_vertices()
    return surface


def _mesh(vertices: np.ndarray, faces: np.ndarray) -> trimesh.Trimesh:
    return trimesh.Trimesh(vertices, faces, process=False)


def _split_edges(surface: trimesh.Trimesh, *, pieces: int) -> trimesh.Trimesh:
    return _from_manifold(_to_manifold(surface).refine(pieces))


def _to_manifold(surface: trimesh.Trimesh) -> manifold3d.Manifold:
    # The 64-bit mesh: single precision would move a face of a cube by 1e-8 m.
    return manifold3d.Manifold(
        manifold3d.Mesh64(
            np.ascontiguousarray(surface.vertices, dtype=np.float64),
            np.ascontiguousarray(surface.faces, dtype=np.uint64),
        )
    )


def _from_manifold(manifold: manifold3d.Manifold) -> trimesh.Trimesh:
    mesh = manifold.to_mesh64()
    # A copy: a view would keep manifold3d's mesh alive, which complains when Python ends.
    return _mesh(mesh.vert_properties[:, :3].copy(), mesh.tri_verts.astype(np.int64))


def _equilateral_area(edge: float) -> float:
    return math.sqrt(3) / 4 * edge**2


def _require_lengths(**lengths: float | tuple[float, ...]) -> None:
    for name, value in lengths.items():
        if not all(math.isfinite(length) and length > 0 for length in np.atleast_1d(value)):
            raise ValueError(f"body.{name} is {value}; give positive lengths in metres")


def _require_triangles(num_triangles: float, resolution: float) -> None:
    if num_triangles > MAX_TRIANGLES:
        raise ValueError(
            f"body.resolution {resolution:g} m cuts this body into {num_triangles:.0f} triangles, "
            f"more than {MAX_TRIANGLES}; give a coarser resolution, and all lengths in metres"
        )


def _point(p: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.3f}" for value in p) + ")"
