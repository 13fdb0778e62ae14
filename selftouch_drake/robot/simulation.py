"""A robot under dynamics that follows commands: for plans, live play and babbling."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.geometry import CollisionFilterDeclaration, GeometrySet, SceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    Demultiplexer,
    LogVectorOutput,
    MatrixGain,
    TrajectorySource,
)
from pydrake.trajectories import PiecewisePolynomial

from selftouch_drake.experiment import Experiment
from selftouch_drake.robot.imperfections import ImperfectSkins, slip
from selftouch_drake.robot.robot import MakeRobot, Robot
from selftouch_drake.robot.servo import TouchServo
from selftouch_drake.robot.skins import SkinModel
from selftouch_drake.robot.tactile_skin import AddTactileSkin, SkinReadout

# s between two entries of the log.
LOG_PERIOD = 0.01


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
    return Station(diagram=builder.Build(), robot=robot)


def _let_rigid_parts_meet(robot: Robot, scene_graph: SceneGraph) -> None:
    """Lifts the filter between rigid parts, unless the outer layer of one is a soft skin."""
    soft = {int(skin.link.index()) for skin in robot.skins if skin.model.is_own_geometry}
    filters = scene_graph.collision_filter_manager()
    for pair in robot.rigid_pairs:
        if not soft & {int(link.index()) for link in pair.links}:
            a, b = (GeometrySet(list(ids)) for ids in pair.geometry_ids)
            filters.Apply(CollisionFilterDeclaration().AllowBetween(a, b))


def _export_desired_state(builder: DiagramBuilder, robot: Robot) -> None:
    """One input for all joints; Drake's plant has one for each model in it."""
    plant = robot.plant
    instances = {int(joint.model_instance()): joint.model_instance() for joint in robot.joints}
    for number, instance in enumerate(instances.values()):
        joints = [
            plant.get_joint_actuator(a).joint().index()
            for a in plant.GetJointActuatorIndices(instance)
        ]
        selection = builder.AddSystem(MatrixGain(plant.MakeStateSelectorMatrix(joints)))
        builder.Connect(selection.get_output_port(), plant.get_desired_state_input_port(instance))
        if number:
            builder.ConnectInput("desired_state", selection.get_input_port())
        else:
            builder.ExportInput(selection.get_input_port(), "desired_state")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Log:
    """The record of a stretch of simulation.

    Attributes:
        time_s: `(T,)` s, every log period.
        q: `(T, J)` rad or m, where the joints truly were.
        v: `(T, J)` rad/s or m/s.
        felt: `(T, S)` N, sensations.
        torque: `(N, J)` N·m or N, of the actuators, at every step of the plant.
        q_steps: `(N, J)` rad or m, at every step of the plant.
    """

    time_s: np.ndarray
    q: np.ndarray
    v: np.ndarray
    felt: np.ndarray
    torque: np.ndarray
    q_steps: np.ndarray


