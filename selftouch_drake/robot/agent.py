"""The agent's plant: a hollow body with a soft skin and the arm that touches it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import GeometryId, HydroelasticContactRepresentation, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import LoadModelDirectives, Parser, ProcessModelDirectives
from pydrake.multibody.plant import (
    ContactModel,
    DiscreteContactApproximation,
    MultibodyPlant,
)
from pydrake.multibody.tree import (
    Frame,
    ModelInstanceIndex,
    PdControllerGains,
    RigidBody,
    SpatialInertia,
)

from selftouch_drake.experiment import Experiment
from selftouch_drake.geometry import HollowSkin
from selftouch_drake.resources import MODELS
from selftouch_drake.robot.skin import RegisterSkin


@dataclass(frozen=True, slots=True, kw_only=True)
class Agent:
    """Handles into a finalized plant that holds one agent.

    Attributes:
        plant: the plant, discrete, with hydroelastic contact.
        body: the hollow body, frame B.
        skin_id: the skin's collision geometry.
        arm: the model instance with all joints and actuators.
        fingertips: the frames at the centres of the fingertips, F.
    """

    plant: MultibodyPlant
    body: RigidBody
    skin_id: GeometryId
    arm: ModelInstanceIndex
    fingertips: tuple[Frame, ...]

    @property
    def lower(self) -> np.ndarray:
        """`(J,)` rad, lower joint limits."""
        return self.plant.GetPositionLowerLimits()

    @property
    def upper(self) -> np.ndarray:
        """`(J,)` rad, upper joint limits."""
        return self.plant.GetPositionUpperLimits()


def MakeAgent(experiment: Experiment, skin: HollowSkin, scene_graph: SceneGraph) -> Agent:
    """Builds the plant of `experiment` and registers it with `scene_graph`.

    The body is welded to the world, the arm to the body. The arm's links have no collision
    geometry, and the fingertips of one hand do not touch each other, so only fingertips meet skin.
    """
    execution = experiment.execution
    plant = MultibodyPlant(time_step=execution.time_step)
    plant.set_name("plant")
    plant.set_contact_model(ContactModel.kHydroelastic)
    plant.set_contact_surface_representation(HydroelasticContactRepresentation.kPolygon)
    # Peak forces are a third of those of SAP, and contact is held as well.
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kLagged)
    # Contact results and state of one instant, so that (q, sensation) is a pair.
    plant.SetUseSampledOutputPorts(False)
    plant.RegisterAsSourceForSceneGraph(scene_graph)

    body = plant.AddRigidBody("body", SpatialInertia.SolidSphereWithMass(mass=1.0, radius=0.1))
    plant.WeldFrames(plant.world_frame(), body.body_frame(), RigidTransform())
    skin_id = RegisterSkin(
        plant, body, skin, hydroelastic_modulus=experiment.skin.hydroelastic_modulus
    )

    parser = Parser(plant)
    parser.package_map().AddPackageXml(str(MODELS / "package.xml"))
    directives = LoadModelDirectives(str(MODELS / f"agent_{experiment.end_effector}.dmd.yaml"))
    ProcessModelDirectives(directives, parser)
    arm = plant.GetModelInstanceByName("arm")
    gains = PdControllerGains(p=execution.stiffness, d=execution.damping)
    for actuator in plant.GetJointActuatorIndices():
        plant.get_mutable_joint_actuator(actuator).set_controller_gains(gains)
    plant.Finalize()
    fingertips = tuple(
        plant.GetFrameByName(f"fingertip_{i}") for i in range(experiment.num_fingers)
    )
    return Agent(plant=plant, body=body, skin_id=skin_id, arm=arm, fingertips=fingertips)
