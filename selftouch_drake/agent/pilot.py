"""How an agent moves its body: it plans, practises, gives the plan its times, and executes it.

Everything it does in a world goes through its body (naive).
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body import Body, Followed, ServoedBody, TouchProfile
from selftouch_drake.agent.motions import Execution, Motion, Plan
from selftouch_drake.agent.planning.novelty import Recorded
from selftouch_drake.agent.planning.planner import checked_configuration
from selftouch_drake.agent.planning.timing import time_path
from selftouch_drake.agent.practice.dry_run import DryRun, dry_run
from selftouch_drake.agent.practice.practise import NoWayError, practise, remembering
from selftouch_drake.agent.practice.sliding import Slider
from selftouch_drake.agent.practice.touch_profile import felt_across
from selftouch_drake.agent.tries import Try, judged_try
from selftouch_drake.quotient.plan import Limits
from selftouch_drake.randomness import random_stream

#: Hz, rate of the samples of a timed motion.
RATE_HZ = 100.0

#: s, rest at the end of a motion of a body that travels, until its joints have arrived. Without it,
#: an arm under dynamics that soft contact pushes off feels 63 instead of 94 % of its goals.
_REST_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlannedMotion:
    """A motion that is ready to be executed, and how it came about.

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


class Pilot:
    """An agent in its body: plans become motions, and motions are executed.

    Args:
        agent: the agent that plans; a rehearsal replaces it by one that remembers more.
        body: its body, which executes motions.
        practice: the body in which it practises plans, slowly; by default the same one.
        seed: decides where motions start.
        touch_servo: whether motions are executed with the touch servo; the body must have one.
    """

    def __init__(
        self,
        agent: Agent,
        body: Body,
        practice: Body | None = None,
        *,
        seed: int = 0,
        touch_servo: bool = False,
    ):
        self.agent = agent
        self.body = body
        self.practice = body if practice is None else practice
        self._seed, self._touch_servo = seed, touch_servo

    def prepare_queries(self) -> None:
        """Prepares everything that queries need, so that the first one takes no longer."""
        for edge in self.agent.representation.edges[:1].tolist():
            plan = self.agent.plan(*edge)
            self.motion(plan, dry_run(plan, self._slider))

    def plan(self, *targets: int) -> PlannedMotion:
        """Plans through two or more target sensations, in order.

        The motion starts at a configuration of the first, as in `start_of`.

        Raises:
            NoWayError: none was found.
            ValueError: as `Agent.plan`.
        """
        return self._planned(targets, self.start_of(*targets))

    def plan_from(self, q_start: np.ndarray, goal: int) -> PlannedMotion:
        """Plans from any configuration `(J,)`, touching or not, to a target sensation.

        Raises:
            NoWayError: none was found.
            ValueError: as `Agent.plan`, or `q_start` is outside the limits of the joints.
        """
        limits = self.body.lower, self.body.upper
        q_start = checked_configuration(q_start, self.agent.representation, limits)
        return self.plan_feeling(q_start, self.practice.feel(q_start[None]).sensation[0], goal)

    def plan_feeling(self, q_start: np.ndarray, felt: np.ndarray, goal: int) -> PlannedMotion:
        """Like `plan_from`, with the sensation at the start, `(S,)` N, already known."""
        limits = self.body.lower, self.body.upper
        return self._planned([self.agent.target_felt(felt), goal], q_start, limits)

    def start_of(self, *targets: int) -> np.ndarray:
        """`(J,)` where the motion starts: a configuration of the first kernel.

        The seed draws it for a body that jumps. A body that travels has to go there first. It
        starts where the plan strays least from what was recorded, among the places that it reaches.
        """
        known = self.agent.representation
        if not self.body.jumps:
            starts = [p.waypoints_q[0] for p in Recorded(known).surest(targets, self.agent.plan)]
            return next((q for q in starts if self.practice.feel(q[None]).reached[0]), starts[0])
        members = known.kernel_q[known.members(targets[0])]
        rng = np.random.default_rng(random_stream(self._seed, "start", *targets))
        return members[rng.integers(len(members))].astype(float)

    def motion(self, plan: Plan, last_run: DryRun | None = None) -> Motion:
        """The timed plan, with what the agent expects to feel, as in `Agent.predict`."""
        timed = time_path(
            plan.path,
            velocity_limit=self.body.velocity,
            acceleration_limit=self.body.acceleration,
            rate_hz=RATE_HZ,
        )
        num_resting = 0 if self.body.jumps else round(_REST_S * RATE_HZ)
        rest_s = timed.time_s[-1] + np.arange(1, num_resting + 1) / RATE_HZ
        return self.agent.motion(
            plan,
            time_s=np.concatenate([timed.time_s, rest_s]),
            s=_held(timed.s, num_resting),
            q=_held(timed.q, num_resting),
            v=_held(timed.v, num_resting),
            dry_run=last_run,
        )

    def execute(self, motion: Motion, *, practised: bool = True) -> tuple[Execution, Followed]:
        """Lets the body follow a motion from its start.

        The touch servo rests unless the agent may feel beside the motion first, in practice.
        Returns what happened at the samples of the motion, and what the body measured.
        """
        if self._touch_servo and practised and isinstance(self.body, ServoedBody):
            followed = self.body.follow_beside(motion.time_s, motion.q, self.beside(motion))
        else:
            followed = self.body.follow(motion.time_s, motion.q)
        return executed(motion, followed), followed

    def beside(self, motion: Motion) -> TouchProfile:
        """What the agent feels beside a motion, for the touch servo.

        Raises:
            TypeError: the body has no touch servo.
        """
        if not isinstance(self.body, ServoedBody):
            raise TypeError(f"{type(self.body).__name__} has no touch servo")
        return felt_across(motion, self.body.offsets, self._slider)

    def rehearse(
        self, start: int, goal: int, *, max_tries: int, known: Try | None = None
    ) -> list[Try]:
        """Plans and executes until contact is never lost; the agent remembers what it learned.

        Where it lost contact, the agent practises by sliding along before it tries again.

        A motion that is `known` from an earlier try is not executed again. Returns the tries, in
        order (`best` chooses the one to keep); none if one is known and no way is found.

        Raises:
            NoWayError: none was found at the first try.
            ValueError: `max_tries` is below one.
        """
        if max_tries < 1:
            raise ValueError(f"max_tries is {max_tries}: give at least 1")
        tries: list[Try] = []
        while len(tries) < max_tries and not (tries and tries[-1].perfect):
            try:
                planned = self.plan(start, goal)
            except NoWayError:
                if tries or known is not None:
                    break
                raise
            if known is not None and np.array_equal(planned.motion.q, known.execution.motion.q):
                tries.append(known)
            else:
                execution, _ = self.execute(planned.motion)
                tries.append(judged_try(execution, self.agent.representation))
            self.agent = remembering(tries[-1], planned.agent, self._slider)
        return tries

    @cached_property
    def _slider(self) -> Slider:
        """The slider of the agent: it feels, and knows which configurations are possible."""
        return Slider(self.practice, self.agent.representation.joint_scale)

    def _planned(
        self, targets: Sequence[int | None], q_start: np.ndarray, limits: Limits | None = None
    ) -> PlannedMotion:
        """Plans and practises the plan."""
        began = time.perf_counter()
        found = practise(self.agent, self._slider, targets, q_start=q_start, limits=limits)
        motion = self.motion(found.plan, found.dry_run)
        return PlannedMotion(
            agent=found.agent,
            plan=found.plan,
            unpractised=found.unpractised,
            motion=motion,
            seconds=time.perf_counter() - began,
        )


def _held(samples: np.ndarray, num: int) -> np.ndarray:
    """Samples `(T, ...)`, of which the last is held for so many more."""
    return np.concatenate([samples, np.repeat(samples[-1:], num, axis=0)])


def executed(motion: Motion, followed: Followed) -> Execution:
    """What happened when a body followed a motion, at the samples of the motion.

    The body measured at samples of its own; what was felt is taken from the nearest one.
    """
    # Where each sample of the motion lies between those of the body, in numbers of samples.
    place = np.interp(motion.time_s, followed.time_s, np.arange(len(followed.time_s)))
    before = place.astype(int)
    after = np.minimum(before + 1, len(followed.time_s) - 1)
    nearest = np.rint(place).astype(int)
    share = (place - before)[:, None]
    q = followed.q[before] + share * (followed.q[after] - followed.q[before])
    v = np.gradient(q, motion.time_s, axis=0) if followed.v is None else followed.v[nearest]
    torque = np.zeros((0, q.shape[1])) if followed.torque is None else followed.torque
    return Execution(
        motion=motion,
        felt=followed.sensation[nearest],
        q_measured=q,
        v_measured=v,
        torque=torque,
    )
