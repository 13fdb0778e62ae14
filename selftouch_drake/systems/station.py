"""The station: a robot under dynamics with its skins, its joint controllers and its readings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import CollisionFilterDeclaration, GeometrySet, SceneGraph
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import Diagram, DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import Adder, ConstantVectorSource, Demultiplexer, MatrixGain

from selftouch_drake.experiment import Experiment
from selftouch_drake.robot.imperfections import ImperfectSkins, slip
from selftouch_drake.robot.robot import MakeRobot, Robot
from selftouch_drake.robot.skins import SkinModel
from selftouch_drake.systems.joint_readout import JointReadout
from selftouch_drake.systems.skin_readout import SkinReadout
from selftouch_drake.systems.tactile_skin import TactileSkin


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Station:
    """A diagram and the robot in it.

    .. pydrake_system::

        name: station
        input_ports:
        - desired_state
        output_ports:
        - q
        - sensation
        - state
        - torque
        - contact_results
        - body_poses
        - query_object

    ===================== ======== ==== ========== ======================================
    port                  type     size unit       what
    ===================== ======== ==== ========== ======================================
    desired_state (in)    vector   2J   rad, m, /s positions as joints read, then rates
    q (out)               vector   J    rad, m     positions as joints read
    sensation (out)       vector   S    N          readings of all skins
    state (out)           vector   2J   rad, m, /s true positions, then rates
    torque (out)          vector   J    N·m, N     of the actuators
    contact_results (out) abstract                 `ContactResults`, in the world's frame
    body_poses (out)      abstract      m          `list[RigidTransform]`, X_WB
    query_object (out)    abstract                 `QueryObject`, in the world's frame
    ===================== ======== ==== ========== ======================================
    """

    diagram: Diagram
    robot: Robot


def MakeDynamicStation(experiment: Experiment, skins: Sequence[SkinModel]) -> Station:
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
    _compensate_gravity(builder, robot)

    slipped = slip(experiment, robot.num_joints)
    _export_desired_state(builder, robot, slipped)
    q = builder.AddNamedSystem("q", Demultiplexer([robot.num_joints] * 2))
    builder.Connect(plant.get_state_output_port(), q.get_input_port())
    q_read = q.get_output_port(0)
    if slipped.any() or experiment.joints.noise:
        q_read = JointReadout.AddToBuilder(builder, experiment, slipped, q_read).get_output_port()
    builder.ExportOutput(q_read, "q")

    touch = TactileSkin.AddToBuilder(builder, plant, scene_graph, robot.skins)
    sensation = touch.GetOutputPort("sensation")
    if imperfections := ImperfectSkins.of(experiment, skins):
        sensation = SkinReadout.AddToBuilder(
            builder,
            imperfections,
            sensation,
            q.get_output_port(0),
            period_s=plant.time_step(),
        ).get_output_port()
    builder.ExportOutput(sensation, "sensation")

    builder.ExportOutput(plant.get_state_output_port(), "state")
    builder.ExportOutput(_joint_torque(builder, robot), "torque")
    builder.ExportOutput(plant.get_contact_results_output_port(), "contact_results")
    builder.ExportOutput(plant.get_body_poses_output_port(), "body_poses")
    builder.ExportOutput(scene_graph.get_query_output_port(), "query_object")
    return Station(diagram=builder.Build(), robot=robot)


def _let_rigid_parts_meet(robot: Robot, scene_graph: SceneGraph) -> None:
    """Lifts the filter between rigid parts, unless the outer layer of one is a soft skin."""
    soft = {int(skin.link.index()) for skin in robot.skins if skin.model.is_own_geometry}
    filters = scene_graph.collision_filter_manager()
    for pair in robot.rigid_pairs:
        if not soft & {int(link.index()) for link in pair.links}:
            a, b = (GeometrySet(list(ids)) for ids in pair.geometry_ids)
            filters.Apply(CollisionFilterDeclaration().AllowBetween(a, b))


def _compensate_gravity(builder: DiagramBuilder, robot: Robot) -> None:
    plant = robot.plant
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


def _joint_torque(builder: DiagramBuilder, robot: Robot) -> OutputPort:
    to_joints = builder.AddNamedSystem("torque", MatrixGain(robot.plant.MakeActuationMatrix()))
    builder.Connect(robot.plant.get_net_actuation_output_port(), to_joints.get_input_port())
    return to_joints.get_output_port()


def _export_desired_state(builder: DiagramBuilder, robot: Robot, slipped: np.ndarray) -> None:
    """One input for all joints, as they read; Drake's plant has one for each model in it."""
    inputs = _desired_state_of_models(builder, robot)
    if not slipped.any():
        builder.ExportInput(inputs[0], "desired_state")
        for each in inputs[1:]:
            builder.ConnectInput("desired_state", each)
        return
    true = builder.AddNamedSystem("true_desired_state", Adder(2, 2 * robot.num_joints))
    offset = np.concatenate([-slipped, np.zeros(robot.num_joints)])
    slip_source = builder.AddNamedSystem("slip", ConstantVectorSource(offset))
    builder.ExportInput(true.get_input_port(0), "desired_state")
    builder.Connect(slip_source.get_output_port(), true.get_input_port(1))
    for each in inputs:
        builder.Connect(true.get_output_port(), each)


def _desired_state_of_models(builder: DiagramBuilder, robot: Robot) -> list[InputPort]:
    """Inputs for the state of all joints, each of which serves the joints of one model."""
    plant = robot.plant
    instances = {int(joint.model_instance()): joint.model_instance() for joint in robot.joints}
    inputs = []
    for instance in instances.values():
        joints = [
            plant.get_joint_actuator(a).joint().index()
            for a in plant.GetJointActuatorIndices(instance)
        ]
        selection = builder.AddSystem(MatrixGain(plant.MakeStateSelectorMatrix(joints)))
        builder.Connect(selection.get_output_port(), plant.get_desired_state_input_port(instance))
        inputs.append(selection.get_input_port())
    return inputs
