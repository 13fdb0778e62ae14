"""Robots in Drake as bodies: without dynamics, and under dynamics.

What they return also holds what only the experimenter may know: contacts, and the log of the
simulation. An agent has no use for it.
"""

import dataclasses
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from selftouch_drake.agent.body import Felt, Followed, TouchProfile
from selftouch_drake.experience.store import Contacts
from selftouch_drake.experience.walk import BATCH_S
from selftouch_drake.experiment import Experiment
from selftouch_drake.robot import Touches, World
from selftouch_drake.robot.imperfections import remembered
from selftouch_drake.robot.robot import BabblingJoints
from selftouch_drake.systems.simulation import (
    Babbling,
    Log,
    RunningDiagram,
    Simulation,
    simulation_of,
)
from selftouch_drake.systems.touch_servo import OFFSETS

# s between two samples of a babbling robot, in which a fingertip moves by a few millimetres.
_BABBLING_PERIOD = 0.02

# Share of the velocity limits with which a body that cannot jump travels to where it feels; s that
# it then waits; rad or m by which its joints may be off there.
_SLOWLY, _SETTLED_S, _OFF = 0.5, 0.2, 0.01

# Share of a period by which a time may miss its end.
_ROUNDING = 1e-6

# m, less than the allowed depth of rigid parts in each other: executions are off by less.
_MARGIN = 0.0005


class DrakeFelt(Felt):
    """What a robot feels; each part is computed when it is first used.

    Args:
        world: of the robot.
        q: `(n, J)` rad or m, where it truly is.
        margin: m, by which rigid parts must be less deep in each other than the robot allows.
        touches: what is felt there, if it is known.
    """

    _world: World
    _q: np.ndarray
    _margin: float

    def __init__(self, world: World, q: np.ndarray, margin: float, touches: Touches | None = None):
        vars(self).update(_world=world, _q=q, _margin=margin)
        if touches is not None:
            vars(self).update(_touches=touches)

    @cached_property
    def q(self) -> np.ndarray:  # type: ignore[override]
        """`(n, J)` where the joints read that they are."""
        return remembered(self._world.experiment, self._q)

    @property
    def sensation(self) -> np.ndarray:  # type: ignore[override]
        """`(n, S)` N."""
        return self._touches.sensation

    @cached_property
    def reached(self) -> np.ndarray:  # type: ignore[override]
        """`(n,)` whether the robot can be there: its rigid parts do not collide."""
        return ~self._world.probe.impossible(self._q, self._margin)

    @property
    def contacts(self) -> Contacts:
        """The contacts behind what is felt: the truth."""
        return Contacts.of_rows(self._touches, np.arange(len(self._q)))

    def touches(self) -> "tuple[np.ndarray, DrakeFelt]":
        """The rows in which something is felt, and what was felt there."""
        if "_touches" in vars(self):
            rows = np.flatnonzero(self.sensation.any(axis=1))
            return rows, self.of_rows(rows)
        # Where touches are rare, this takes a fraction of the time of all readings.
        rows, touches = self._world.probe.touching(self._q)
        return rows, DrakeFelt(self._world, self._q[rows], self._margin, touches)

    def of_rows(self, rows: np.ndarray) -> "DrakeFelt":
        """What was felt at some of the configurations, in ascending order."""
        touches = self._touches.of_rows(rows) if "_touches" in vars(self) else None
        return DrakeFelt(self._world, self._q[rows], self._margin, touches)

    @cached_property
    def _touches(self) -> Touches:
        return self._world.probe.touches(self._q)


class _Joints:
    """What every body of a robot in Drake has."""

    def __init__(self, world: World):
        robot, limits = world.robot, world.limits
        self.world = world
        self.joint_names: Sequence[str] = list(robot.joint_names)
        self.lower, self.upper = robot.lower, robot.upper
        self.velocity, self.acceleration = limits.velocity, limits.acceleration
        self.num_receptors = world.experiment.num_receptors
        self.babbling_joints = BabblingJoints.of_plant(robot.plant, world.experiment)
        self.unit = self.babbling_joints.unit


class DrakeBody(_Joints):
    """A robot without dynamics: it can be at any configuration at once; margin as in `DrakeFelt`.

    Attributes:
        unit: `(J,)` how far a joint moves where a revolute one turns by a radian.
    """

    jumps = True

    def __init__(self, world: World, margin: float = 0.0):
        super().__init__(world)
        self._margin = margin

    def feel(self, q: np.ndarray) -> "DrakeFelt":
        """What is felt at `(n, J)` configurations."""
        return DrakeFelt(self.world, q, self._margin)

    def follow(self, time_s: np.ndarray, q: np.ndarray) -> Followed:
        """The motion as it was asked for: without dynamics, the robot does not lag behind."""
        return Followed(time_s=time_s, q=q, sensation=self.feel(q).sensation)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class DrakeFollowed(Followed):
    """What a robot measured, with what only the experimenter may know.

    Attributes:
        log: of the simulation.
        world: of the robot.
    """

    log: Log
    world: World

    def felt(self) -> "DrakeFelt":
        """What was felt at each sample."""
        return _logged(self.world, self.log)


