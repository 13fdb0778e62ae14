"""How an agent moves its robot: the agent plans, the plan gets its times, the robot follows it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.motions import Execution, Motion, Plan
from selftouch_drake.agent.planning import Limits, checked_configuration, jerk_reduction
from selftouch_drake.agent.practice import DryRun
from selftouch_drake.agent.rehearsal import Try
from selftouch_drake.agent.sliding import Slider
from selftouch_drake.robot import LOG_PERIOD, Log, World
from selftouch_drake.robot.servo import OFFSETS, Beside
from selftouch_drake.robot.timing import time_path

# m, less than the allowed depth of rigid parts in each other: executions are off by less.
_MARGIN = 0.0005

# The agent plans round steps without another way; the new plan may have other doubtful steps.
_MOST_PREPARATIONS = 8


class NoWayError(ValueError):
    """No motion was found that keeps the rigid parts of the robot apart."""


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


@dataclass(frozen=True, slots=True, eq=False)
class _Request:
    """What an agent is asked to plan; the fields are arguments of `Agent.tour`."""

    targets: Sequence[int | None]
    q_start: np.ndarray
    limits: Limits | None
    lift_off: bool = False

    def plan(self, agent: Agent, aside: np.ndarray | None = None) -> Plan:
        """The plan of an agent."""
        return agent.tour(
            self.targets,
            q_start=self.q_start,
            aside=aside,
            lift_off=self.lift_off,
            limits=self.limits,
        )


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
            self.motion(plan, self.agent.go_along(plan, self._slider))

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

    def motion(self, plan: Plan, passage: DryRun | None = None) -> Motion:
        """The timed plan, with what the agent expects to feel.

        Args:
            plan: the plan.
            passage: what it felt when it followed the plan slowly; without, it expects what it
                knows from stored touches.
        """
        timed = time_path(
            plan.path,
            velocity_limit=self.world.limits.velocity,
            acceleration_limit=self.world.limits.acceleration,
            rate_hz=1 / LOG_PERIOD,
        )
        return self.agent.motion(
            plan, time_s=timed.time_s, s=timed.s, q=timed.q, v=timed.v, passage=passage
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
        felt = self.agent.felt_across(motion, OFFSETS, self._slider)
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
                tries.append(self.agent.judge(execution))
            self.agent = query.agent.practise(query.plan, tries[-1], self._slider)
        return tries

    @property
    def _range(self) -> Limits:
        """Limits of the joints."""
        return self.world.robot.lower, self.world.robot.upper

    @cached_property
    def _slider(self) -> Slider:
        """The slider of the agent: it feels, and knows which configurations are possible."""
        scaled, unscaled = self.agent.representation.scaled, self.agent.representation.unscaled
        probe, robot = self.world.probe, self.world.robot
        return Slider(
            feel=lambda x: probe.sensations(unscaled(x)),
            possible=lambda x: probe.collision_depth(unscaled(x), _MARGIN) == 0,
            lower=scaled(robot.lower),
            upper=scaled(robot.upper),
        )

    def _query(
        self, targets: Sequence[int | None], q_start: np.ndarray, limits: Limits | None = None
    ) -> Query:
        """Plans, practises the doubtful steps of the plan, and plans again."""
        began = time.perf_counter()
        request = _Request(targets, q_start, limits)
        unpractised = request.plan(self.agent)
        agent, plan, passage = self._practised(request, unpractised)
        if len(passage.impossible):
            in_air = replace(request, lift_off=True)
            agent, plan, passage = self._practised(in_air, in_air.plan(self.agent))
            if len(passage.impossible):
                raise NoWayError(
                    f"no way to target {plan.nodes[-1]} was found on which the rigid parts of the "
                    "robot do not run into each other: choose another start or goal, or babble "
                    "longer"
                )
        motion = self.motion(plan, passage)
        seconds = time.perf_counter() - began
        return Query(
            agent=agent, plan=plan, unpractised=unpractised, motion=motion, seconds=seconds
        )

    def _practised(self, request: _Request, plan: Plan) -> tuple[Agent, Plan, DryRun]:
        """The agent and its plan after practice, and what it felt along the plan.

        Parts of the robot that are in the way are moved aside.
        """
        agent, aside, slider = self.agent, None, self._slider
        passage = agent.go_along(plan, slider)
        for _ in range(_MOST_PREPARATIONS):
            if not len(passage.lost) and not len(passage.impossible):
                break
            if aside is None and (aside := agent.aside(plan, slider)) is not None:
                plan = request.plan(agent, aside)
                passage = agent.go_along(plan, slider)
            before, doubtful = agent, np.union1d(passage.lost, passage.impossible)
            agent = agent.prepare(plan, doubtful, slider)
            if agent.memory.same_as(before.memory):
                break
            plan = request.plan(agent, aside)
            passage = agent.go_along(plan, slider)
        return agent, plan, passage
