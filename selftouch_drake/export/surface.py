"""The surface of a part of the skin as a triangle mesh, from the places of its kernels."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.body_model.support import bulge
from selftouch_drake.agent.shape.surface import fitted_surface
from selftouch_drake.export.fine_surface import fitted_to_touches
from selftouch_drake.lazy import trimesh as lazy_trimesh
from selftouch_drake.quotient.holes import topology

if TYPE_CHECKING:
    import trimesh

# Fewer places make no surface.
_FEWEST = 12
# Subdivisions of an icosahedron for a toucher: 320 triangles.
_TOUCHER_DETAIL = 2


def part_surface(
    model: BodyModel, part: int, depth: float = 0.0, touches: np.ndarray | None = None
) -> "trimesh.Trimesh | None":
    """The surface of a part, in the frame of its link; None if there is none.

    It goes through the kernels, or is as fine as touches tell if these are given. Closed if the skin
    encloses a void, else with a rim; faces look outward.

    Args:
        model: of whose unit all lengths are.
        part: of the skin.
        depth: how deep under the surface the toucher's centre passes; negative if it stays outside.
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
    if touches is not None:
        mesh, below = fitted_to_touches(mesh, touches[np.isfinite(touches).all(axis=1)])
        depth -= below
    if depth:
        mesh.vertices = mesh.vertices + depth * mesh.vertex_normals
    return mesh


def with_outward_normals(model: BodyModel, parts: Sequence[int]) -> BodyModel:
    """The model with receptors' normals that look out of surfaces where these are closed.

    A closed surface knows its outside for sure; the agent guesses it from where touchers come.
    """
    normals = model.receptor_normal.copy()
    for part in parts:
        mesh = part_surface(model, part)
        here = np.flatnonzero(
            (model.receptor_part == part) & np.isfinite(model.receptor_normal).all(axis=1)
        )
        if mesh is None or not mesh.is_watertight or not len(here):
            continue
        _, nearest = cKDTree(mesh.vertices).query(model.receptor_place[here])
        inward = np.einsum("ni,ni->n", mesh.vertex_normals[nearest], normals[here]) < 0
        normals[here[inward]] *= -1
    return replace(model, receptor_normal=normals)


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