def _logged(world: World, log: Log) -> DrakeFelt:
    """What was felt at each sample of a log; contacts are computed anew at the configurations."""
    q = log.q.astype(np.float32)
    touches = dataclasses.replace(world.probe.touches(q), sensation=log.felt)
    return DrakeFelt(world, q, 0.0, touches)


def rates_through(time_s: np.ndarray, q: np.ndarray) -> np.ndarray:
    """`(T, J)` rates at which a body passes `(T, J)` positions, from rest to rest.

    Bodies are given positions alone, so they draw a course of their own: a cubic spline, at rest at
    both ends. Along a motion of the agent this is the course that `PlanSource` takes with the
    motion's own rates, within 1e-6 rad, and 3e-4 rad/s.
    """
    return CubicSpline(time_s, q, bc_type="clamped")(time_s, 1)


class DrakeDynamicBody(_Joints):
    """A robot under dynamics: joint controllers, gravity, limits of effort, contact forces.

    Args:
        world: of the robot.
        simulation: of the robot; by default that of the world.
        jumps: whether it may be put anywhere at rest, as a simulation may; otherwise it travels.

    Attributes:
        unit: as in `DrakeBody`.
        offsets: `(G,)` mu, displacements that the touch servo distinguishes.
        robot_s: s, time of the robot so far.
    """

    offsets = OFFSETS

    def __init__(self, world: World, simulation: Simulation | None = None, *, jumps: bool = True):
        super().__init__(world)
        if simulation is not None:
            self._simulation = simulation
        self.jumps = jumps
        self.robot_s = 0.0
        # Where the last motion ended; at birth the robot is put where it first goes.
        self._at: np.ndarray | None = None

    @cached_property
    def _simulation(self) -> Simulation:
        # It takes as long to build as a plan; who only plans needs none.
        return simulation_of(self.world)

    def feel(self, q: np.ndarray) -> "DrakeFelt":
        """What is felt at `(n, J)` configurations, after the robot came to rest at each."""
        there, felt = [], []
        for one in q:
            self._go_to(one)
            self._simulation.advance(_SETTLED_S)
            there.append(self._simulation.q_read)
            felt.append(self._simulation.felt)
        self._simulation.take_log()
        q_there = np.array(there).reshape(q.shape)
        touches = dataclasses.replace(
            self.world.probe.touches(q_there),
            sensation=np.array(felt).reshape(len(q), self.num_receptors),
        )
        found = DrakeFelt(self.world, q_there, 0.0, touches)
        near = (np.abs(q_there - q) <= _OFF * self.unit).all(axis=1)
        vars(found)["reached"] = found.reached & near
        return found

    def follow(self, time_s: np.ndarray, q: np.ndarray) -> DrakeFollowed:
        """Follows a motion with its joint controllers."""
        if self._at is None or (self.jumps and not np.array_equal(q[0], self._at)):
            return self._jump_and_follow(time_s, q)
        self._go_to(q[0])
        return self._lead_through(time_s, q)

    def _lead_through(self, time_s: np.ndarray, q: np.ndarray) -> DrakeFollowed:
        """Follows a motion in straight pieces, from its first configuration, where the body is."""
        began = self._simulation.time_s
        # Samples are taken exactly at times from which sums of durations have drifted.
        until, period = began + time_s[1:], self._simulation.log_period
        nearest = period * np.rint(until / period)
        until = np.where(np.abs(nearest - until) < _ROUNDING * period, nearest, until)
        self._simulation.lead_through(q[1:], until)
        return self._followed(q, began)

    def follow_beside(self, time_s: np.ndarray, q: np.ndarray, beside: TouchProfile) -> Followed:
        """As `follow`, with the touch servo."""
        return self._jump_and_follow(time_s, q, beside)

    def _jump_and_follow(
        self, time_s: np.ndarray, q: np.ndarray, beside: TouchProfile | None = None
    ) -> DrakeFollowed:
        self._simulation.follow(time_s, q, rates_through(time_s, q), jump=True, beside=beside)
        # Whole periods of the log, so that the last sample is not before the end.
        period = self._simulation.log_period
        self._simulation.advance_to(period * np.ceil(time_s[-1] / period - _ROUNDING))
        return self._followed(q, 0.0)

    def _go_to(self, q: np.ndarray) -> None:
        """Goes to `(J,)` q, at rest: at once if it may jump, else in a straight line, slowly."""
        if self._at is not None and np.array_equal(q, self._at):
            return
        if self.jumps or self._at is None:
            self._simulation.rest_at(q)
        else:
            duration = float(np.max(np.abs(q - self._at) / self.velocity)) / _SLOWLY
            self._simulation.lead_through(q, self._simulation.time_s + max(duration, _SETTLED_S))
            self.robot_s += duration
        self._simulation.take_log()
        self._at = np.array(q, dtype=float)

    def _followed(self, q: np.ndarray, began: float) -> DrakeFollowed:
        self._at = np.array(q[-1], dtype=float)
        log = self._simulation.take_log()
        self.robot_s += self._simulation.time_s - began
        return DrakeFollowed(
            time_s=log.time_s - began,
            q=log.q + self._simulation.slip,
            sensation=log.felt,
            v=log.v,
            torque=log.torque,
            log=log,
            world=self.world,
        )


