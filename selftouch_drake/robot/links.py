"""Links, frames and joints of a robot by name, and the geometry that its model gives a link."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    InMemoryMesh,
    Mesh,
    Role,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Joint, RigidBody

from selftouch_drake.experiment import ExperimentError, closest
from selftouch_drake.lazy import trimesh

# Slippery, like the skin of an exploring finger: friction changes no reading, only the effort.
FRICTION = CoulombFriction(static_friction=0.2, dynamic_friction=0.2)
# Faces for a quarter of a round primitive's outline; the shape is triangulated anew later.
_SECTIONS = 32


def find_link(plant: MultibodyPlant, name: str, field: str) -> RigidBody:
    """The body called `name`, scoped (`model::link`) or bare where it is unique.

    Raises:
        ExperimentError: there is none, or several; the text names `field`.
    """
    return find_named(plant, all_links(plant), name, field, "link")


def all_links(plant: MultibodyPlant) -> list[RigidBody]:
    """Every body of a plant, the world first."""
    return [plant.get_body(BodyIndex(index)) for index in range(plant.num_bodies())]


def all_joints(plant: MultibodyPlant) -> list[Joint]:
    """Every joint of a plant, in the order of their indices."""
    return [plant.get_joint(index) for index in plant.GetJointIndices()]


def scoped_name(plant: MultibodyPlant, element: Any) -> str:
    """`model::name`."""
    instance = plant.GetModelInstanceName(element.model_instance())
    return f"{instance}::{element.name()}"


def find_named(plant: MultibodyPlant, known: Sequence, name: str, field: str, kind: str):
    """That of some links, frames or joints which is called `name`; errors as in `find_link`."""
    found = [e for e in known if scoped_name(plant, e) == name]
    found = found or [e for e in known if e.name() == name]
    if len(found) == 1:
        return found[0]
    if found:
        scoped = " or ".join(scoped_name(plant, e) for e in found)
        raise ExperimentError(
            f"{field} is {name!r}; {len(found)} models have a {kind} of this name: write {scoped}"
        )
    names = {e.name() for e in known} | {scoped_name(plant, e) for e in known}
    hint = (
        closest(name, names) or f"it has {', '.join(sorted(e.name() for e in known if e.name()))}"
    )
    raise ExperimentError(f"{field} is {name!r}; the robot has no such {kind}: {hint}")


def link_geometries(
    plant: MultibodyPlant, inspector: SceneGraphInspector, link: RigidBody, role: Role
) -> list[GeometryId]:
    """The geometries that the model gives a link, in a role."""
    frame_id = plant.GetBodyFrameIdOrThrow(link.index())
    return list(inspector.GetGeometries(frame_id, role))


def pieces_in_link(
    inspector: SceneGraphInspector, geometries: Iterable[GeometryId]
) -> list[trimesh.Trimesh]:
    """Each geometry as a triangle mesh, m, in the frame of its link.

    Raises:
        ValueError: a geometry has no extent of its own, as a half space.
    """
    pieces = []
    for geometry in geometries:
        piece = as_mesh(inspector.GetShape(geometry))
        piece.apply_transform(inspector.GetPoseInFrame(geometry).GetAsMatrix4())
        pieces.append(piece)
    return pieces


def in_memory(text: str, suffix: str) -> Mesh:
    """Drake's shape of the content of a mesh file."""
    return Mesh(InMemoryMesh(mesh_file=MemoryFile(text, suffix, "mesh")))


def as_mesh(shape: Shape) -> trimesh.Trimesh:
    """A shape of Drake's as a triangle mesh in its own frame.

    Raises:
        ValueError: it has no triangles, as a half space, or its file cannot be read.
    """
    for kind, make in _MESHES.items():
        if isinstance(shape, kind):
            return make(shape)
    raise ValueError(
        f"{type(shape).__name__} has no closed surface; give the link another geometry"
    )


def _from_file(shape: Mesh | Convex) -> trimesh.Trimesh:
    # Parsers make no meshes that are held in memory.
    mesh = trimesh.load_mesh(shape.source().path(), process=False)
    if not isinstance(mesh, trimesh.Trimesh):
        mesh = mesh.to_mesh()
    # A scale that mirrors turns the faces inside out.
    faces = mesh.faces if np.prod(shape.scale3()) > 0 else mesh.faces[:, ::-1]
    mesh = trimesh.Trimesh(mesh.vertices * shape.scale3(), faces)
    return mesh.convex_hull if isinstance(shape, Convex) else mesh


_MESHES: dict[type, Callable[[Any], trimesh.Trimesh]] = {
    Sphere: lambda s: trimesh.creation.icosphere(subdivisions=4, radius=s.radius()),
    Box: lambda s: trimesh.creation.box(extents=s.size()),
    Cylinder: lambda s: trimesh.creation.cylinder(s.radius(), s.length(), sections=4 * _SECTIONS),
    # trimesh centres it, as Drake does.
    Capsule: lambda s: trimesh.creation.capsule(s.length(), s.radius(), count=2 * (_SECTIONS,)),
    Ellipsoid: lambda s: trimesh.creation.icosphere(4).apply_scale([s.a(), s.b(), s.c()]),
    Mesh: _from_file,
    Convex: _from_file,
}
