"""The tactile skin in Drake: hydroelastic geometry on a body, and the systems that feel it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from pydrake.common import MemoryFile
from pydrake.common.value import Value
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    ContactSurface,
    GeometryId,
    HydroelasticContactRepresentation,
    InMemoryMesh,
    Mesh,
    ProximityProperties,
    QueryObject,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults, CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from selftouch_drake.geometry import HollowSkin, ReceptiveFields, vtk_text
from selftouch_drake.robot.contact import in_body_frame, pressed_points
from selftouch_drake.robot.readings import Readings

# Slippery, as the skin of a finger that explores: friction changes no reading, only the effort.
SKIN_FRICTION = CoulombFriction(static_friction=0.2, dynamic_friction=0.2)
# s/m, Hunt and Crossley's: enough that a finger does not bounce.
SKIN_DISSIPATION = 10.0


def RegisterSkin(
    plant: MultibodyPlant, body: RigidBody, skin: HollowSkin, *, hydroelastic_modulus: float
) -> GeometryId:
    """Gives `body` a soft hollow skin as compliant hydroelastic collision geometry.

    Args:
        plant: a plant that is registered with a scene graph and not yet finalized.
        body: the body to be covered; the skin is expressed in its frame.
        skin: the hollow skin.
        hydroelastic_modulus: Pa.
    """
    properties = ProximityProperties()
    AddContactMaterial(dissipation=SKIN_DISSIPATION, friction=SKIN_FRICTION, properties=properties)
    AddCompliantHydroelasticProperties(
        resolution_hint=skin.thickness,  # asked for, but a mesh has its own resolution
        hydroelastic_modulus=hydroelastic_modulus,
        properties=properties,
    )
    mesh = Mesh(InMemoryMesh(mesh_file=MemoryFile(vtk_text(skin), ".vtk", "skin")))
    return plant.RegisterCollisionGeometry(body, RigidTransform(), mesh, "skin", properties)


def feel(
    fields: ReceptiveFields,
    skin_id: GeometryId,
    X_WB: RigidTransform,
    surfaces: Iterable[ContactSurface],
) -> np.ndarray:
    """The sensation of a skin that is pressed by contact surfaces.

    Each receptor integrates the pressure on the skin, weighted by its receptive field; the fields
    sum to one, so the readings sum to the total normal force.

    Returns:
        `(S,)` N; exactly zero without contact.
    """
    sensation = np.zeros(fields.num_receptors)
    for surface in surfaces:
        if skin_id in (surface.id_M(), surface.id_N()):
            p_WQ, force = pressed_points(surface)
            p_BQ = in_body_frame(X_WB, np.array(p_WQ))
            sensation += fields.weights_at(p_BQ).T @ np.array(force)
    return sensation


class TactileSkin(LeafSystem):
    """Feels the contact on one body of a running `MultibodyPlant`.

    The sensation belongs to the same instant as the state if the plant was made with
    `use_sampled_output_ports=False`; otherwise contact results lag by one step.

    .. pydrake_system::

        name: TactileSkin
        input_ports:
        - contact_results
        - body_poses
        output_ports:
        - sensation

    - contact_results: `ContactResults` of the plant, hydroelastic.
    - body_poses: `list[RigidTransform]` of the plant, so that the skin may move.
    - sensation: `(S,)` N, one reading a receptor.
    """

    def __init__(self, *, fields: ReceptiveFields, body: RigidBody, skin_id: GeometryId):
        super().__init__()
        self._fields = fields
        self._body_index = body.index()
        self._skin_id = skin_id
        self._contact = self.DeclareAbstractInputPort("contact_results", Value(ContactResults()))
        self._poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        self.DeclareVectorOutputPort("sensation", fields.num_receptors, self._calc_sensation)

    def _calc_sensation(self, context, output):
        contact = self._contact.Eval(context)
        surfaces = (
            contact.hydroelastic_contact_info(i).contact_surface()
            for i in range(contact.num_hydroelastic_contacts())
        )
        X_WB = self._poses.Eval(context)[int(self._body_index)]
        output.SetFromVector(feel(self._fields, self._skin_id, X_WB, surfaces))

    @staticmethod
    def AddToBuilder(
        builder: DiagramBuilder,
        plant: MultibodyPlant,
        *,
        fields: ReceptiveFields,
        body: RigidBody,
        skin_id: GeometryId,
    ) -> TactileSkin:
        """Adds a skin for `body` to a diagram and connects it to `plant`."""
        skin = builder.AddNamedSystem(
            "tactile_skin", TactileSkin(fields=fields, body=body, skin_id=skin_id)
        )
        builder.Connect(plant.get_contact_results_output_port(), skin.get_input_port(0))
        builder.Connect(plant.get_body_poses_output_port(), skin.get_input_port(1))
        return skin


class SkinReadout(LeafSystem):
    """Reads a skin that is not perfect: noisy, partly dead, late.

    Goes behind a `TactileSkin` or a `KinematicTactileSkin`.

    .. pydrake_system::

        name: SkinReadout
        input_ports:
        - sensation
        - q
        output_ports:
        - reading

    - sensation: `(S,)` N, of a perfect skin.
    - q: `(J,)` rad, the configuration in which it is felt; noise comes from it.
    - reading: `(S,)` N.

    Args:
        readings: what is read of a sensation.
        num_joints: J.
        period_s: of the world's discrete steps, 0 for a world without time; the delay is rounded
            to whole steps.
    """

    def __init__(self, readings: Readings, *, num_joints: int, period_s: float = 0.0):
        super().__init__()
        self._readings = readings
        num_receptors = len(readings.alive)
        self._sensation = self.DeclareVectorInputPort("sensation", num_receptors)
        self._q = self.DeclareVectorInputPort("q", num_joints)
        self._num_late = round(readings.flaws.delay / period_s) if period_s else 0
        self.DeclareVectorOutputPort("reading", num_receptors, self._calc_reading)
        if self._num_late:
            # The readings of the last steps, oldest first.
            self.DeclareDiscreteState(self._num_late * num_receptors)
            self.DeclareInitializationDiscreteUpdateEvent(self._begin)
            self.DeclarePeriodicDiscreteUpdateEvent(period_s, 0.0, self._step)

    def _now(self, context) -> np.ndarray:
        return self._readings(self._sensation.Eval(context)[None], self._q.Eval(context)[None])[0]

    def _begin(self, context, discrete_state):
        # What is touched when the world begins was touched before.
        discrete_state.set_value(np.tile(self._now(context), self._num_late))

    def _step(self, context, discrete_state):
        late = context.get_discrete_state_vector().value()
        now = self._now(context)
        discrete_state.set_value(np.concatenate([late[len(now) :], now]))

    def _calc_reading(self, context, output):
        if self._num_late:
            late = context.get_discrete_state_vector().value()
            output.SetFromVector(late[: output.size()])
        else:
            output.SetFromVector(self._now(context))


class KinematicTactileSkin(LeafSystem):
    """Feels contact at given poses, without dynamics: the paper's S = phi(f(M)).

    .. pydrake_system::

        name: KinematicTactileSkin
        input_ports:
        - query_object
        output_ports:
        - sensation

    - query_object: `QueryObject` of the scene graph.
    - sensation: `(S,)` N, one reading a receptor.
    """

    def __init__(self, *, fields: ReceptiveFields, skin_id: GeometryId):
        super().__init__()
        self._fields = fields
        self._skin_id = skin_id
        self._query = self.DeclareAbstractInputPort("query_object", Value[QueryObject]())
        self.DeclareVectorOutputPort("sensation", fields.num_receptors, self._calc_sensation)

    def _calc_sensation(self, context, output):
        query = self._query.Eval(context)
        surfaces = query.ComputeContactSurfaces(HydroelasticContactRepresentation.kPolygon)
        X_WB = query.GetPoseInWorld(self._skin_id)
        output.SetFromVector(feel(self._fields, self._skin_id, X_WB, surfaces))
