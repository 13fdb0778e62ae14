"""The tactile skin in Drake: hydroelastic geometry on a link, and the systems that feel it."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from pydrake.common import MemoryFile
from pydrake.common.value import Value
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    GeometryId,
    InMemoryMesh,
    Mesh,
    ProximityProperties,
    Rgba,
    SceneGraphConfig,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactModel, ContactResults, CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RigidBody
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from selftouch_drake.geometry import HollowSkin, ReceptiveFields, vtk_text
from selftouch_drake.lazy import trimesh
from selftouch_drake.robot.contact import SensorModel
from selftouch_drake.robot.imperfections import ImperfectSkins

# Slippery, like the skin of an exploring finger: friction changes no reading, only the effort.
SKIN_FRICTION = CoulombFriction(static_friction=0.2, dynamic_friction=0.2)
# s/m, Hunt and Crossley's: enough that a finger does not bounce.
SKIN_DISSIPATION = 10.0
# Light grey and opaque, as a skin looks.
_COLOR = Rgba(0.78, 0.79, 0.82, 1.0)


class UnfeltContactWarning(UserWarning):
    """Something presses a skin with a contact that the skin cannot feel."""


def RegisterSkin(
    plant: MultibodyPlant,
    body: RigidBody,
    skin: HollowSkin,
    *,
    hydroelastic_modulus: float,
    X_LS: RigidTransform | None = None,
    name: str = "skin",
    visible: bool = True,
) -> GeometryId:
    """Gives `body` a soft hollow skin as compliant hydroelastic collision geometry.

    Args:
        plant: a plant that is registered with a scene graph and not yet finalized.
        body: the body to be covered, frame L.
        skin: the hollow skin.
        hydroelastic_modulus: Pa.
        X_LS: the skin's frame S on the body; by default they are one.
        name: of the geometry, unique on the body.
        visible: whether Meshcat shows its outer surface.

    Raises:
        ValueError: the modulus is not positive.
    """
    if not hydroelastic_modulus > 0:
        raise ValueError(f"hydroelastic_modulus is {hydroelastic_modulus}; give a number above 0")
    X_LS = X_LS or RigidTransform()
    properties = ProximityProperties()
    # Where one of Drake's defaults is missing, each context computes the pressure field again.
    defaults = SceneGraphConfig().default_proximity_properties
    AddContactMaterial(
        dissipation=SKIN_DISSIPATION,
        friction=SKIN_FRICTION,
        point_stiffness=defaults.point_stiffness,
        properties=properties,
    )
    properties.AddProperty("material", "relaxation_time", defaults.relaxation_time)
    AddCompliantHydroelasticProperties(
        resolution_hint=skin.thickness,  # asked for, but a mesh has its own resolution
        hydroelastic_modulus=hydroelastic_modulus,
        properties=properties,
    )
    mesh = wall_mesh(skin, name)
    geometry_id = plant.RegisterCollisionGeometry(body, X_LS, mesh, name, properties)
    if visible:
        outer = Mesh(InMemoryMesh(mesh_file=MemoryFile(_obj_text(skin), ".obj", name)))
        plant.RegisterVisualGeometry(body, X_LS, outer, f"{name}_visual", np.array(_COLOR.rgba))
    return geometry_id


def wall_mesh(skin: HollowSkin, name: str) -> Mesh:
    """The tetrahedra of a skin as Drake's shape."""
    return Mesh(InMemoryMesh(mesh_file=MemoryFile(vtk_text(skin), ".vtk", name)))


def _obj_text(skin: HollowSkin) -> str:
    # Drake's renderers, as a camera in a MuJoCo file brings along, refuse meshes without normals.
    normals = trimesh.Trimesh(skin.vertices, skin.faces, process=False).vertex_normals
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in skin.vertices.tolist()]
    lines += [f"vn {x:.6g} {y:.6g} {z:.6g}" for x, y, z in normals.tolist()]
    lines += ["f " + " ".join(f"{v + 1}//{v + 1}" for v in face) for face in skin.faces.tolist()]
    return "\n".join(lines) + "\n"


