"""Touchers: rigid balls at frames, and the shapes of links, made rigid."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pydrake.geometry import (
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    GeometryId,
    Mesh,
    ProximityProperties,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FrameIndex, RigidBody

from selftouch_drake.experiment import Experiment, ExperimentError
from selftouch_drake.geometry.closing import closed_surface
from selftouch_drake.lazy import trimesh
from selftouch_drake.robot.changes import frame_after, with_tool
from selftouch_drake.robot.links import FRICTION, as_mesh, find_link, find_named, in_memory
from selftouch_drake.robot.pairs import OwnGeometries, Toucher, WornSkin

# Triangles in one patch, which is pressed on a skin at once; a ball is one patch.
PATCH = 8
# Faces round a cylinder.
_SECTIONS = 12
# The triangles into which Drake cuts a ball of radius 1: corners on the axes.
_CORNERS = np.concatenate([np.eye(3), -np.eye(3)])
_FACES = np.array(
    [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
)
# m; finer triangles of a touching mesh cost time, and no skin feels the difference.
_FINEST = 0.008


class RigidMesh(NamedTuple):
    """A toucher's triangles in its link's frame, in patches.

    Attributes:
        points: `(P, 3)` m, corners, those of each patch together.
        point_ends: where the corners of each patch start and end.
        faces: `(F, 3)` corners, outward by the right hand, counted from the patch's first.
        face_ends: where the faces of each patch start and end.
        normals: `(F, 3)` unit vectors.
        areas: `(F,)` m², twice the area.
    """

    points: np.ndarray
    point_ends: np.ndarray
    faces: np.ndarray
    face_ends: np.ndarray
    normals: np.ndarray
    areas: np.ndarray


def add_toucher(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    name: str,
    experiment: Experiment,
    worn: Sequence[WornSkin],
    own: OwnGeometries,
) -> Toucher:
    """Adds what an experiment calls `name` to a plant: a ball at a frame, or a link made rigid.

    A link that wears skins touches with these, else with rigid copies of its `own_geometries`,
    called `touching_NAME_0` etc.

    Raises:
        ExperimentError: the plant has no such frame or link, or the link no closed surface.
    """
    if experiment.touching[name].link is None:
        return _add_ball(plant, name, experiment)
    return _add_link(plant, inspector, name, experiment, worn, own)


def _add_ball(plant: MultibodyPlant, name: str, experiment: Experiment) -> Toucher:
    """Adds a ball at a frame."""
    described = experiment.touching[name]
    frames = [plant.get_frame(FrameIndex(index)) for index in range(plant.num_frames())]
    field = f"touching.{name}.frame"
    frame = find_named(plant, frames, str(described.frame), field, "frame")
    frame = with_tool(plant, experiment, name, frame_after(plant, experiment, frame))
    ball = Sphere(float(described.radius or 0.0))
    # A ball's triangles are as long as it is wide, so that Drake cuts it into eight: a touch
    # costs a seventh of what it does with 128, and a sensation differs by a cosine distance of
    # 1e-5 (median) or 8e-4 (95 %), where one target sensation is 1e-2 from the next.
    hint = 2 * ball.radius()
    X_LF = frame.GetFixedPoseInBodyFrame()
    geometry = _register(plant, frame.body(), X_LF, ball, f"touching_{name}", hint)
    return Toucher(name=name, link=frame.body(), frame=frame, geometry_ids=(geometry,))


def _add_link(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    name: str,
    experiment: Experiment,
    worn: Sequence[WornSkin],
    own: OwnGeometries,
) -> Toucher:
    """Makes a link touch, with the skins it wears or else with its own geometries."""
    field, wanted = f"touching.{name}.link", experiment.touching[name].link
    link = find_link(plant, str(wanted), field)
    ids = [skin.geometry_id for skin in worn if skin.link.index() == link.index()]
    if not ids and link.index() not in own:
        raise ExperimentError(
            f"{field} is {wanted!r}, a link without collision geometry; add some in "
            "its model, or give a ball by frame and radius"
        )
    for number, geometry in enumerate(() if ids else own[link.index()]):
        try:
            mesh = _own_mesh(inspector.GetShape(geometry))
        except ValueError as error:
            raise ExperimentError(f"{field} is {wanted!r}: {error}") from error
        X_LG = inspector.GetPoseInFrame(geometry)
        ids.append(_register(plant, link, X_LG, mesh, f"touching_{name}_{number}"))
    return Toucher(name=name, link=link, frame=link.body_frame(), geometry_ids=tuple(ids))


def triangles_in_frame(
    toucher: Toucher, inspector: SceneGraphInspector
) -> tuple[np.ndarray, np.ndarray]:
    """The triangles that Drake gives a rigid toucher, in its frame.

    `(V, 3)` m, and `(F, 3)` corners, outward by the right hand.
    """
    X_FL = toucher.frame.GetFixedPoseInBodyFrame().inverse()
    vertices, faces, count = [], [], 0
    for geometry in toucher.geometry_ids:
        shape = inspector.GetShape(geometry)
        if isinstance(shape, Sphere):
            own, own_faces = shape.radius() * _CORNERS, _FACES
        else:
            text = shape.source().in_memory().mesh_file.contents().decode()
            lines = [line.split() for line in text.splitlines()]
            own = np.array([line[1:] for line in lines if line[0] == "v"], dtype=float)
            own_faces = np.array([line[1:] for line in lines if line[0] == "f"], dtype=int) - 1
        X_FG = X_FL.multiply(inspector.GetPoseInFrame(geometry))
        vertices.append(X_FG.multiply(own.T).T)
        faces.append(own_faces + count)
        count += len(own)
    return np.concatenate(vertices), np.concatenate(faces)


def _register(
    plant: MultibodyPlant,
    link: RigidBody,
    X_LG: RigidTransform,
    shape: Shape,
    name: str,
    hint: float = 1.0,
) -> GeometryId:
    properties = ProximityProperties()
    AddContactMaterial(friction=FRICTION, properties=properties)
    AddRigidHydroelasticProperties(resolution_hint=hint, properties=properties)
    return plant.RegisterCollisionGeometry(link, X_LG, shape, name, properties)


def _own_mesh(shape: Shape) -> Mesh:
    """A shape as a mesh, with triangles no finer than a skin can feel."""
    if isinstance(shape, Sphere):
        surface = _ellipsoid([shape.radius()] * 3)
    elif isinstance(shape, Ellipsoid):
        surface = _ellipsoid([shape.a(), shape.b(), shape.c()])
    elif isinstance(shape, Cylinder):
        surface = trimesh.creation.cylinder(shape.radius(), shape.length(), sections=_SECTIONS)
    elif isinstance(shape, Capsule):
        surface = trimesh.creation.capsule(
            shape.length(), shape.radius(), count=[_SECTIONS, _SECTIONS // 2]
        )
    else:
        surface = as_mesh(shape)
        if not isinstance(shape, Box):
            finest = max(_FINEST, float(surface.extents.min()) / 6)
            surface = closed_surface([surface], resolution=finest, sharp=False)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in surface.vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in surface.faces.tolist()]
    return in_memory("\n".join(lines) + "\n", ".obj")


def _ellipsoid(semi_axes: Sequence[float]) -> trimesh.Trimesh:
    """An octahedron, cut once more, with its corners on an ellipsoid: 32 triangles."""
    ball = trimesh.Trimesh(_CORNERS, _FACES, process=False).subdivide()
    directions = ball.vertices / np.linalg.norm(ball.vertices, axis=1, keepdims=True)
    return trimesh.Trimesh(directions * semi_axes, ball.faces, process=False)


def rigid_mesh(vertices: np.ndarray, faces: np.ndarray) -> RigidMesh:
    """Cuts a mesh `(V, 3)` m, `(F, 3)` into patches of faces that lie together."""
    faces = faces[np.linalg.norm(_normals(vertices[faces]), axis=1) > 0]
    patches, left = [], [np.arange(len(faces))]
    centres = vertices[faces].mean(axis=1)
    while left:
        patch = left.pop()
        if len(patch) <= PATCH:
            patches.append(patch)
        else:
            along = centres[patch, np.ptp(centres[patch], axis=0).argmax()]
            left += np.array_split(patch[np.argsort(along, kind="stable")], 2)
    own = [np.unique(faces[patch], return_inverse=True) for patch in patches]
    normals = _normals(vertices[faces[np.concatenate(patches)]])
    areas = np.linalg.norm(normals, axis=1)
    return RigidMesh(
        points=vertices[np.concatenate([points for points, _ in own])],
        point_ends=np.cumsum([0, *(len(points) for points, _ in own)]),
        faces=np.concatenate([local.reshape(-1, 3) for _, local in own]),
        face_ends=np.cumsum([0, *(len(patch) for patch in patches)]),
        normals=normals / areas[:, None],
        areas=areas,
    )


def _normals(corners: np.ndarray) -> np.ndarray:
    """`(F, 3)` m², normals of triangles `(F, 3, 3)`, twice as long as the area."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
