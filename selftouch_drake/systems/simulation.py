"""A running self-touch diagram with its logs: for plans, live play and babbling."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast
from weakref import WeakKeyDictionary

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, System
from pydrake.systems.primitives import LogVectorOutput
from pydrake.trajectories import PiecewisePolynomial

from selftouch_drake.experiment import Experiment
from selftouch_drake.robot.imperfections import slip
from selftouch_drake.robot.robot import BabblingJoints
from selftouch_drake.robot.skins import SkinModel
from selftouch_drake.robot.world import World
from selftouch_drake.systems.babbler import Babbler
from selftouch_drake.systems.plan_source import PlanSource
from selftouch_drake.systems.self_touch_diagram import MakeSelfTouchDiagram
from selftouch_drake.systems.touch_servo import TouchServo

if TYPE_CHECKING:
    from selftouch_drake.systems.skin_visualizer import SkinVisualizer

# s between two entries of the log.
LOG_PERIOD = 0.01

# The systems that show links and skins in Meshcat.
_SHOWN_BY = ("meshcat", "skin_visualizer")


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


class RunningDiagram:
    """A self-touch diagram that runs, whoever commands it.

    Drake 1.51 never frees a diagram with a Python system: each keeps 31 MB of the cube's
    robot (`benchmarks/cost/diagrams.py`). One serves any number of motions or walks: keep it.

    Args:
        experiment: of the robot.
        skins: its skins.
        commander: as in `MakeSelfTouchDiagram`.
        log_period: s, between two entries of the log; infinite if there is no log.
        every_step: whether torques and postures of every step of the plant are logged as well.
        meshcat: where to show it.
        full: N, the reading in the strongest colour there.

    Attributes:
        self_touch: the diagram of `MakeSelfTouchDiagram`.
        plant: in it.
        num_joints: J.
        slip: `(J,)` rad or m, by how much joints read more than their true position.
        log_period: s, as given.
    """

    def __init__(
        self,
        experiment: Experiment,
        skins: Sequence[SkinModel],
        commander: System,
        *,
        log_period: float = LOG_PERIOD,
        every_step: bool = True,
        meshcat: Meshcat | None = None,
        full: float | None = None,
    ):
        builder = DiagramBuilder()
        self.self_touch = MakeSelfTouchDiagram(
            experiment, commander, meshcat, skins=skins, full=full
        )
        builder.AddSystem(self.self_touch)
        station = self.self_touch.GetSubsystemByName("station")
        self.plant = cast(MultibodyPlant, station.GetSubsystemByName("plant"))
        self.num_joints = self.plant.num_positions()
        self.slip = slip(experiment, self.num_joints)
        self.log_period, step = log_period, experiment.execution.time_step
        logs = [("state", "state", log_period), ("sensation", "sensation", log_period)]
        if every_step:
            logs += [("torque", "torque", step), ("state_steps", "state", step)]
        self._logs = {
            name: LogVectorOutput(self.self_touch.GetOutputPort(port), builder, publish_period=each)
            for name, port, each in logs
            if np.isfinite(log_period)
        }
        self.diagram = builder.Build()
        self._simulator = Simulator(self.diagram)
        self._context = self._simulator.get_mutable_context()
        self._own_context = self.self_touch.GetMyContextFromRoot(self._context)
        self._state = self.self_touch.GetOutputPort("state")
        self._sensation = self.self_touch.GetOutputPort("sensation")
        self._command = commander.GetOutputPort("desired_state")
        self._commander_context = commander.GetMyMutableContextFromRoot(self._context)

    @property
    def time_s(self) -> float:
        """s, since the motion or the walk began."""
        return self._context.get_time()

    @property
    def q(self) -> np.ndarray:
        """`(J,)` rad or m, where the joints truly are."""
        return self._state.Eval(self._own_context)[: self.num_joints]

    @property
    def q_commanded(self) -> np.ndarray:
        """`(J,)` rad or m, where the joints are commanded to be, as they read.

        Where something presses on a skin, the joints stay behind their command.
        """
        return self._command.Eval(self._commander_context)[: self.num_joints]

    @property
    def q_read(self) -> np.ndarray:
        """`(J,)` rad or m, where the joints read that they are."""
        return self.q + self.slip

    @property
    def v(self) -> np.ndarray:
        """`(J,)` rad/s or m/s."""
        return self._state.Eval(self._own_context)[self.num_joints :]

    @property
    def felt(self) -> np.ndarray:
        """`(S,)` N, the sensation."""
        return self._sensation.Eval(self._own_context)

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

    def show(self) -> None:
        """Shows the present state in Meshcat, where it is shown at all."""
        for name in _SHOWN_BY:
            if self.self_touch.HasSubsystemNamed(name):
                system = self.self_touch.GetSubsystemByName(name)
                system.ForcedPublish(system.GetMyContextFromRoot(self._context))

    @property
    def visualizer(self) -> "SkinVisualizer":
        """The system that shows skins and readings, of a diagram that is shown."""
        return cast("SkinVisualizer", self.self_touch.GetSubsystemByName("skin_visualizer"))

    def pose(self, q: np.ndarray, time_s: float) -> None:
        """Shows the links at true positions `(J,)` q at a time, and not what is felt there.

        For what was simulated before: it leaves the robot there.
        """
        self._context.SetTime(time_s)
        self._put(q)
        system = self.self_touch.GetSubsystemByName(_SHOWN_BY[0])
        system.ForcedPublish(system.GetMyContextFromRoot(self._context))

    def take_log(self) -> Log:
        """Returns the log since the last call or the start of the motion, and clears it."""
        found = {name: log.FindMutableLog(self._context) for name, log in self._logs.items()}
        num_joints, steps = self.num_joints, np.zeros((0, self.num_joints))
        state = found["state"].data().T
        each_step = "torque" in found
        log = Log(
            time_s=found["state"].sample_times().copy(),
            q=state[:, :num_joints].copy(),
            v=state[:, num_joints:].copy(),
            felt=found["sensation"].data().T.copy(),
            torque=found["torque"].data().T.copy() if each_step else steps,
            q_steps=found["state_steps"].data().T[:, :num_joints].copy() if each_step else steps,
        )
        for each in found.values():
            each.Clear()
        return log

    def _put(self, q: np.ndarray, v: np.ndarray | None = None) -> None:
        """Puts the robot at true positions `(J,)`, at rest or at rates `(J,)`."""
        plant_context = self.plant.GetMyMutableContextFromRoot(self._context)
        self.plant.SetPositions(plant_context, q)
        self.plant.SetVelocities(plant_context, np.zeros(self.num_joints) if v is None else v)

    def _restart(self) -> None:
        """Clears the log, and begins at the present time: delayed readings with what is felt."""
        for log in self._logs.values():
            log.FindMutableLog(self._context).Clear()
        self._simulator.Initialize()


class Simulation(RunningDiagram):
    """A robot under dynamics that follows paths.

    Args:
        experiment: as in `RunningDiagram`, as is `how`.
        skins: likewise.
        num_joints: J, if it is known already.
    """

    def __init__(
        self,
        experiment: Experiment,
        skins: Sequence[SkinModel],
        *,
        num_joints: int | None = None,
        **how: Any,
    ):
        self._source = PlanSource(
            num_joints=num_joints or len(BabblingJoints.of(experiment).lower),
            num_receptors=sum(skin.fields.num_receptors for skin in skins),
        )
        self._source.set_name("path_source")
        super().__init__(experiment, skins, self._source, **how)
        self._servo: TouchServo | None = None
        if experiment.execution.touch_servo:
            self._servo = cast(TouchServo, self.self_touch.GetSubsystemByName("touch_servo"))

    def rest_at(self, q: np.ndarray) -> None:
        """Puts the robot at rest at `(J,)` q, as its joints read, and starts its time there."""
        q = np.asarray(q, dtype=float)
        self._begin(PiecewisePolynomial(q[:, None]), q)

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
        path = PiecewisePolynomial.CubicHermite(time_s, q.T, v.T)
        self._begin(path, q[0] if jump else None, beside)

    def take_over(self, q_commanded: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Goes on with a robot at true positions `(J,)` q, at rates v, commanded to rest."""
        self._begin(PiecewisePolynomial(q_commanded[:, None]), None)
        self._put(q, v)
        self._restart()

    def lead_through(self, q: np.ndarray, time_s: np.ndarray | float) -> None:
        """Leads the joints through `(n, J)` q, as they read, at constant velocities between them.

        They are led from where they are commanded to be, and pass each q at its time `(n,)` s; it
        may be one q `(J,)` and its time. Time and the log go on, as they do not where a motion
        begins.
        """
        q, time_s = np.atleast_2d(q), np.atleast_1d(time_s)
        # Then the command rests: the last node holds for a while.
        nodes = np.concatenate([self.q_commanded[None], q, q[-1:]])
        times = np.concatenate([[self.time_s], time_s, time_s[-1:] + LOG_PERIOD])
        path = PiecewisePolynomial.FirstOrderHold(times, nodes.T)
        self._source.SetPath(self._commander_context, path)
        self.advance_to(time_s[-1])

    def _begin(self, path: PiecewisePolynomial, q: np.ndarray | None, beside: Any = None) -> None:
        if self._servo is not None:
            servo_context = self._servo.GetMyMutableContextFromRoot(self._context)
            self._servo.Begin(servo_context, beside, at_rest=q is not None)
        self._context.SetTime(0.0)
        self._source.SetPath(self._commander_context, path)
        if q is not None:
            self._put(q - self.slip)
        self._restart()