class DrakeBabblingBody(DrakeDynamicBody):
    """A robot under dynamics that babbles: its `Babbler` leads it along random walks.

    Where an agent chooses the way, the body follows it in straight pieces too.

    Args:
        world: of the robot.
        experiment: as it is while the robot babbles.
    """

    def __init__(self, world: World, experiment: Experiment):
        super().__init__(world, jumps=experiment.babbling.jumps)
        self._experiment = experiment
        # The diagram in which the robot is now; there is none before its first walk.
        self._running: RunningDiagram

    @cached_property
    def _simulation(self) -> Simulation:
        return Simulation(
            self._experiment,
            self.world.skins,
            num_joints=len(self.lower),
            log_period=_BABBLING_PERIOD,
        )

    @cached_property
    def _babbling(self) -> Babbling:
        return Babbling(
            self._experiment,
            self.world.skins,
            joints=self.babbling_joints,
            log_period=_BABBLING_PERIOD,
        )

    def babble(self, walk: int) -> Callable[[], DrakeFelt]:
        """Begins a random walk; each call of what is returned goes on for ten seconds.

        A body that cannot jump travels to the first node, slowly, from where it is.
        """
        babbling = self._babbling
        first = babbling.babbler.first_node(walk)
        if self.jumps or self._at is None:
            babbling.begin(walk)
        else:
            needs = float(np.max(np.abs(first - self._at) / self.velocity)) / _SLOWLY
            approach_s = max(needs, _SETTLED_S)
            q, v = self._running.q.copy(), self._running.v.copy()
            babbling.go_on_to(walk, q, v, self._at, approach_s)
            self.robot_s += approach_s
        self._running, began, num_batches = babbling, babbling.time_s, 0

        def go_on() -> DrakeFelt:
            nonlocal num_batches
            num_batches += 1
            # Counted, so that sums of durations do not drift.
            babbling.advance_to(began + num_batches * BATCH_S)
            self.robot_s += BATCH_S
            self._at = babbling.q_commanded
            return _logged(self.world, babbling.take_log())

        self._at = first
        return go_on

    def feel(self, q: np.ndarray) -> DrakeFelt:
        """As in `DrakeDynamicBody`."""
        self._leave_the_walk()
        return super().feel(q)

    def follow(self, time_s: np.ndarray, q: np.ndarray) -> DrakeFollowed:
        """As in `DrakeDynamicBody`, in straight pieces."""
        self._leave_the_walk()
        return super().follow(time_s, q)

    def _leave_the_walk(self) -> None:
        """The robot goes on in the diagram of paths, from where it is and as fast as it is."""
        if self._at is not None and self._running is not self._simulation:
            self._simulation.take_over(self._at, self._running.q.copy(), self._running.v.copy())
        self._running = self._simulation

    def _jump_and_follow(
        self, time_s: np.ndarray, q: np.ndarray, beside: TouchProfile | None = None
    ) -> DrakeFollowed:
        self._simulation.rest_at(q[0])
        return self._lead_through(time_s, q)


def while_babbling(experiment: Experiment) -> Experiment:
    """An experiment as it is while a robot babbles: no joint has slipped, and nobody plans."""
    joints = dataclasses.replace(experiment.joints, offset=0.0)
    execution = dataclasses.replace(experiment.execution, touch_servo=False)
    return dataclasses.replace(experiment, joints=joints, execution=execution)


class DrakeBodies:
    """The bodies of a robot in Drake: for babbling, for practice, and to act."""

    def __init__(self, world: World):
        self.world = world

    @cached_property
    def babbling(self) -> DrakeBody | DrakeBabblingBody:
        """As the experiment says: without dynamics, or under dynamics."""
        experiment = self.world.experiment
        if experiment.babbling.mode == "kinematic":
            return self.still
        return DrakeBabblingBody(self.world, while_babbling(experiment))

    @cached_property
    def still(self) -> DrakeBody:
        """Without dynamics."""
        return DrakeBody(self.world)

    @cached_property
    def practice(self) -> DrakeBody:
        """Without dynamics; a little more careful than the robot must be."""
        return DrakeBody(self.world, _MARGIN)

    @cached_property
    def acting(self) -> DrakeDynamicBody:
        """Under dynamics."""
        return DrakeDynamicBody(self.world)
