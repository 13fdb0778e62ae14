"""How an agent moves its robot: the agent plans, the plan gets its times, the robot follows it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.motions import Execution, Motion, Plan
from selftouch_drake.agent.planning import checked_configuration, jerk_reduction
from selftouch_drake.agent.practice import DryRun
from selftouch_drake.agent.rehearsal import Try, rehearse
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
        straight: the plan before practice.
        motion: the timed plan, with what the agent expects to feel.
        seconds: s, duration of planning, practice, timing and prediction.
    """

    agent: Agent
    plan: Plan
    straight: Plan
    motion: Motion
    seconds: float

    @property
    def jerk_reduction(self) -> float:
        """How many times less jerk the plan has than straight steps between kernels."""
        return jerk_reduction(self.plan, self.agent.representation.joint_scale)


def execute(world: World, motion: Motion) -> tuple[Execution, Log]:
    """Lets the robot follow a motion from its start; the log has every step of the plant."""
    log = world.simulation.execute(motion.time_s, motion.q, motion.v)
    execution = Execution(
        motion=motion, felt=log.felt, q_measured=log.q, v_measured=log.v, torque=log.torque
    )
    return execution, log


class Pilot:
    """An agent in its world: plans become motions, and motions are executed.

    Args:
        agent: the agent that plans; a rehearsal replaces it by one that remembers more.
        world: its world.
    """

    def __init__(self, agent: Agent, world: World):
        self.agent = agent
        self.world = world
        self._limits = world.limits
        self._get_ready()

    def plan(self, *targets: int) -> Query:
        """Plans through two or more target sensations, in order.

        The motion starts at a configuration of the first, drawn from the seed.

        Raises:
            NoWayError: none was found.
            ValueError: as `Agent.tour`.
        """
        q_start = self.start_of(*targets)
        return self._queried(lambda agent, **how: agent.tour(targets, q_start=q_start, **how))

    def plan_from(self, q_start: np.ndarray, goal: int) -> Query:
        """Plans from any configuration, touching or not.

        Args:
            q_start: `(J,)` rad or m, where the joints are.
            goal: the target sensation to reach.

        Raises:
            NoWayError: none was found.
            ValueError: as `Agent.tour`, or `q_start` is outside the limits of the joints.
        """
        limits = self.world.robot.lower, self.world.robot.upper
        q_start = checked_configuration(q_start, self.agent.representation, limits)
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
        limits = self.world.robot.lower, self.world.robot.upper
        return self._queried(
            lambda agent, **how: agent.plan_from(q_start, felt, goal, limits=limits, **how)
        )

    def start_of(self, *targets: int) -> np.ndarray:
        """`(J,)` the start of the motion: any configuration of the first kernel."""
        representation = self.agent.representation
        members = representation.kernel_q[representation.members(targets[0])]
        stream = self.world.experiment.random_stream("start", *targets)
        return members[np.random.default_rng(stream).integers(len(members))].astype(float)

    def execute(self, motion: Motion) -> tuple[Execution, Log]:
        """Lets the robot follow a motion from its start; the log has every step of the plant."""
        beside = self.beside(motion) if self.world.experiment.execution.touch_servo else None
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
            max_tries: largest number of executions.
            known: an earlier try; the same motion is not executed again.

        Returns:
            The tries, in order; none if `known` is given and no way is found.

        Raises:
            NoWayError: none was found at the first try.
        """
        queries: list[Query] = []

        def attempt(agent: Agent) -> Try | None:
            self.agent = agent
            try:
                queries.append(self.plan(start, goal))
            except NoWayError:
                if not queries and known is None:
                    raise
                return None
            motion = queries[-1].motion
            if known is not None and np.array_equal(motion.q, known.execution.motion.q):
                return known
            execution, _ = execute(self.world, motion)
            return self.agent.judge(execution)

        def learn(one: Try, agent: Agent) -> Agent:
            query = queries[-1]
            return query.agent.practise(query.plan, one, self._slider)

        tries, self.agent = rehearse(attempt, learn, self.agent, max_tries=max_tries)
        return tries

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

    def _queried(self, make_plan: Callable[..., Plan]) -> Query:
        """Plans, practises the doubtful steps of the plan, and plans again."""
        began = time.perf_counter()
        first = make_plan(self.agent)
        agent, plan, passage = self._prepared(make_plan, first)
        if len(passage.impossible):
            in_air = partial(make_plan, lift_off=True)
            agent, plan, passage = self._prepared(in_air, in_air(self.agent))
            if len(passage.impossible):
                raise NoWayError(
                    f"no way to target {plan.nodes[-1]} was found on which the rigid parts of the "
                    "robot do not run into each other: choose another start or goal, or babble "
                    "longer"
                )
        motion = self._motion(agent, plan, passage)
        seconds = time.perf_counter() - began
        return Query(agent=agent, plan=plan, straight=first, motion=motion, seconds=seconds)

    def _motion(self, agent: Agent, plan: Plan, passage: DryRun) -> Motion:
        """The timed plan, with what the agent expects to feel after it followed it slowly."""
        timed = time_path(
            plan.path,
            velocity_limit=self._limits.velocity,
            acceleration_limit=self._limits.acceleration,
            rate_hz=1 / LOG_PERIOD,
        )
        return agent.motion(
            plan, time_s=timed.time_s, s=timed.s, q=timed.q, v=timed.v, passage=passage
        )

    def _get_ready(self) -> None:
        """Prepares everything that queries need, so that the first one takes no longer."""
        for edge in self.agent.representation.edges[:1].tolist():
            plan = self.agent.tour(edge)
            self._motion(self.agent, plan, self.agent.go_along(plan, self._slider))

    def _prepared(self, make_plan: Callable[..., Plan], plan: Plan) -> tuple[Agent, Plan, DryRun]:
        """The agent and its plan after practice, and what it felt along the plan.

        Parts of the robot that are in the way are moved aside.
        """
        agent, aside, slider = self.agent, None, self._slider
        passage = agent.go_along(plan, slider)
        for _ in range(_MOST_PREPARATIONS):
            if not len(passage.lost) and not len(passage.impossible):
                break
            if aside is None and (aside := agent.aside(plan, slider)) is not None:
                plan = make_plan(agent, aside=aside)
                passage = agent.go_along(plan, slider)
            before, doubtful = agent, np.union1d(passage.lost, passage.impossible)
            agent = agent.prepare(plan, doubtful, slider)
            if agent.memory.same_as(before.memory):
                break
            plan = make_plan(agent, aside=aside)
            passage = agent.go_along(plan, slider)
        return agent, plan, passage
