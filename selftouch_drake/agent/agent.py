"""The naive agent as one object: it learns, recovers its body, plans and remembers."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.memory import RehearsalMemory
from selftouch_drake.agent.motions import Motion, Plan
from selftouch_drake.agent.planning.planner import Planner, Preference
from selftouch_drake.agent.planning.prediction import (
    Prediction,
    predict_sensation,
    recall_sensation,
)
from selftouch_drake.agent.planning.touch_model import TouchModel
from selftouch_drake.agent.readings.turns import turning, within_a_turn
from selftouch_drake.agent.representation.kernel_sensations import kernel_sensations
from selftouch_drake.agent.representation.learning import learn
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.representation.touches import felt_kernels, kernel_of_receptor
from selftouch_drake.quotient.plan import most_typical
from selftouch_drake.quotient.smooth import KNOT_SPACING

if TYPE_CHECKING:
    from selftouch_drake.agent.body_model.imagination import Imagination
    from selftouch_drake.agent.body_model.model import BodyModel
    from selftouch_drake.agent.practice.dry_run import DryRun
    from selftouch_drake.agent.shape.recovery import RecoveredBody


# No slots: the planner is built at first use, and kept.
@dataclass(frozen=True, kw_only=True, eq=False)
class Agent:
    """A naive agent: it knows motor configurations and sensations, and nothing else.

    It is immutable: methods that change it return another agent. It plans, and moves nothing: in
    `practice` it follows a plan slowly, and a `Pilot` moves its body.

    Attributes:
        representation: what it learned from its experience.
        memory: what it learned from practice and rehearsals.
        kernel_sensation: `(R, S)` unit L2 norm, the sensation at each configuration of the
            representation; it makes prediction errors five times smaller. None if not kept.
        knot_spacing: as in `Planner`.
        touch_model: as in `Planner`.
        prefer: as in `Planner`.
        body_model: what it found out about its mechanics. On parts where it is accepted, plans are
            imagined; all others come from the paper's representation.
    """

    representation: QuotientRepresentation
    memory: RehearsalMemory
    kernel_sensation: csr_array | None = None
    knot_spacing: float = KNOT_SPACING
    touch_model: TouchModel | None = None
    prefer: Preference = "body"
    body_model: "BodyModel | None" = None

    @classmethod
    def of(
        cls,
        representation: QuotientRepresentation,
        *,
        memory: RehearsalMemory | None = None,
        **fields: Any,
    ) -> "Agent":
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
    ) -> "Agent":
        """Learns from experience held in arrays: `(n, S)` N felt at `(n, J)` q; no row null.

        As `representation.learn`, which learns from experience of any size. A joint that turns
        round and round is taken within one turn, as `readings.turns` has it: so are plans.

        Raises:
            ValueError: the experience cannot be learned from; the text says why.
        """
        q = within_a_turn(q, turning(q, sensation))
        found = learn(
            lambda: [(sensation, q)],
            num_targets=num_targets,
            max_kernel_size=max_kernel_size,
            seed=seed,
        ).representation
        felt = kernel_sensations(found.kernel_row, [sensation])
        touch_model = TouchModel.learn(found, lambda: felt, seed=seed)
        return cls.of(found, kernel_sensation=felt, touch_model=touch_model)

    def recover(self, metric: str = "learned", *, seed: int = 0) -> "RecoveredBody":
        """Recovers the body: shape, holes and dimension of each of its parts."""
        from selftouch_drake.agent.shape.recovery import recover  # not needed to plan

        return recover(self.representation, metric, seed=seed)

    def find_body_model(
        self, joint_names: Sequence[str] | None = None, *, seed: int = 0
    ) -> "BodyModel":
        """Asks whether its joints turn or slide something rigid, and tests the answer.

        It assumes rigid links on joints that turn or slide. The names are carried along.

        Returns:
            The model with its judgement: rejected where held-out touches disagree.
        """
        from selftouch_drake.agent.body_model.asking import ask_for_model  # not needed to plan

        return ask_for_model(
            self.representation, self.kernel_sensation, joint_names=joint_names, seed=seed
        )

    def recalling(self, memory: RehearsalMemory) -> "Agent":
        """The same agent with another memory."""
        changed = dataclasses.replace(self, memory=memory)
        vars(changed)["_builder"] = self._builder
        return changed

    def without_model(self) -> "Agent":
        """The same agent, which plans from the paper's representation alone."""
        changed = dataclasses.replace(self, body_model=None)
        vars(changed)["planner"] = self.planner
        return changed

    def target_felt(self, sensation: np.ndarray) -> int | None:
        """The target sensation nearest to a `(S,)` sensation; None if nothing is felt."""
        kernels = felt_kernels(self.representation, sensation)
        return int(kernels[0]) if len(kernels) else None

    def target_of_receptor(self, receptor: int) -> int:
        """The target sensation in which a receptor counts most; errors of `kernel_of_receptor`."""
        return kernel_of_receptor(self.representation, receptor)

    def plan(
        self,
        *targets: int | None,
        q_start: np.ndarray | None = None,
        apart: float = 0.0,
        **options: Any,
    ) -> Plan:
        """Plans one continuous motion through two or more target sensations, in order.

        The plan comes from what the agent has learned and remembers; nobody has followed it. By
        default it starts at the configuration of the first target whose sensation is nearest to it.
        The first target is None if nothing is felt at `q_start`. Arguments and errors are as in
        `Planner.plan`: options are `lift_off` and `limits`. Without the first one the plan
        is imagined, where the body model knows a way; own parts then stay so much farther `apart`
        than in past postures, in distances of kernels.
        """
        if q_start is None:
            if not targets or targets[0] is None:
                raise ValueError("q_start is missing: give joint positions if nothing is felt")
            first = self.representation.checked_target(targets[0])
            q_start = most_typical(self.representation, first)
        if self.imagination is not None and "lift_off" not in options:
            limits = options.get("limits")
            checked = self.planner.checked(q_start, targets, limits)
            imagined = self.imagination.plan(
                *checked, pressure=self.memory.pressure, apart=apart, limits=limits
            )
            if imagined is not None:
                return imagined
        return self.planner.plan(q_start, targets, memory=self.memory, **options)

    def predict(self, plan: Plan, s: np.ndarray, dry_run: "DryRun | None" = None) -> Prediction:
        """The sensation expected at path lengths `s` `(T,)` of a plan, in mu.

        After a dry run it is what was felt then; before, it comes from stored touches.
        """
        if dry_run is not None:
            return recall_sensation(plan, s, dry_run.s, dry_run.felt)
        if plan.is_imagined and self.imagination is not None and self.imagination.feels:
            return self.imagination.predict(plan, s)
        return predict_sensation(
            self.representation, plan, s, self.kernel_sensation, self.touch_model
        )

    def motion(
        self,
        plan: Plan,
        *,
        time_s: np.ndarray,
        s: np.ndarray,
        q: np.ndarray,
        v: np.ndarray,
        dry_run: "DryRun | None" = None,
    ) -> Motion:
        """A plan with times and with the sensations that the agent expects.

        The arrays are as in `Motion`, the dry run is as in `predict`.
        """
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
    def _builder(self) -> "Agent":
        """Who builds planner and imagination, when one of those who remember otherwise plans."""
        return self

    @cached_property
    def imagination(self) -> "Imagination | None":
        """What plans over the imagined skin; None without an accepted part of the body model."""
        if self._builder is not self:
            return self._builder.imagination
        if self.body_model is None or not self.body_model.accepted_by_part.any():
            return None
        from selftouch_drake.agent.body_model.imagination import Imagination  # not always needed

        return Imagination(
            self.body_model,
            self.representation,
            knot_spacing=self.knot_spacing,
            kernel_sensation=self.kernel_sensation,
        )

    @cached_property
    def planner(self) -> Planner:
        """The planner over the paper's representation, which knows a way between all touches."""
        if self._builder is not self:
            return self._builder.planner
        return Planner(
            self.representation,
            knot_spacing=self.knot_spacing,
            touch_model=self.touch_model,
            prefer=self.prefer,
        )
