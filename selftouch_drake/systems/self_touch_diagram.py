"""The simulation: who commands, a touch servo, and the station, in one diagram."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Meshcat, MeshcatVisualizer, MeshcatVisualizerParams
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, System

from selftouch_drake.experiment import Experiment
from selftouch_drake.robot.imperfections import slip
from selftouch_drake.robot.skins import SkinModel, make_skins
from selftouch_drake.systems.babbler import Babbler
from selftouch_drake.systems.station import MakeDynamicStation, Station
from selftouch_drake.systems.touch_servo import TouchServo

#: s between two frames in Meshcat.
FRAME_S = 1 / 30

# Outputs of the station that the diagram has too.
_OUTPUTS = ("q", "sensation", "state", "torque", "contact_results", "body_poses")
# Inputs of a commander that the station serves; others are inputs of the diagram.
_FED = ("q", "sensation")


def MakeSelfTouchDiagram(
    experiment: Experiment,
    commander: System,
    meshcat: Meshcat | None = None,
    *,
    skins: Sequence[SkinModel] | None = None,
    full: float | None = None,
) -> Diagram:
    """A robot that somebody commands, under dynamics, and feels itself.

    The commander commands the joints; behind it is a `TouchServo` if the experiment says so; then
    comes the station with plant, gravity compensation, skins and readings. With a Meshcat, skins
    and readings of this simulation are shown.

    .. pydrake_system::

        name: self_touch
        input_ports:
        - goal (as all inputs of the commander but q and sensation)
        output_ports:
        - q
        - sensation
        - state
        - torque
        - contact_results
        - body_poses

    ===================== ======== ==== ========== ======================================
    port                  type     size unit       what
    ===================== ======== ==== ========== ======================================
    q (out)               vector   J    rad, m     positions as joints read
    sensation (out)       vector   S    N          readings of all skins
    state (out)           vector   2J   rad, m, /s true positions, then rates
    torque (out)          vector   J    N·m, N     of the actuators
    contact_results (out) abstract                 `ContactResults`, in the world's frame
    body_poses (out)      abstract      m          `list[RigidTransform]`, X_WB
    ===================== ======== ==== ========== ======================================

    If the commander asks for nothing, as a `Babbler` or a `PlanSource`, a default context begins at
    rest where it is commanded to be.

    Args:
        experiment: of the robot, its skins and their imperfections.
        commander: a `Babbler`, a `PlanSource`, a `NaiveAgent`, or any system with an output port
            `desired_state` `(2J,)`, as the joints read.
        meshcat: where to show the simulation.
        skins: of the experiment, if they are made already.
        full: N, the reading in the strongest colour.

    Raises:
        ExperimentError: the robot or a skin cannot be made; the text names field, value and remedy.
    """
    if isinstance(commander, Babbler):
        # A joint slips after babbling: the agent never knows true angles.
        perfect = dataclasses.replace(experiment.joints, offset=0.0)
        experiment = dataclasses.replace(experiment, joints=perfect)
    skins = make_skins(experiment) if skins is None else skins
    station = MakeDynamicStation(experiment, skins)
    _begin_where_it_is_commanded(station, commander, experiment)

    builder = DiagramBuilder()
    builder.AddNamedSystem(commander.get_name() or "commander", commander)
    robot = builder.AddNamedSystem("station", station.diagram)
    command = commander.GetOutputPort("desired_state")
    if experiment.execution.touch_servo:
        command = _add_servo(builder, station, command, experiment)
    builder.Connect(command, robot.GetInputPort("desired_state"))
    _feed(builder, commander, robot)
    for name in _OUTPUTS:
        builder.ExportOutput(robot.GetOutputPort(name), name)
    if meshcat is not None:
        _show(builder, station, experiment, meshcat, full)
    diagram = builder.Build()
    diagram.set_name("self_touch")
    return diagram


def _begin_where_it_is_commanded(
    station: Station, commander: System, experiment: Experiment
) -> None:
    """Sets the posture of default contexts, if the commander says one by itself."""
    if commander.num_input_ports():
        return
    num_joints = station.robot.num_joints
    port = commander.GetOutputPort("desired_state")
    if port.size() != 2 * num_joints:
        raise ValueError(
            f"the commander's desired_state has {port.size()} numbers, and {experiment.name} "
            f"{num_joints} joints: give {2 * num_joints}"
        )
    q = port.Eval(commander.CreateDefaultContext())[:num_joints]
    station.robot.plant.SetDefaultPositions(q - slip(experiment, num_joints))


def _add_servo(
    builder: DiagramBuilder, station: Station, command: OutputPort, experiment: Experiment
) -> OutputPort:
    # What is commanded is as joints read, and so are their limits.
    slipped = slip(experiment, station.robot.num_joints)
    servo = TouchServo.AddToBuilder(
        builder,
        command,
        station.diagram.GetOutputPort("sensation"),
        lower=station.robot.lower + slipped,
        upper=station.robot.upper + slipped,
    )
    return servo.get_output_port()


def _feed(builder: DiagramBuilder, commander: System, robot: Diagram) -> None:
    for number in range(commander.num_input_ports()):
        port = commander.get_input_port(number)
        if port.get_name() in _FED:
            builder.Connect(robot.GetOutputPort(port.get_name()), port)
        else:
            builder.ExportInput(port, port.get_name())


def _show(
    builder: DiagramBuilder,
    station: Station,
    experiment: Experiment,
    meshcat: Meshcat,
    full: float | None,
) -> None:
    # Who shows nothing need not load what draws.
    from selftouch_drake.colors import FIRM
    from selftouch_drake.systems.skin_visualizer import Ball, SkinVisualizer

    robot, diagram = station.robot, station.diagram
    params = MeshcatVisualizerParams(publish_period=FRAME_S)
    visualizer = builder.AddNamedSystem("meshcat", MeshcatVisualizer(meshcat, params))
    builder.Connect(diagram.GetOutputPort("query_object"), visualizer.query_object_input_port())
    balls = [
        Ball(
            link=int(toucher.link.index()),
            p_LB=np.array(toucher.frame.GetFixedPoseInBodyFrame().translation()),
            radius=radius,
        )
        for toucher in robot.touchers
        if (radius := experiment.touching[toucher.name].radius) is not None
    ]
    show = builder.AddNamedSystem(
        "skin_visualizer",
        SkinVisualizer(
            meshcat,
            robot.skins,
            full=FIRM if full is None else full,
            balls=balls,
            root="/skins",
            period_s=FRAME_S,
        ),
    )
    builder.Connect(diagram.GetOutputPort("sensation"), show.GetInputPort("sensation"))
    builder.Connect(diagram.GetOutputPort("body_poses"), show.GetInputPort("body_poses"))
