"""How an agent moves its robot: the agent plans, the plan gets its times, the robot follows it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.motions import Execution, Motion, Plan
from selftouch_drake.agent.planning import Limits, checked_configuration
from selftouch_drake.agent.planning.timing import time_path
from selftouch_drake.agent.practice import DryRun, NoWayError, dry_run, learn_from, practise
from selftouch_drake.agent.rehearsal import Try, judge
from selftouch_drake.agent.sliding import Slider
from selftouch_drake.agent.touch_profile import felt_across
from selftouch_drake.evaluation import jerk_reduction
from selftouch_drake.robot import LOG_PERIOD, Log, World
from selftouch_drake.robot.servo import OFFSETS, Beside

# m, less than the allowed depth of rigid parts in each other: executions are off by less.
_MARGIN = 0.0005


class _KinematicWorld:
    """Where the agent practises: its robot without dynamics."""

    def __init__(self, world: World):
        self.lower, self.upper = world.robot.lower, world.robot.upper
        self._probe = world.probe

    def feel(self, q: np.ndarray) -> np.ndarray:
        return self._probe.sensations(q)

    def possible(self, q: np.ndarray) -> np.ndarray:
        return self._probe.collision_depth(q, _MARGIN) == 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Query:
    """The answer to a request for a motion.

    Attributes:
        agent: the agent that planned, after its practice.
        plan: the plan.
        unpractised: the plan before practice: as the agent makes it from what it has learned and
            remembers, never followed.
        motion: the timed plan, with what the agent expects to feel.
        seconds: s, duration of planning, practice, timing and prediction.
    """

    agent: Agent
    plan: Plan
    unpractised: Plan
    motion: Motion
    seconds: float

    @property
    def jerk_reduction(self) -> float:
        """How many times less jerk the plan has than straight steps between kernels."""
        return jerk_reduction(self.plan, self.agent.representation.joint_scale)


class Pilot:
    """An agent in its world: plans become motions, and motions are executed.

    Args:
        agent: the agent that plans; a rehearsal replaces it by one that remembers more.
        world: its world.
    """

    def __init__(self, agent: Agent, world: World):
        self.agent = agent
        self.world = world

    def get_ready(self) -> None:
        """Prepares everything that queries need, so that the first one takes no longer."""
        for edge in self.agent.representation.edges[:1].tolist():
            plan = self.agent.tour(edge)
            self.motion(plan, dry_run(plan, self._slider))

    def plan(self, *targets: int) -> Query:
        """Plans through two or more target sensations, in order.

        The motion starts at a configuration of the first, drawn from the seed.

        Raises:
            NoWayError: none was found.
            ValueError: as `Agent.tour`.
        """
        return self._query(targets, self.start_of(*targets))

    def plan_from(self, q_start: np.ndarray, goal: int) -> Query:
        """Plans from any configuration, touching or not.

        Args:
            q_start: `(J,)` rad or m, where the joints are.
            goal: the target sensation to reach.

        Raises:
            NoWayError: none was found.
            ValueError: as `Agent.tour`, or `q_start` is outside the limits of the joints.
        """
        q_start = checked_configuration(q_start, self.agent.representation, self._range)
        (felt,) = self.world.probe.sensations(q_start[None])
        return self.plan_feeling(q_start, felt, goal)

    def plan_feeling(self, q_start: np.ndarray, felt: np.ndarray, goal: int) -> Query:
        """Like `plan_from`, with the sensation at the start already known.

        Args:
            q_start: `(J,)` rad or m, where the joints are.
            felt: `(S,)` N, the sensation there.
            goal: the target sensation to reach.

        Raises:
            NoWayError: none was found.
        """
        return self._query([self.agent.felt(felt), goal], q_start, self._range)

    def start_of(self, *targets: int) -> np.ndarray:
        """`(J,)` the start of the motion: any configuration of the first kernel."""
        representation = self.agent.representation
        members = representation.kernel_q[representation.members(targets[0])]
        stream = self.world.experiment.random_stream("start", *targets)
        return members[np.random.default_rng(stream).integers(len(members))].astype(float)

    def motion(self, plan: Plan, felt: DryRun | None = None) -> Motion:
        """The timed plan, with what the agent expects to feel.

        Args:
            plan: the plan.
            felt: what it felt when it followed the plan slowly; without, it expects what it
                knows from stored touches.
        """
        timed = time_path(
            plan.path,
            velocity_limit=self.world.limits.velocity,
            acceleration_limit=self.world.limits.acceleration,
            rate_hz=1 / LOG_PERIOD,
        )
        return self.agent.motion(
            plan, time_s=timed.time_s, s=timed.s, q=timed.q, v=timed.v, dry_run=felt
        )

    def execute(self, motion: Motion, *, practised: bool = True) -> tuple[Execution, Log]:
        """Lets the robot follow a motion from its start; the log has every step of the plant.

        Args:
            motion: the motion.
            practised: whether the agent may feel beside the motion first, which the touch servo
                needs: without practice the servo rests.
        """
        serves = self.world.experiment.execution.touch_servo and practised
        beside = self.beside(motion) if serves else None
        log = self.world.simulation.execute(motion.time_s, motion.q, motion.v, beside)
        execution = Execution(
            motion=motion, felt=log.felt, q_measured=log.q, v_measured=log.v, torque=log.torque
        )
        return execution, log

    def beside(self, motion: Motion) -> Beside:
        """What the agent feels beside a motion, for the touch servo."""
        felt = felt_across(motion, OFFSETS, self._slider)
        return Beside(
            time_s=felt.time_s,
            across=felt.across,
            joint_scale=self.agent.representation.joint_scale,
            strength=felt.strength,
        )

    def rehearse(
        self, start: int, goal: int, *, max_tries: int, known: Try | None = None
    ) -> list[Try]:
        """Plans and executes until contact is never lost; the agent remembers what it learned.

        Where it lost contact, the agent practises by sliding along before it tries again.

        Args:
            start: the target sensation to start from.
            goal: the target sensation to reach.
            max_tries: largest number of executions, at least one.
            known: an earlier try; the same motion is not executed again.

        Returns:
            The tries, in order (`best` chooses the one to keep); none if `known` is given and no
            way is found.

        Raises:
            NoWayError: none was found at the first try.
            ValueError: `max_tries` is below one.
        """
        if max_tries < 1:
            raise ValueError(f"max_tries is {max_tries}: give at least 1")
        tries: list[Try] = []
        while len(tries) < max_tries and not (tries and tries[-1].perfect):
            try:
                query = self.plan(start, goal)
            except NoWayError:
                if tries or known is not None:
                    break
                raise
            if known is not None and np.array_equal(query.motion.q, known.execution.motion.q):
                tries.append(known)
            else:
                execution, _ = self.execute(query.motion)
                tries.append(judge(execution, self.agent.representation))
            self.agent = learn_from(tries[-1], query.agent, self._slider)
        return tries

    @property
    def _range(self) -> Limits:
        """Limits of the joints."""
        return self.world.robot.lower, self.world.robot.upper

    @cached_property
    def _slider(self) -> Slider:
        """The slider of the agent: it feels, and knows which configurations are possible."""
        return Slider(_KinematicWorld(self.world), self.agent.representation.joint_scale)

    def _query(
        self, targets: Sequence[int | None], q_start: np.ndarray, limits: Limits | None = None
    ) -> Query:
        """Plans and practises the plan."""
        began = time.perf_counter()
        done = practise(self.agent, self._slider, targets, q_start=q_start, limits=limits)
        motion = self.motion(done.plan, done.dry_run)
        return Query(
            agent=done.agent,
            plan=done.plan,
            unpractised=done.unpractised,
            motion=motion,
            seconds=time.perf_counter() - began,
        )
