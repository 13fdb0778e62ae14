"""A diagram with named ports that holds a robot under dynamics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import (
    CollisionFilterDeclaration,
    GeometrySet,
    Meshcat,
    MeshcatVisualizer,
    SceneGraph,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Demultiplexer, MatrixGain

from selftouch_drake.experiment import Experiment
from selftouch_drake.robot.imperfections import ImperfectSkins
from selftouch_drake.robot.robot import MakeRobot, Robot
from selftouch_drake.robot.skin_registration import AddTactileSkin
from selftouch_drake.robot.skins import SkinModel
from selftouch_drake.robot.tactile_skin import SkinReadout


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Station:
    """A diagram and the robot in it.

    The diagram has the ports

    - input `desired_state` `(2J,)` rad or m and their rates, which joint controllers follow,
    - outputs `state` `(2J,)`, `sensation` `(S,)` N, `torque` `(J,)` N·m or N, `contact_results` and
      `query_object`.
    """

    diagram: Diagram
    robot: Robot


def MakeDynamicStation(
    experiment: Experiment, skins: Sequence[SkinModel], meshcat: Meshcat | None = None
) -> Station:
    """A world with dynamics: gravity, effort limits, contact forces and joint control.

    Each actuator is a PD controller inside the plant; gravity is compensated from a model of the
    robot, as the controllers of real robots do. Rigid parts of the robot push each other away,
    unless the outer layer of one is a soft skin.
    """
    builder = DiagramBuilder()
    scene_graph = builder.AddNamedSystem("scene_graph", SceneGraph())
    robot = MakeRobot(experiment, skins, scene_graph)
    _let_rigid_parts_meet(robot, scene_graph)
    plant = builder.AddSystem(robot.plant)
    builder.Connect(
        plant.get_geometry_pose_output_port(),
        scene_graph.get_source_pose_port(plant.get_source_id()),
    )
    builder.Connect(scene_graph.get_query_output_port(), plant.get_geometry_query_input_port())
    _add_gravity_compensation(builder, plant)
    _export_desired_state(builder, robot)
    touch = AddTactileSkin(builder, plant, scene_graph, robot.skins)
    builder.ExportOutput(plant.get_state_output_port(), "state")
    sensation = touch.GetOutputPort("sensation")
    if imperfections := ImperfectSkins.of(experiment, skins):
        readout = builder.AddNamedSystem(
            "readout",
            SkinReadout(
                imperfections,
                num_receptors=sensation.size(),
                num_joints=robot.num_joints,
                period_s=plant.time_step(),
            ),
        )
        builder.Connect(sensation, readout.GetInputPort("sensation"))
        configuration = builder.AddSystem(Demultiplexer([robot.num_joints] * 2))
        builder.Connect(plant.get_state_output_port(), configuration.get_input_port())
        builder.Connect(configuration.get_output_port(0), readout.GetInputPort("q"))
        sensation = readout.get_output_port()
    builder.ExportOutput(sensation, "sensation")
    to_joints = builder.AddNamedSystem("torque", MatrixGain(plant.MakeActuationMatrix()))
    builder.Connect(plant.get_net_actuation_output_port(), to_joints.get_input_port())
    builder.ExportOutput(to_joints.get_output_port(), "torque")
    builder.ExportOutput(plant.get_contact_results_output_port(), "contact_results")
    builder.ExportOutput(scene_graph.get_query_output_port(), "query_object")
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
    return Station(diagram=builder.Build(), robot=robot)


def _let_rigid_parts_meet(robot: Robot, scene_graph: SceneGraph) -> None:
    """Lifts the filter between rigid parts, unless the outer layer of one is a soft skin."""
    soft = {int(skin.link.index()) for skin in robot.skins if skin.model.is_own_geometry}
    filters = scene_graph.collision_filter_manager()
    for pair in robot.rigid_pairs:
        if not soft & {int(link.index()) for link in pair.links}:
            a, b = (GeometrySet(list(ids)) for ids in pair.geometry_ids)
            filters.Apply(CollisionFilterDeclaration().AllowBetween(a, b))


def _add_gravity_compensation(builder: DiagramBuilder, plant: MultibodyPlant) -> None:
    gravity = builder.AddNamedSystem(
        "gravity_compensation",
        InverseDynamics(plant, InverseDynamics.InverseDynamicsMode.kGravityCompensation),
    )
    builder.Connect(plant.get_state_output_port(), gravity.get_input_port_estimated_state())
    # From joints to actuators, which may have another order.
    to_actuators = builder.AddNamedSystem(
        "actuation", MatrixGain(np.linalg.inv(plant.MakeActuationMatrix()))
    )
    builder.Connect(gravity.get_output_port_generalized_force(), to_actuators.get_input_port())
    builder.Connect(to_actuators.get_output_port(), plant.get_actuation_input_port())


def _export_desired_state(builder: DiagramBuilder, robot: Robot) -> None:
    """One input for all joints; Drake's plant has one for each model in it."""
    plant, J = robot.plant, robot.num_joints
    exported = False
    for instance in {int(j.model_instance()): j.model_instance() for j in robot.joints}.values():
        places = [
            plant.get_joint_actuator(a).joint().position_start()
            for a in plant.GetJointActuatorIndices(instance)
        ]
        of_instance = np.zeros((2 * len(places), 2 * J))
        of_instance[np.arange(2 * len(places)), [*places, *(J + p for p in places)]] = 1.0
        selection = builder.AddSystem(MatrixGain(of_instance))
        builder.Connect(selection.get_output_port(), plant.get_desired_state_input_port(instance))
        if exported:
            builder.ConnectInput("desired_state", selection.get_input_port())
        else:
            builder.ExportInput(selection.get_input_port(), "desired_state")
            exported = True
