"""The surface of a part of the skin as a triangle mesh, and receptors on it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.body_model.support import bulge
from selftouch_drake.agent.shape.surface import fitted_surface
from selftouch_drake.export.fine_surface import fitted_to_touches, rim
from selftouch_drake.lazy import trimesh as lazy_trimesh
from selftouch_drake.quotient.holes import topology

if TYPE_CHECKING:
    import trimesh

# Fewer places make no surface.
_FEWEST = 12
# Subdivisions of an icosahedron for a toucher: 320 triangles.
_TOUCHER_DETAIL = 2
# Vertices near a receptor, about which the nearest place of a surface is.
_ABOUT = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartSurface:
    """The surface of a part, in the frame of its link.

    Attributes:
        mesh: where the toucher's centre is when touches begin, or on average if that is unknown.
        below: how deep under it the centre passes on average.
    """

    mesh: "trimesh.Trimesh"
    below: float = 0.0

    def raised(self, depth: float) -> "trimesh.Trimesh":
        """The skin, if the toucher's centre passes so deep under it; negative if outside."""
        vertices = self.mesh.vertices + (depth - self.below) * self.mesh.vertex_normals
        return lazy_trimesh.Trimesh(vertices, self.mesh.faces, process=False)

    def similar(self, *, metres: float = 1.0, mirrored: bool = False) -> "PartSurface":
        """The same with all lengths multiplied, and mirrored in the plane x = 0 if asked."""
        vertices = metres * self.mesh.vertices * [-1.0 if mirrored else 1.0, 1.0, 1.0]
        faces = self.mesh.faces[:, ::-1] if mirrored else self.mesh.faces
        mesh = lazy_trimesh.Trimesh(vertices, faces, process=False)
        return PartSurface(mesh=mesh, below=metres * self.below)

    def nearest(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`(n, 3)` where on average the centre passes nearest to places, and outward normals.

        Beyond a rim the surface goes on as a plane does: receptors lie where no toucher came.
        """
        mesh = self.raised(0.0)
        about = cKDTree(mesh.vertices).query(places, min(_ABOUT, len(mesh.vertices)))[1]
        faces = mesh.vertex_faces[about].reshape(len(places), -1)
        num = faces.shape[1]
        on = lazy_trimesh.triangles.closest_point(
            mesh.triangles[faces.ravel()], np.repeat(places, num, axis=0)
        ).reshape(len(places), num, 3)
        # Vertices have fewer faces than there are columns.
        far = np.where(faces < 0, np.inf, np.linalg.norm(on - places[:, None], axis=2))
        each, best = np.arange(len(places)), far.argmin(axis=1)
        nearest, found = on[each, best], faces[each, best]
        # As vertices are raised, between them: faces at an edge look past it.
        share = lazy_trimesh.triangles.points_to_barycentric(mesh.triangles[found], nearest)
        normal = np.einsum("nv,nvi->ni", share, mesh.vertex_normals[mesh.faces[found]])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        at_rim = np.isin(mesh.faces[found], rim(mesh)).any(axis=1, keepdims=True)
        height = np.einsum("ni,ni->n", places - nearest, normal)[:, None]
        return np.where(at_rim, places - height * normal, nearest), normal


def part_surface(
    model: BodyModel, part: int, touches: np.ndarray | None = None
) -> PartSurface | None:
    """The surface of a part, in the frame of its link; None if there is none.

    It goes through the kernels, or is as fine as touches tell, if these are given. It is closed if
    the skin encloses a void, else it has a rim; faces look outward.

    Args:
        model: of whose unit all lengths are.
        part: of the skin.
        touches: `(n, 3)` places of the toucher's centre on the part; NaN where unknown.
    """
    here = (model.kernel_part == part) & np.isfinite(model.kernel_place).all(axis=1)
    places, normals = model.kernel_place[here], model.kernel_normal[here]
    if len(places) < _FEWEST or model.dimension < 3:
        return None
    size = float(np.ptp(places, axis=0).max())
    try:  # the unit of the model is arbitrary, and neighbours are told by spacings
        found = topology(places / size)
        faces = fitted_surface(places / size, found)
    except ValueError:  # all in a plane
        return None
    if not len(faces):
        return None
    corners = np.unique(faces)
    faces = np.searchsorted(corners, faces)
    places, normals = places[corners], normals[corners]
    if not found.betti[2]:
        faces = _looking(places, faces, normals)
    mesh = lazy_trimesh.Trimesh(places, faces, process=False)
    if touches is None:
        return PartSurface(mesh=mesh)
    fine, below = fitted_to_touches(mesh, touches[np.isfinite(touches).all(axis=1)])
    return PartSurface(mesh=fine, below=below)


def with_receptors_on(model: BodyModel, surfaces: Mapping[int, PartSurface]) -> BodyModel:
    """The model with receptors on surfaces, and normals that look out of them.

    The mean of the touches that a receptor feels lies below a curved skin. Which side is outside a
    closed surface knows for sure, and the agent guesses it from where touchers come.

    Args:
        model: of whose unit surfaces are.
        surfaces: of parts.
    """
    places, normals = model.receptor_place.copy(), model.receptor_normal.copy()
    for part, surface in surfaces.items():
        here = np.flatnonzero((model.receptor_part == part) & np.isfinite(places).all(axis=1))
        if len(here):
            places[here], normals[here] = surface.nearest(places[here])
    return replace(model, receptor_place=places, receptor_normal=normals)


def toucher_surface(shape: np.ndarray, radius: float) -> "trimesh.Trimesh":
    """The surface of a toucher round its centre.

    Args:
        shape: `(5,)` as in `BodyModel`.
        radius: of the ball that it is, less its shape.
    """
    ball = lazy_trimesh.creation.icosphere(subdivisions=_TOUCHER_DETAIL, radius=1.0)
    direction = np.asarray(ball.vertices) / np.linalg.norm(ball.vertices, axis=1, keepdims=True)
    vertices = radius * direction + bulge(shape, direction)
    return lazy_trimesh.Trimesh(vertices, ball.faces, process=False)


def _looking(places: np.ndarray, faces: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Faces, each turned so that it looks where the normals of its corners do."""
    a, b, c = places[faces].transpose(1, 0, 2)
    wanted = np.nan_to_num(normals[faces]).sum(axis=1)
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), wanted) < 0
    return np.where(inward[:, None], faces[:, ::-1], faces)
