"""Triangles in space with colours: surfaces, balls, rods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.colors import to_rgb

from selftouch_drake.lazy import trimesh

# Cosine of the angle between faces beyond which they meet in an edge, not in a smooth bend.
EDGE = 0.85


@dataclass(frozen=True, slots=True)
class ColoredMesh:
    """Triangles with colours.

    Attributes:
        triangles: `(N, 3, 3)` corners.
        normals: `(N, 3)` unit vectors, outward.
        rgb: `(N, 3)` before light falls on it.
    """

    triangles: np.ndarray
    normals: np.ndarray
    rgb: np.ndarray

    def both_sides(self) -> ColoredMesh:
        """The same as a sheet that is seen from both sides."""
        return ColoredMesh(
            np.tile(self.triangles, (2, 1, 1)),
            np.concatenate([self.normals, -self.normals]),
            np.tile(self.rgb, (2, 1)),
        )


def surface(
    vertices: np.ndarray, faces: np.ndarray, color: str | np.ndarray, *, cuts: int = 0
) -> ColoredMesh:
    """A triangle surface.

    Args:
        vertices: `(V, 3)`.
        faces: `(F, 3)` indices, outward by the right hand.
        color: one for all, or `(V, 3)` RGB.
        cuts: how often each triangle is cut into four, with normals and colours between those of
            its corners: a coarse surface looks smooth and stays where it is.
    """
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    rgb = np.broadcast_to(to_rgb(color) if isinstance(color, str) else color, np.shape(vertices))
    flat, smooth = mesh.face_normals[:, None], mesh.vertex_normals[mesh.faces]
    is_edge = (flat * smooth).sum(axis=2, keepdims=True) < EDGE
    corners = np.concatenate(
        [mesh.triangles, np.where(is_edge, flat, smooth), rgb[mesh.faces]], axis=2
    )
    for _ in range(cuts):
        corners = _cut(corners)
    triangles, normals, rgb = np.split(corners, 3, axis=2)
    normals = normals.mean(axis=1)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return ColoredMesh(triangles, normals, rgb.mean(axis=1))


def shell(vertices: np.ndarray, faces: np.ndarray, color: str, max_edge: float) -> ColoredMesh:
    """A surface of any triangles, cut until their edges are short enough to be sorted by depth.

    Args:
        vertices: `(V, 3)`.
        faces: `(F, 3)` indices, outward by the right hand.
        color: of all.
        max_edge: longest edge.
    """
    # No corner is shared: each triangle keeps the normal of the face that it was cut from.
    corners = np.asarray(vertices)[faces].reshape(-1, 3)
    normals = np.cross(corners[1::3] - corners[::3], corners[2::3] - corners[::3])
    area = np.linalg.norm(normals, axis=1)
    cut, triangles, face = trimesh.remesh.subdivide_to_size(
        corners[np.repeat(area > 0, 3)],
        np.arange(3 * np.count_nonzero(area)).reshape(-1, 3),
        max_edge=max_edge,
        return_index=True,
    )
    outward = (normals[area > 0] / area[area > 0, None])[face]
    return ColoredMesh(cut[triangles], outward, np.broadcast_to(to_rgb(color), outward.shape))


def balls(
    centres: np.ndarray, radius: float | np.ndarray, color: str | np.ndarray, *, detail: int = 2
) -> ColoredMesh:
    """Spheres round `centres` `(N, 3)`, of one radius or `(N,)`, in one colour or `(N, 3)` RGB."""
    ball = trimesh.creation.icosphere(subdivisions=detail)
    corners = np.asarray(ball.triangles)
    rgb = np.broadcast_to(to_rgb(color) if isinstance(color, str) else color, centres.shape)
    radii = np.broadcast_to(radius, len(centres))[:, None, None, None]
    return ColoredMesh(
        (centres[:, None, None] + radii * corners).reshape(-1, 3, 3),
        np.tile(np.asarray(ball.face_normals), (len(centres), 1)),
        np.repeat(rgb, len(corners), axis=0),
    )


def rod(start: np.ndarray, end: np.ndarray, radius: float, color: str) -> ColoredMesh:
    """A round rod between two points `(3,)`, cut short enough to be sorted by depth."""
    mesh = trimesh.creation.cylinder(radius, segment=np.stack([start, end]), sections=24)
    return shell(mesh.vertices, mesh.faces, color, max_edge=radius)


def _cut(corners: np.ndarray) -> np.ndarray:
    """Cuts `(F, 3, C)` triangles into four each, what they carry halfway between corners."""
    a, b, c = corners.transpose(1, 0, 2)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(part, axis=1) for part in parts])