class Babbling(RunningDiagram):
    """A robot under dynamics that babbles; arguments as in `RunningDiagram` and `Babbler`."""

    def __init__(
        self,
        experiment: Experiment,
        skins: Sequence[SkinModel],
        *,
        joints: BabblingJoints | None = None,
        **how: Any,
    ):
        self.babbler = Babbler(experiment, joints=joints)
        self.babbler.set_name("babbler")
        super().__init__(experiment, skins, self.babbler, every_step=False, **how)

    def begin(self, walk: int) -> None:
        """Puts the robot at rest where a walk begins, and starts its time there."""
        self._context.SetTime(0.0)
        self.babbler.SetWalk(self._commander_context, walk)
        self._put(self.babbler.first_node(walk))
        self._restart()

    def go_on_to(
        self, walk: int, q: np.ndarray, v: np.ndarray, q_from: np.ndarray, approach_s: float
    ) -> None:
        """Begins a walk with a robot that travels to it, with the approach as in `SetWalk`.

        It truly is at `(J,)` q, at rates `(J,)`. What it feels on the way there is not logged.
        """
        self._context.SetTime(0.0)
        self.babbler.SetWalk(self._commander_context, walk, q_from=q_from, approach_s=approach_s)
        self._put(q, v)
        self._restart()
        self.advance_to(approach_s)
        self.take_log()


_OF_WORLDS: "WeakKeyDictionary[World, Simulation]" = WeakKeyDictionary()


def simulation_of(world: World) -> Simulation:
    """The simulation in which a world's plans are executed; the same for each call.

    Older Drakes never free a diagram with a Python system: a world keeps one.
    """
    if world not in _OF_WORLDS:
        _OF_WORLDS[world] = Simulation(
            world.experiment, world.skins, num_joints=world.robot.num_joints
        )
    return _OF_WORLDS[world]
