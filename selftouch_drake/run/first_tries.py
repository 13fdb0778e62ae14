"""First tries of random pairs: planned and executed without memory of rehearsals, and scored."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.body import Felt, Followed
from selftouch_drake.agent.memory import RehearsalMemory
from selftouch_drake.agent.motions import Execution, Motion
from selftouch_drake.agent.pilot import Pilot
from selftouch_drake.agent.practice import NoWayError
from selftouch_drake.agent.rehearsal import Try, judge
from selftouch_drake.bodies.drake import DrakeFollowed
from selftouch_drake.bodies.embodiment import Bodies
from selftouch_drake.evaluation import MotionScore, cosine_distance, jerk_reduction, score_motion
from selftouch_drake.evaluation.executed import ExecutedTruth, ExecutionJudge


@dataclass(frozen=True, kw_only=True, eq=False)
class FirstTry:
    """The result of the first try of one pair of start and goal, without memory.

    Attributes:
        start: target sensation.
        goal: target sensation.
        unpractised: the plan before practice, scored without dynamics; None if the body cannot be
            at rest everywhere.
        unpractised_executed: the same as felt under dynamics.
        planned: the practised plan, scored without dynamics; None likewise.
        executed: the same as felt under dynamics.
        query_s: s, duration of planning.
        jerk_reduction: of the plan, in motor space.
        num_slides: ways that practice found for steps of the plan.
        error: `(n,)` cosine distances from predicted to felt.
        spread: `(n,)` predicted scales of these errors.
        impossible_planned: samples of the plan at which the body cannot be.
        truth: of the execution; None if nobody knows it.
    """

    start: int
    goal: int
    unpractised: MotionScore | None
    unpractised_executed: MotionScore
    planned: MotionScore | None
    executed: MotionScore
    query_s: float
    jerk_reduction: float
    num_slides: int
    error: np.ndarray
    spread: np.ndarray
    impossible_planned: int
    truth: ExecutedTruth | None


class FirstTries:
    """Makes and scores first tries of an agent without memory.

    Args:
        pilot: an agent in its body, with its stored sensations, for predictions without practice.
        bodies: its bodies.

    Attributes:
        agent: the agent without memory.
    """

    def __init__(self, pilot: Pilot, bodies: Bodies):
        representation = pilot.agent.representation
        self.agent = pilot.agent.recalling(RehearsalMemory.blank(representation))
        self._pilot, self._still = pilot, bodies.still
        pilot.agent = self.agent
        pilot.get_ready()
        world = bodies.world
        self._judge = None if world is None else ExecutionJudge(world, representation)

    def first(self, start: int, goal: int) -> tuple[FirstTry, Try] | None:
        """The first try of a pair; None if no way is found."""
        try:
            query = self._pilot.plan(start, goal)
        except NoWayError:
            return None
        motion, scale = query.motion, self.agent.representation.joint_scale
        unpractised = self._pilot.motion(query.unpractised)
        blind, _ = self._pilot.execute(unpractised, practised=False)
        execution, followed = self._pilot.execute(motion)
        predicted = execution.felt.any(axis=1) & motion.predicted.any(axis=1)
        predicted &= motion.predicted_spread > 0
        planned, felt = self._slowly(motion)
        first = FirstTry(
            start=start,
            goal=goal,
            unpractised=self._slowly(unpractised)[0],
            unpractised_executed=self.score(blind),
            planned=planned,
            executed=self.score(execution),
            query_s=query.seconds,
            jerk_reduction=jerk_reduction(query.plan, scale),
            num_slides=len(query.agent.memory.slides.ends),
            error=cosine_distance(execution.felt[predicted], motion.predicted[predicted]),
            spread=motion.predicted_spread[predicted],
            impossible_planned=0 if felt is None else int(np.sum(~felt.reached)),
            truth=self._truth(execution, followed),
        )
        return first, judge(execution, self.agent.representation)

    def score(self, execution: Execution) -> MotionScore:
        """An execution, scored as it was felt."""
        return score_motion(execution.motion, execution.felt, self.agent.representation)

    def off_skin_s(self, execution: Execution) -> float | None:
        """As of `ExecutionJudge`; None if nobody knows."""
        return None if self._judge is None else self._judge.off_skin_s(execution)

    def _truth(self, execution: Execution, followed: Followed) -> ExecutedTruth | None:
        if self._judge is None or not isinstance(followed, DrakeFollowed):
            return None
        return self._judge.truth(execution, followed.log)

    def _slowly(self, motion: Motion) -> tuple[MotionScore | None, Felt | None]:
        """A motion, scored as it is felt slowly, and what is felt; None if the body cannot."""
        if self._still is None:
            return None, None
        felt = self._still.feel(motion.q)
        return score_motion(motion, felt.sensation, self.agent.representation), felt
