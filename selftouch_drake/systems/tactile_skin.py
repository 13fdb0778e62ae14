"""The system that feels the contact on skins."""

import warnings
from collections.abc import Sequence
from functools import partial

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactModel, ContactResults, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from selftouch_drake.robot.contact import SensorModel
from selftouch_drake.robot.faces import FaceReader
from selftouch_drake.robot.pairs import WornSkin
from selftouch_drake.robot.readings import read_forces
from selftouch_drake.robot.skin_registration import leave_neighbours_out


class UnfeltContactWarning(UserWarning):
    """Something presses a skin with a contact that the skin cannot feel."""


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
        - NAME_sensation (one per skin)

    ==================== ======== ===== ==== ======================================
    port                 type     size  unit what
    ==================== ======== ===== ==== ======================================
    contact_results (in) abstract              `ContactResults` of the plant, hydroelastic
    body_poses (in)      abstract       m    `list[RigidTransform]` of the plant, X_WB
    sensation (out)      vector   S     N    one reading per receptor, skin after skin
    NAME_sensation (out) vector   S_k   N    the readings of one skin
    ==================== ======== ===== ==== ======================================

    A reading is a force, or what the `reading` of a skin says; without a state, it has no
    hysteresis. Contact is in the world's frame; receptors are in the frame of their skin's link.

    It has no state: two contexts of one diagram do not disturb each other. Like every Drake system
    that is written in Python it can neither be cloned nor converted to another scalar type.

    Args:
        skins: in the order of their readings.
    """

    def __init__(self, skins: Sequence[WornSkin]):
        super().__init__()
        self._sensor = SensorModel(skins)
        self._faces = FaceReader(skins[0].link.GetParentPlant())
        self._links = [int(skin.link.index()) for skin in skins]
        self._skin_ids = frozenset(skin.geometry_id for skin in skins)
        self._contact = self.DeclareAbstractInputPort("contact_results", Value(ContactResults()))
        self._poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        self._readings = [skin.reading for skin in skins]
        self.DeclareVectorOutputPort("sensation", self._sensor.num_receptors, self._calc_sensation)
        for skin, columns in zip(skins, self._sensor.columns_of_skin, strict=True):
            name, size = f"{skin.model.name}_sensation", skin.model.fields.num_receptors
            self.DeclareVectorOutputPort(name, size, partial(self._calc_part, columns))

    @staticmethod
    def AddToBuilder(
        builder: DiagramBuilder,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        worn: Sequence[WornSkin],
        *,
        name: str = "tactile_skin",
    ) -> "TactileSkin":
        """Adds one system for all skins of a plant to its diagram, and connects it.

        A skin does not feel the links next to its own, into which it reaches at the joint. Drake
        leaves out links with one joint between them; here also those with several, as hips have in
        MuJoCo's format.

        Args:
            builder: of the diagram; of a `RobotDiagramBuilder` its `builder()`.
            plant: finalized, in the diagram.
            scene_graph: of the plant.
            worn: of `AddSkins`.
            name: of the system.

        Raises:
            ValueError: the plant computes point contacts, which no skin feels.
        """
        if plant.get_contact_model() == ContactModel.kPoint:
            raise ValueError(
                "the plant's contact model is kPoint, which no skin can feel; call "
                "plant.set_contact_model(ContactModel.kHydroelasticWithFallback) before Finalize"
            )
        leave_neighbours_out(plant, scene_graph, worn)
        touch = TactileSkin(worn)
        builder.AddNamedSystem(name, touch)
        contact = plant.get_contact_results_output_port()
        builder.Connect(contact, touch.GetInputPort("contact_results"))
        builder.Connect(plant.get_body_poses_output_port(), touch.GetInputPort("body_poses"))
        return touch

    def _calc_part(self, readings, context, output):
        output.SetFromVector(self.GetOutputPort("sensation").Eval(context)[readings])

    def _calc_sensation(self, context, output):
        contact = self._contact.Eval(context)
        if contact.num_point_pair_contacts():
            self._warn_of_points(contact)
        force = np.zeros(self._sensor.num_receptors)
        touched = contact.num_hydroelastic_contacts() > 0
        if touched and (surfaces := list(self._faces.read(contact, self._skin_ids))):
            poses = self._poses.Eval(context)
            X_WL = np.array([poses[link].GetAsMatrix34() for link in self._links])
            for faces in surfaces:
                self._sensor.press(faces, X_WL, force)
        for columns, reading in zip(self._sensor.columns_of_skin, self._readings, strict=True):
            force[columns] = read_forces(force[columns], reading)
        output.SetFromVector(force)

    def _warn_of_points(self, contact: ContactResults) -> None:
        numbers = range(contact.num_point_pair_contacts())
        pairs = (contact.point_pair_contact_info(i).point_pair() for i in numbers)
        if any(not self._skin_ids.isdisjoint((pair.id_A, pair.id_B)) for pair in pairs):
            warnings.warn(
                "a skin is pressed by a geometry without hydroelastic properties, which it "
                "cannot feel; give that geometry AddRigidHydroelasticProperties",
                UnfeltContactWarning,
                stacklevel=2,
            )
