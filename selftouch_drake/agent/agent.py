"""The naive agent as one object: it learns, recovers its body, plans and remembers."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.memory import RehearsalMemory
from selftouch_drake.agent.motions import Motion, Plan
from selftouch_drake.agent.planning import Limits, Planner, predict_sensation
from selftouch_drake.agent.planning.planner import checked_target
from selftouch_drake.agent.planning.prediction import Prediction, recall_sensation
from selftouch_drake.agent.planning.smoothing import KNOT_SPACING
from selftouch_drake.agent.representation import (
    QuotientRepresentation,
    felt_kernels,
    kernel_sensations,
    learn,
)

if TYPE_CHECKING:
    from selftouch_drake.agent.practice import DryRun
    from selftouch_drake.agent.shape import Body


# No slots: the planner is built at first use, and kept.
@dataclass(frozen=True, kw_only=True, eq=False)
class Agent:
    """A naive agent: it knows motor configurations and sensations, and nothing else.

    It is immutable: methods that change it return another agent. What it does in a world is in
    `practice` and `rehearsal`.

    Attributes:
        representation: what it learned from its experience.
        memory: what it learned from practice and rehearsals.
        kernel_sensation: `(R, S)` unit L2 norm, the sensation at each configuration of the
            representation; it makes prediction errors five times smaller. None if not kept.
        knot_spacing: as of `Planner`.
    """

    representation: QuotientRepresentation
    memory: RehearsalMemory
    kernel_sensation: csr_array | None = None
    knot_spacing: float = KNOT_SPACING

    @classmethod
    def of(
        cls,
        representation: QuotientRepresentation,
        *,
        memory: RehearsalMemory | None = None,
        **fields: Any,
    ) -> Agent:
        """An agent with a representation learned before; its memory is blank by default."""
        memory = RehearsalMemory.blank(representation) if memory is None else memory
        return cls(representation=representation, memory=memory, **fields)

    @classmethod
    def learn(
        cls,
        q: np.ndarray,
        sensation: np.ndarray,
        *,
        num_targets: int = 500,
        max_kernel_size: int = 1000,
        seed: int = 0,
        **parameters: Any,
    ) -> Agent:
        """Learns from experience held in arrays.

        Args:
            q: `(n, J)` motor configurations, in the robot's units.
            sensation: `(n, S)` N, sensations at these configurations; no row null.
            num_targets: K, number of target sensations.
            max_kernel_size: most motor configurations kept per kernel.
            seed: the same seed and experience give the same bytes.
            parameters: as for `representation.learn`, which learns from experience of any size.

        Raises:
            ValueError: the experience cannot be learned from; the text says why.
        """
        sizes = {"num_targets": num_targets, "max_kernel_size": max_kernel_size}
        learned = learn(lambda: [(sensation, q)], **sizes, seed=seed, **parameters)
        row = learned.representation.kernel_row
        return cls.of(learned.representation, kernel_sensation=kernel_sensations(row, [sensation]))

    def recover(self, metric: str = "learned", *, seed: int = 0) -> Body:
        """Recovers the body: shape, holes and dimension of each of its parts."""
        from selftouch_drake.agent.shape import recover  # not needed to plan

        return recover(self.representation, metric, seed=seed)

    def knowing(self, body: Body) -> Agent:
        """The same agent with its representation embedded in the recovered `body`."""
        return self._with(representation=body.embed(self.representation))

    def recalling(self, memory: RehearsalMemory) -> Agent:
        """The same agent with another memory."""
        return self._with(memory=memory)

    def felt(self, sensation: np.ndarray) -> int | None:
        """The target sensation nearest to a `(S,)` sensation; None if nothing is felt."""
        kernels = felt_kernels(self.representation, sensation)
        return int(kernels[0]) if len(kernels) else None

    def plan(self, start: int, goal: int, *, q_start: np.ndarray | None = None) -> Plan:
        """Plans from one target sensation to another; see `tour`."""
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

        The plan comes from what the agent has learned and remembers; nobody has followed it. By
        default it starts at the configuration of the first target whose sensation is nearest to it.
        Arguments and errors are as of `Planner.plan`.
        """
        return self.planner.plan(
            self._typical(targets) if q_start is None else q_start,
            targets,
            link_penalty=self.memory.link_penalty,
            slides=self.memory.slides,
            missed=self.memory.missed,
            aside=aside,
            lift_off=lift_off,
            limits=limits,
        )

    def predict(self, plan: Plan, s: np.ndarray, dry_run: DryRun | None = None) -> Prediction:
        """The sensation expected at path lengths `s` `(T,)` of a plan, in rad.

        After a dry run it is what was felt then; before, it comes from stored touches.
        """
        if dry_run is not None:
            return recall_sensation(plan, s, dry_run.s, dry_run.felt)
        return predict_sensation(self.representation, plan, s, self.kernel_sensation)

    def motion(
        self,
        plan: Plan,
        *,
        time_s: np.ndarray,
        s: np.ndarray,
        q: np.ndarray,
        v: np.ndarray,
        dry_run: DryRun | None = None,
    ) -> Motion:
        """A plan with times and with the sensations that the agent expects; see `Motion`."""
        expected = self.predict(plan, s, dry_run)
        return Motion(
            plan=plan,
            time_s=time_s,
            s=s,
            q=q,
            v=v,
            predicted=expected.sensation,
            predicted_spread=expected.spread,
        )

    @cached_property
    def planner(self) -> Planner:
        """The planner that makes all plans."""
        return Planner(self.representation, knot_spacing=self.knot_spacing)

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
