"""Diagrams with named ports that hold an agent: at given configurations, or under dynamics."""

from __future__ import annotations

from dataclasses import dataclass

from pydrake.geometry import Meshcat, MeshcatVisualizer, SceneGraph
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Demultiplexer
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from selftouch_drake.experiment import Experiment
from selftouch_drake.geometry import HollowSkin, ReceptiveFields
from selftouch_drake.robot.agent import Agent, MakeAgent
from selftouch_drake.robot.readings import Readings
from selftouch_drake.robot.skin import KinematicTactileSkin, SkinReadout, TactileSkin


@dataclass(frozen=True, slots=True, kw_only=True)
class Station:
    """A diagram and the agent in it.

    The diagram of `MakeKinematicStation` has the ports

    - input `q` `(J,)` rad,
    - outputs `sensation` `(S,)` N and `query_object`.

    That of `MakeDynamicStation` has the ports

    - input `desired_state` `(2J,)` rad and rad/s, which joint controllers follow,
    - outputs `state` `(2J,)`, `sensation` `(S,)` N, `torque` `(J,)` N·m, `contact_results` and
      `query_object`.
    """

    diagram: Diagram
    agent: Agent


def MakeKinematicStation(
    experiment: Experiment,
    skin: HollowSkin,
    fields: ReceptiveFields,
    meshcat: Meshcat | None = None,
) -> Station:
    """A world without time: an arm put at `q` and what the skin feels there."""
    builder = DiagramBuilder()
    scene_graph = builder.AddNamedSystem("scene_graph", SceneGraph())
    agent = MakeAgent(experiment, skin, scene_graph)
    to_pose = builder.AddNamedSystem("pose", MultibodyPositionToGeometryPose(agent.plant))
    builder.Connect(
        to_pose.get_output_port(),
        scene_graph.get_source_pose_port(agent.plant.get_source_id()),
    )
    touch = builder.AddNamedSystem(
        "tactile_skin", KinematicTactileSkin(fields=fields, skin_id=agent.skin_id)
    )
    builder.Connect(scene_graph.get_query_output_port(), touch.get_input_port())
    builder.ExportInput(to_pose.get_input_port(), "q")
    sensation = touch.get_output_port()
    if readings := Readings.of(experiment, fields):
        num_joints = agent.plant.num_positions()
        readout = builder.AddNamedSystem("readout", SkinReadout(readings, num_joints=num_joints))
        builder.Connect(sensation, readout.GetInputPort("sensation"))
        builder.ConnectInput("q", readout.GetInputPort("q"))
        sensation = readout.get_output_port()
    builder.ExportOutput(sensation, "sensation")
    builder.ExportOutput(scene_graph.get_query_output_port(), "query_object")
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
    return Station(diagram=builder.Build(), agent=agent)


def MakeDynamicStation(
    experiment: Experiment,
    skin: HollowSkin,
    fields: ReceptiveFields,
    meshcat: Meshcat | None = None,
) -> Station:
    """A world with time: gravity, torque limits and contact forces, followed by joint control.

    Each actuator is a PD controller inside the plant; gravity is compensated from a model of the
    arm, as the controllers of real arms do.
    """
    builder = DiagramBuilder()
    scene_graph = builder.AddNamedSystem("scene_graph", SceneGraph())
    agent = MakeAgent(experiment, skin, scene_graph)
    plant = builder.AddSystem(agent.plant)
    builder.Connect(
        plant.get_geometry_pose_output_port(),
        scene_graph.get_source_pose_port(plant.get_source_id()),
    )
    builder.Connect(scene_graph.get_query_output_port(), plant.get_geometry_query_input_port())
    gravity = builder.AddNamedSystem(
        "gravity_compensation",
        InverseDynamics(plant, InverseDynamics.InverseDynamicsMode.kGravityCompensation),
    )
    builder.Connect(plant.get_state_output_port(), gravity.get_input_port_estimated_state())
    builder.Connect(
        gravity.get_output_port_generalized_force(),
        plant.get_actuation_input_port(agent.arm),
    )
    touch = TactileSkin.AddToBuilder(
        builder, plant, fields=fields, body=agent.body, skin_id=agent.skin_id
    )
    builder.ExportInput(plant.get_desired_state_input_port(agent.arm), "desired_state")
    builder.ExportOutput(plant.get_state_output_port(), "state")
    sensation = touch.get_output_port()
    if readings := Readings.of(experiment, fields):
        num_joints = plant.num_positions()
        readout = builder.AddNamedSystem(
            "readout",
            SkinReadout(readings, num_joints=num_joints, period_s=plant.time_step()),
        )
        configuration = builder.AddSystem(Demultiplexer([num_joints, num_joints]))
        builder.Connect(plant.get_state_output_port(), configuration.get_input_port())
        builder.Connect(configuration.get_output_port(0), readout.GetInputPort("q"))
        builder.Connect(sensation, readout.GetInputPort("sensation"))
        sensation = readout.get_output_port()
    builder.ExportOutput(sensation, "sensation")
    builder.ExportOutput(plant.get_net_actuation_output_port(), "torque")
    builder.ExportOutput(plant.get_contact_results_output_port(), "contact_results")
    builder.ExportOutput(scene_graph.get_query_output_port(), "query_object")
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
    return Station(diagram=builder.Build(), agent=agent)
