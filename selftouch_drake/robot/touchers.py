"""What presses skins: rigid balls at frames, and links' own shapes made rigid."""

from __future__ import annotations

from collections.abc import Iterable

import trimesh
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Convex,
    GeometryId,
    InMemoryMesh,
    Mesh,
    ProximityProperties,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import Frame, RigidBody

from selftouch_drake.geometry import closed_surface
from selftouch_drake.robot.links import as_mesh

# What the geometry of every toucher is called, before its name.
_PREFIX = "touching_"
# As the skin's: friction changes no reading, only the effort.
FRICTION = CoulombFriction(static_friction=0.2, dynamic_friction=0.2)
# A ball's triangles are as long as it is wide, so that Drake cuts it into eight: a touch costs a
# seventh of what it does with 128, and a sensation differs by a cosine distance of 1e-5 (median) or
# 8e-4 (95 %), where one target sensation is 1e-2 from the next.
_DIAMETERS = 1.0
# Other shapes have triangles this share of their smallest extent.
_OF_EXTENT = 0.5
# m, finer triangles of a touching mesh cost time, and no skin feels them.
_FINEST = 0.008


def register_ball(plant: MultibodyPlant, name: str, frame: Frame, radius: float) -> GeometryId:
    """Gives a frame's link a rigid ball about the frame's origin, called `touching_NAME`.

    Args:
        plant: not yet finalized.
        name: of the toucher.
        frame: fixed to a link.
        radius: m.
    """
    X_LG = frame.GetFixedPoseInBodyFrame()
    hint = 2 * radius * _DIAMETERS
    return _register(plant, frame.body(), X_LG, Sphere(radius), f"{_PREFIX}{name}", hint)


def register_shapes(
    plant: MultibodyPlant,
    name: str,
    link: RigidBody,
    geometries: Iterable[GeometryId],
    inspector: SceneGraphInspector,
) -> tuple[GeometryId, ...]:
    """Gives a link rigid copies of collision geometries of its own, called `touching_NAME_0` etc.

    Args:
        plant: not yet finalized.
        name: of the toucher.
        link: the link.
        geometries: its own, from its model.
        inspector: of the scene graph that holds them.

    Raises:
        ValueError: a geometry has no closed surface, as a half space.
    """
    ids = []
    for number, geometry in enumerate(geometries):
        shape = inspector.GetShape(geometry)
        extent = float(as_mesh(shape).extents.min())
        if isinstance(shape, Mesh | Convex):
            shape = _thinned(shape, extent)
        X_LG = inspector.GetPoseInFrame(geometry)
        own_name = f"{_PREFIX}{name}_{number}"
        ids.append(_register(plant, link, X_LG, shape, own_name, _OF_EXTENT * extent))
    return tuple(ids)


def _register(
    plant: MultibodyPlant,
    link: RigidBody,
    X_LG: RigidTransform,
    shape: Shape,
    name: str,
    hint: float,
) -> GeometryId:
    properties = ProximityProperties()
    AddContactMaterial(friction=FRICTION, properties=properties)
    AddRigidHydroelasticProperties(resolution_hint=hint, properties=properties)
    return plant.RegisterCollisionGeometry(link, X_LG, shape, name, properties)


def _thinned(shape: Mesh | Convex, extent: float) -> Mesh:
    """A mesh with triangles no finer than a skin can feel."""
    surface = closed_surface([as_mesh(shape)], resolution=max(_FINEST, extent / 6))
    text = trimesh.exchange.obj.export_obj(surface, include_normals=False, include_color=False)
    return Mesh(InMemoryMesh(mesh_file=MemoryFile(text, ".obj", "touching")))