class TactileSkin(LeafSystem):
    """Feels the contact on the skinned bodies of a running `MultibodyPlant`.

    The sensation belongs to the same instant as the state if the plant was made with
    `use_sampled_output_ports=False`; otherwise contact results lag by one step.

    .. pydrake_system::

        name: TactileSkin
        input_ports:
        - contact_results
        - body_poses
        output_ports:
        - sensation
        - NAME_sensation (one per name)

    - contact_results: `ContactResults` of the plant, hydroelastic.
    - body_poses: `list[RigidTransform]` of the plant, so that the skins may move.
    - sensation: `(S,)` N, one reading per receptor, skin after skin.
    - NAME_sensation: N, the readings of one skin.

    It has no state: two contexts of one diagram do not disturb each other. Like every Drake system
    that is written in Python it can neither be cloned nor converted to another scalar type.

    Args:
        sensor: what the skins feel where contact surfaces press.
        links: the body that wears each skin.
        skin_ids: each skin's geometry.
        X_LS: each skin's frame on its body; by default they are one.
        names: of the skins that have a port of their own; by default none has.
    """

    def __init__(
        self,
        *,
        sensor: SensorModel,
        links: Sequence[BodyIndex],
        skin_ids: Sequence[GeometryId],
        X_LS: Sequence[RigidTransform] | None = None,
        names: Sequence[str] = (),
    ):
        super().__init__()
        self._sensor = sensor
        self._worn = list(
            zip(map(int, links), X_LS or [RigidTransform()] * len(links), strict=True)
        )
        self._skin_ids = frozenset(skin_ids)
        self._contact = self.DeclareAbstractInputPort("contact_results", Value(ContactResults()))
        self._poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        self.DeclareVectorOutputPort("sensation", sensor.num_receptors, self._calc_sensation)
        for name, readings in zip(names, sensor.readings, strict=False):
            self._declare_part(f"{name}_sensation", readings)

    def _declare_part(self, name: str, readings: slice) -> None:
        def calc(context, output):
            output.SetFromVector(self.GetOutputPort("sensation").Eval(context)[readings])

        self.DeclareVectorOutputPort(name, readings.stop - readings.start, calc)

    def _calc_sensation(self, context, output):
        contact = self._contact.Eval(context)
        self._warn_of_points(contact)
        surfaces = (
            (0, contact.hydroelastic_contact_info(i).contact_surface())
            for i in range(contact.num_hydroelastic_contacts())
        )
        poses = self._poses.Eval(context)
        X_WS = [poses[link].multiply(X_LS).GetAsMatrix34() for link, X_LS in self._worn]
        output.SetFromVector(self._sensor.touches(surfaces, np.array([X_WS])).sensation[0])

    def _warn_of_points(self, contact: ContactResults) -> None:
        for i in range(contact.num_point_pair_contacts()):
            pair = contact.point_pair_contact_info(i).point_pair()
            if pair.id_A in self._skin_ids or pair.id_B in self._skin_ids:
                warnings.warn(
                    "a skin is pressed by a geometry without hydroelastic properties, which it "
                    "cannot feel; give that geometry AddRigidHydroelasticProperties",
                    UnfeltContactWarning,
                    stacklevel=2,
                )
                return

    @staticmethod
    def AddToBuilder(
        builder: DiagramBuilder,
        plant: MultibodyPlant,
        *,
        fields: ReceptiveFields,
        body: RigidBody,
        skin_id: GeometryId,
        X_LS: RigidTransform | None = None,
        name: str | None = None,
    ) -> TactileSkin:
        """Adds a skin for `body` to a diagram and connects it to `plant`.

        Args:
            builder: of the diagram.
            plant: finalized, in the diagram.
            fields: the receptors' fields, in the skin's frame S.
            body: the body that wears the skin.
            skin_id: its geometry, of `RegisterSkin`.
            X_LS: as given to `RegisterSkin`.
            name: of the system; by default `tactile_skin_` and the body's name.

        Raises:
            ValueError: the plant computes point contacts, which no skin feels.
        """
        skin = TactileSkin(
            sensor=SensorModel([fields], [skin_id]),
            links=[body.index()],
            skin_ids=[skin_id],
            X_LS=[X_LS or RigidTransform()],
        )
        return connected(builder, plant, skin, name or f"tactile_skin_{body.name()}")