class Simulation:
    """A robot under dynamics that follows paths.

    Attributes:
        robot: the robot.
        slip: `(J,)` rad or m, by how much joints read more than their true position.
        log_period: s, between two entries of the log; infinite if there is no log.
    """

    def __init__(
        self,
        experiment: Experiment,
        skins: Sequence[SkinModel],
        *,
        log_period: float = LOG_PERIOD,
    ):
        builder = DiagramBuilder()
        station = MakeDynamicStation(experiment, skins)
        self.robot = station.robot
        num_joints = self.robot.num_joints
        self.log_period = log_period
        self.slip = slip(experiment, num_joints)
        builder.AddNamedSystem("station", station.diagram)
        self._source = builder.AddNamedSystem(
            "path_source",
            TrajectorySource(PiecewisePolynomial(np.zeros((num_joints, 1))), 1),
        )
        desired_state = self._source.get_output_port()
        self._servo: TouchServo | None = None
        if experiment.execution.touch_servo:
            self._servo = builder.AddNamedSystem(
                "touch_servo",
                TouchServo(
                    num_receptors=experiment.num_receptors,
                    lower=self.robot.lower,
                    upper=self.robot.upper,
                ),
            )
            builder.Connect(desired_state, self._servo.GetInputPort("desired_state"))
            builder.Connect(
                station.diagram.GetOutputPort("sensation"), self._servo.GetInputPort("sensation")
            )
            desired_state = self._servo.get_output_port()
        builder.Connect(desired_state, station.diagram.GetInputPort("desired_state"))
        self._logs = {
            name: LogVectorOutput(station.diagram.GetOutputPort(port), builder, publish_period=step)
            for name, port, step in (
                ("state", "state", log_period),
                ("sensation", "sensation", log_period),
                ("torque", "torque", experiment.execution.time_step),
                ("state_steps", "state", experiment.execution.time_step),
            )
            if np.isfinite(log_period)
        }
        self.diagram = builder.Build()
        self._simulator = Simulator(self.diagram)
        self._context = self._simulator.get_mutable_context()
        self._station_context = station.diagram.GetMyContextFromRoot(self._context)
        self._state = station.diagram.GetOutputPort("state")
        self._sensation = station.diagram.GetOutputPort("sensation")

    @property
    def time_s(self) -> float:
        """s, since `rest_at` or `follow`."""
        return self._context.get_time()

    @property
    def q(self) -> np.ndarray:
        """`(J,)` rad or m, where the joints truly are."""
        return self._state.Eval(self._station_context)[: self.robot.num_joints]

    @property
    def q_commanded(self) -> np.ndarray:
        """`(J,)` rad or m, where the joints are commanded to be, as they read.

        Where something presses on a skin, the joints stay behind their command.
        """
        source_context = self._source.GetMyContextFromRoot(self._context)
        return (
            self._source.get_output_port().Eval(source_context)[: self.robot.num_joints] + self.slip
        )

    @property
    def q_read(self) -> np.ndarray:
        """`(J,)` rad or m, where the joints read that they are."""
        return self.q + self.slip

    @property
    def v(self) -> np.ndarray:
        """`(J,)` rad/s or m/s."""
        return self._state.Eval(self._station_context)[self.robot.num_joints :]

    @property
    def felt(self) -> np.ndarray:
        """`(S,)` N, the sensation."""
        return self._sensation.Eval(self._station_context)

    def rest_at(self, q: np.ndarray) -> None:
        """Puts the robot at rest at `(J,)` q, as its joints read, and starts its time there."""
        q = np.asarray(q, dtype=float)
        self._begin(PiecewisePolynomial((q - self.slip)[:, None]), q - self.slip)

    def follow(
        self,
        time_s: np.ndarray,
        q: np.ndarray,
        v: np.ndarray,
        *,
        jump: bool = False,
        beside: Any = None,
    ) -> None:
        """Begins a motion at time 0, from where the robot is.

        Args:
            time_s: `(T,)` s, from 0.
            q: `(T, J)` rad or m, as the joints read.
            v: `(T, J)` rad/s or m/s.
            jump: whether the robot is put at rest where the motion starts.
            beside: what would be felt beside it, as `TouchServo` takes it; without, the servo keeps
                its offset.
        """
        q = q - self.slip
        path = PiecewisePolynomial.CubicHermite(time_s, q.T, v.T)
        self._begin(path, q[0] if jump else None, beside)

    def lead_through(self, q: np.ndarray, time_s: np.ndarray | float) -> None:
        """Leads the joints through `(n, J)` q, as they read, at constant velocities between them.

        They are led from where they are commanded to be, and pass each q at its time `(n,)` s; it
        may be one q `(J,)` and its time. Time and the log go on, as they do not where a motion
        begins.
        """
        q, time_s = np.atleast_2d(q), np.atleast_1d(time_s)
        # Then the command rests: the last node holds for a while.
        nodes = np.concatenate([self.q_commanded[None], q, q[-1:]]) - self.slip
        times = np.concatenate([[self.time_s], time_s, time_s[-1:] + LOG_PERIOD])
        self._give_path(PiecewisePolynomial.FirstOrderHold(times, nodes.T))
        self.advance_to(time_s[-1])

    def advance(self, duration: float) -> None:
        """Advances the world by `duration` s, in step with the clock if a rate is set."""
        self._simulator.AdvanceTo(self.time_s + duration)

    def advance_to(self, time_s: float) -> None:
        """Advances the world to a time."""
        self._simulator.AdvanceTo(time_s)

    def set_rate(self, rate: float) -> None:
        """Sets the speed as a multiple of the clock's, if it can be reached; 0 is full speed."""
        self._simulator.set_target_realtime_rate(rate)
        self._simulator.ResetStatistics()

    def take_log(self) -> Log:
        """Returns the log since the last call or the start of the motion, and clears it."""
        found = {name: log.FindMutableLog(self._context) for name, log in self._logs.items()}
        num_joints = self.robot.num_joints
        state = found["state"].data().T
        log = Log(
            time_s=found["state"].sample_times().copy(),
            q=state[:, :num_joints].copy(),
            v=state[:, num_joints:].copy(),
            felt=found["sensation"].data().T.copy(),
            torque=found["torque"].data().T.copy(),
            q_steps=found["state_steps"].data().T[:, :num_joints].copy(),
        )
        for each in found.values():
            each.Clear()
        return log

    def _give_path(self, path: PiecewisePolynomial) -> None:
        self._source.UpdateTrajectory(path)
        # What was computed from the path before is void.
        self._context.SetTime(self.time_s)

    def _begin(self, path: PiecewisePolynomial, q: np.ndarray | None, beside: Any = None) -> None:
        if self._servo is not None:
            servo_context = self._servo.GetMyMutableContextFromRoot(self._context)
            self._servo.Begin(servo_context, beside, at_rest=q is not None)
        self._context.SetTime(0.0)
        self._give_path(path)
        if q is not None:
            plant = self.robot.plant
            plant_context = plant.GetMyMutableContextFromRoot(self._context)
            plant.SetPositions(plant_context, q)
            plant.SetVelocities(plant_context, np.zeros(self.robot.num_joints))
        for log in self._logs.values():
            log.FindMutableLog(self._context).Clear()
        # Delayed readings start with the present sensation.
        self._simulator.Initialize()
