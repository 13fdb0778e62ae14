"""The naive agent as one object: it learns, recovers its body, plans and remembers."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.motions import Execution, Motion, Plan
from selftouch_drake.agent.planning import (
    KNOT_SPACING,
    FindNearest,
    Limits,
    Planner,
    Prediction,
    checked_target,
    predict_sensation,
    recall_sensation,
)
from selftouch_drake.agent.practice import DryRun, go_along, out_of_the_way, practise
from selftouch_drake.agent.rehearsal import RehearsalMemory, Try, judge
from selftouch_drake.agent.representation import (
    QuotientRepresentation,
    felt_kernels,
    kernel_sensations,
    learn,
    linked_nearest,
)
from selftouch_drake.agent.sliding import Slider
from selftouch_drake.agent.touch_profile import TouchProfile, felt_across

if TYPE_CHECKING:
    from selftouch_drake.agent.representation import Batches
    from selftouch_drake.agent.shape import Body


# No slots: the planner is built when it is first asked for, and kept.
@dataclass(frozen=True, kw_only=True, eq=False)
class Agent:
    """A naive agent: it knows motor configurations and sensations, and nothing else.

    It is immutable: methods that change it return another agent.

    Attributes:
        representation: what it learned from its experience.
        memory: what it learned from rehearsals.
        kernel_sensation: `(R, S)` unit L2 norm, the sensation at each configuration of the
            representation; it makes prediction errors five times smaller. None if not kept.
        knot_spacing: rad of path length between knots of smooth paths; larger is smoother.
        find_nearest: as of `Planner`.
    """

    representation: QuotientRepresentation
    memory: RehearsalMemory
    kernel_sensation: csr_array | np.ndarray | None = None
    knot_spacing: float = KNOT_SPACING
    find_nearest: FindNearest = linked_nearest

    @classmethod
    def of(
        cls,
        representation: QuotientRepresentation,
        *,
        memory: RehearsalMemory | None = None,
        kernel_sensation: csr_array | np.ndarray | None = None,
        knot_spacing: float = KNOT_SPACING,
        find_nearest: FindNearest = linked_nearest,
    ) -> Agent:
        """An agent with a representation learned before; its memory is blank by default."""
        return cls(
            representation=representation,
            memory=RehearsalMemory.blank(representation) if memory is None else memory,
            kernel_sensation=kernel_sensation,
            knot_spacing=knot_spacing,
            find_nearest=find_nearest,
        )

    @classmethod
    def learn(
        cls,
        q: np.ndarray,
        sensation: np.ndarray,
        *,
        num_targets: int = 500,
        max_kernel_size: int = 1000,
        seed: int = 0,
    ) -> Agent:
        """Learns from experience held in arrays.

        Args:
            q: `(n, J)` motor configurations, in the robot's units.
            sensation: `(n, S)` N, sensations at these configurations; no row null.
            num_targets: K, number of target sensations.
            max_kernel_size: most motor configurations kept per kernel.
            seed: the same seed and experience give the same bytes.

        Raises:
            ValueError: the experience cannot be learned from; the text says why.
        """
        return cls.learn_batches(
            lambda: [(sensation, q)],
            num_targets=num_targets,
            max_kernel_size=max_kernel_size,
            seed=seed,
        )

    @classmethod
    def learn_batches(cls, batches: Batches, *, seed: int = 0, **parameters: Any) -> Agent:
        """Learns from experience of any size, in bounded memory.

        Args:
            batches: called three times, returns the same `(sensation, q)` batches each time.
            seed: the same seed and experience give the same bytes, whatever the batches.
            parameters: as for `representation.learn`.

        Raises:
            ValueError: the experience cannot be learned from; the text says why.
        """
        sizes = {"num_targets": 500, "max_kernel_size": 1000}
        representation = learn(batches, **sizes | parameters, seed=seed).representation
        sensations = (sensation for sensation, _ in batches())
        return cls.of(
            representation,
            kernel_sensation=kernel_sensations(representation.kernel_row, sensations),
        )

    def recover(self, metric: str = "learned", *, seed: int = 0) -> Body:
        """Recovers the body: shape, holes and dimension of each of its parts."""
        from selftouch_drake.agent.shape import recover  # not needed to plan

        return recover(self.representation, metric, seed=seed)

    def knowing(self, body: Body) -> Agent:
        """The same agent with its representation embedded in the recovered `body`."""
        return self._with(representation=body.embed(self.representation))

    def felt(self, sensation: np.ndarray) -> int | None:
        """The target sensation nearest to a `(S,)` sensation; None if nothing is felt."""
        kernels = felt_kernels(self.representation, sensation)
        return int(kernels[0]) if len(kernels) else None

    def plan(self, start: int, goal: int, *, q_start: np.ndarray | None = None) -> Plan:
        """Plans from one target sensation to another.

        Args:
            start: the target sensation that is felt now.
            goal: the target sensation to feel.
            q_start: `(J,)` positions of the joints; by default the configuration of `start` whose
                sensation is nearest to it.

        Raises:
            ValueError: as `Planner.plan_tour`.
        """
        return self.tour([start, goal], q_start=q_start)

    def tour(
        self,
        targets: Sequence[int | None],
        *,
        q_start: np.ndarray | None = None,
        aside: np.ndarray | None = None,
        lift_off: bool = False,
        limits: Limits | None = None,
    ) -> Plan:
        """Plans one continuous motion through several target sensations, in order.

        Args:
            targets: two or more; the first is felt at the start, None if nothing is.
            q_start: `(J,)` positions of the joints; by default the configuration of the first
                target whose sensation is nearest to it.
            aside: as for `Planner.plan_tour`.
            lift_off: as for `Planner.plan_tour`.
            limits: of the joints; by default the range of experience.

        Raises:
            ValueError: as `Planner.plan_tour`.
        """
        if q_start is None:
            q_start = self._typical(targets)
        return self.planner.plan_tour(
            q_start,
            targets,
            link_penalty=self.memory.link_penalty,
            slides=self.memory.slides,
            aside=aside,
            lift_off=lift_off,
            limits=limits,
        )

    def plan_from(
        self,
        q_start: np.ndarray,
        felt: np.ndarray,
        goal: int,
        *,
        aside: np.ndarray | None = None,
        lift_off: bool = False,
        limits: Limits | None = None,
    ) -> Plan:
        """Plans from any configuration, whether it touches or not.

        Args:
            q_start: `(J,)` positions of the joints, in the robot's units.
            felt: `(S,)` N, the sensation there.
            goal: the target sensation to feel.
            aside: as for `Planner.plan_tour`.
            lift_off: as for `Planner.plan_tour`.
            limits: of the joints; by default the range of experience.

        Raises:
            ValueError: as `Planner.plan_tour`.
        """
        targets = [self.felt(felt), goal]
        return self.tour(targets, q_start=q_start, aside=aside, lift_off=lift_off, limits=limits)

    def predict(self, plan: Plan, s: np.ndarray, passage: DryRun | None = None) -> Prediction:
        """The sensation expected at path lengths `s` `(T,)` of a plan, in rad.

        If the agent went along the plan before (`passage`), it is what was felt then; else it comes
        from stored touches.
        """
        if passage is not None:
            return recall_sensation(plan, s, passage.s, passage.felt)
        return predict_sensation(self.representation, plan, s, self.kernel_sensation)

    def motion(
        self,
        plan: Plan,
        *,
        time_s: np.ndarray,
        s: np.ndarray,
        q: np.ndarray,
        v: np.ndarray,
        passage: DryRun | None = None,
    ) -> Motion:
        """A plan with times and with the sensations that the agent expects; see `Motion`."""
        expected = self.predict(plan, s, passage)
        return Motion.of(
            plan,
            time_s=time_s,
            s=s,
            q=q,
            v=v,
            predicted=expected.sensation,
            predicted_spread=expected.spread,
        )

    def judge(self, execution: Execution) -> Try:
        """The agent's own judgement of an executed plan."""
        return judge(execution, self.representation)

    def go_along(self, plan: Plan, slider: Slider) -> DryRun:
        """What happens when the agent follows a plan slowly; see `practice.go_along`."""
        return go_along(plan, self.representation, slider)

    def aside(self, plan: Plan, slider: Slider) -> np.ndarray | None:
        """Where to move joints that obstruct a plan; see `practice.out_of_the_way`."""
        return out_of_the_way(plan, self.representation, slider)

    def felt_across(self, motion: Motion, offsets: np.ndarray, slider: Slider) -> TouchProfile:
        """The sensations on either side of a motion; see `pressing.felt_across`."""
        return felt_across(motion, offsets, self.representation, slider)

    def prepare(self, plan: Plan, doubtful: np.ndarray, slider: Slider) -> Agent:
        """The agent after it searched for other ways for the doubtful steps of a plan.

        Links for which it found none cost more from then on.
        """
        memory, lost = self._practised(plan, doubtful, slider)
        return self._with(memory=memory.avoiding(lost))

    def practise(self, plan: Plan, one: Try, slider: Slider) -> Agent:
        """The agent after it practised slides where a try of a plan lost contact.

        Links on which it found no slide cost more from then on, and so does the last link if the
        goal was missed.
        """
        in_touch = one.lost_steps[~plan.in_air[one.lost_steps]]
        memory, lost = self._practised(plan, in_touch, slider)
        missed = plan.links[len(plan.links) - (not one.reached) :]
        return self._with(memory=memory.after(_links(np.append(lost, missed))))

    def _practised(
        self, plan: Plan, doubtful: np.ndarray, slider: Slider
    ) -> tuple[RehearsalMemory, np.ndarray]:
        """The memory with new ways, and the links of steps for which none was found."""
        memory, found = practise(plan, doubtful, slider, self.memory, self.representation)
        return memory, _links(plan.links[doubtful[~found]])

    def recalling(self, memory: RehearsalMemory) -> Agent:
        """The same agent with another memory of rehearsals."""
        return self._with(memory=memory)

    @cached_property
    def planner(self) -> Planner:
        """The planner that makes all plans."""
        return Planner(
            self.representation, knot_spacing=self.knot_spacing, find_nearest=self.find_nearest
        )

    def _with(self, **changes: Any) -> Agent:
        """A changed copy that keeps the planner, which must not depend on the changes."""
        changed = dataclasses.replace(self, **changes)
        if "planner" in vars(self):
            vars(changed)["planner"] = self.planner
        return changed

    def _typical(self, targets: Sequence[int | None]) -> np.ndarray:
        """`(J,)` the configuration of the first target whose sensation is nearest to it."""
        start = targets[0] if targets else None
        if start is None:
            raise ValueError("q_start is missing: give joint positions if nothing is felt")
        members = self.representation.members(checked_target(start, self.representation))
        best = members.start + int(self.representation.kernel_error[members].argmin())
        return self.representation.kernel_q[best].astype(float)


def _links(rows: np.ndarray) -> np.ndarray:
    """The rows that are links, unique and sorted; steps in the air have none."""
    return np.unique(rows[rows >= 0]).astype(int)