def connected(
    builder: DiagramBuilder, plant: MultibodyPlant, skin: TactileSkin, name: str
) -> TactileSkin:
    """Adds a `TactileSkin` to a diagram and connects it to its plant.

    Raises:
        ValueError: the plant computes point contacts, which no skin feels.
    """
    if plant.get_contact_model() == ContactModel.kPoint:
        raise ValueError(
            "the plant's contact model is kPoint, which no skin can feel; call "
            "plant.set_contact_model(ContactModel.kHydroelasticWithFallback) before Finalize"
        )
    builder.AddNamedSystem(_free_name(builder, name), skin)
    builder.Connect(plant.get_contact_results_output_port(), skin.GetInputPort("contact_results"))
    builder.Connect(plant.get_body_poses_output_port(), skin.GetInputPort("body_poses"))
    return skin


def _free_name(builder: DiagramBuilder, name: str) -> str:
    """A name that is free in the diagram: the second skin of a body is called `name_2`."""
    number, free = 1, name
    while builder.HasSubsystemNamed(free):
        number += 1
        free = f"{name}_{number}"
    return free


class SkinReadout(LeafSystem):
    """Turns sensations into readings of imperfect skins: noisy, partly dead, delayed.

    Goes behind a `TactileSkin`.

    .. pydrake_system::

        name: SkinReadout
        input_ports:
        - sensation
        - q
        output_ports:
        - reading

    - sensation: `(S,)` N, of perfect skins.
    - q: `(J,)` rad or m, the configuration in which it is felt; noise comes from it.
    - reading: `(S,)` N.

    Args:
        imperfections: what is read of a sensation.
        num_receptors: S.
        num_joints: J.
        period_s: of the world's discrete steps, 0 for a world without time; delays are rounded to
            whole steps.
    """

    def __init__(
        self,
        imperfections: ImperfectSkins,
        *,
        num_receptors: int,
        num_joints: int,
        period_s: float = 0.0,
    ):
        super().__init__()
        self._imperfections = imperfections
        self._sensation = self.DeclareVectorInputPort("sensation", num_receptors)
        self._q = self.DeclareVectorInputPort("q", num_joints)
        self._delay = np.zeros(num_receptors, dtype=int)
        if period_s:
            for columns, skin in imperfections.skins:
                self._delay[columns] = round(skin.flaws.delay / period_s)
        self._num_late = int(self._delay.max())
        self.DeclareVectorOutputPort("reading", num_receptors, self._calc_reading)
        if self._num_late:
            # The readings of the last steps, oldest first.
            self.DeclareDiscreteState(self._num_late * num_receptors)
            self.DeclareInitializationDiscreteUpdateEvent(self._begin)
            self.DeclarePeriodicDiscreteUpdateEvent(period_s, 0.0, self._step)

    def _now(self, context) -> np.ndarray:
        sensation, q = self._sensation.Eval(context), self._q.Eval(context)
        return self._imperfections(sensation[None], q[None])[0]

    def _begin(self, context, discrete_state):
        # A touch at the start of the world counts as older than any delay.
        discrete_state.set_value(np.tile(self._now(context), self._num_late))

    def _step(self, context, discrete_state):
        late = context.get_discrete_state_vector().value()
        now = self._now(context)
        discrete_state.set_value(np.concatenate([late[len(now) :], now]))

    def _calc_reading(self, context, output):
        now = self._now(context)
        if self._num_late:
            past = context.get_discrete_state_vector().value().reshape(self._num_late, -1)
            late = self._delay > 0
            now[late] = past[self._num_late - self._delay[late], np.flatnonzero(late)]
        output.SetFromVector(now)
