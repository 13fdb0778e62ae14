"""Practice: the agent follows a plan slowly, without dynamics, and repairs it where it would fail.

A plan before practice (`Agent.plan`) comes from what the agent has learned alone. In practice the
agent makes a dry run of the plan and searches other ways for its doubtful steps; it remembers them.
Also here: what it remembers of a try under dynamics (naive).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.motions import Plan
from selftouch_drake.agent.practice.dry_run import (
    DryRun,
    dry_run,
    missed_touches,
    misses,
    stored_touches,
)
from selftouch_drake.agent.practice.other_ways import links_of, other_ways
from selftouch_drake.agent.practice.sliding import Slider
from selftouch_drake.agent.tries import Try
from selftouch_drake.quotient.plan import Limits

# Where own parts ran into each other on an imagined plan, they stay so much farther apart on the
# next one, up to the second number, in distances of kernels.
_APART, _MOST_APART = 0.15, 0.45

#: Most rounds of practice: a plan round steps without another way may have other doubtful steps.
_MOST_ROUNDS = 8


class NoWayError(ValueError):
    """No motion was found that keeps the rigid parts of the robot apart."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Practised:
    """A plan after practice.

    Attributes:
        agent: the agent, with what it learned in practice.
        unpractised: the plan before practice.
        plan: the plan after it; the same if nothing was to be repaired.
        dry_run: the dry run of that plan: what was felt along it.
    """

    agent: Agent
    unpractised: Plan
    plan: Plan
    dry_run: DryRun


def practise(
    agent: Agent,
    slider: Slider,
    targets: Sequence[int | None],
    *,
    q_start: np.ndarray,
    limits: Limits | None = None,
) -> Practised:
    """Plans, and practises the plan.

    A plan that was imagined is followed once, to check it; where it would lose contact, the agent
    presses more, and where own parts would run into each other, it keeps them farther apart. What
    that does not mend is planned over the paper's representation, and repaired: where such a plan
    would lose contact, the agent slides; in the air it takes detours. Then it plans again. If rigid
    parts of the robot still run into each other, the agent lifts off, lands at each goal, and
    practises that. Targets, start and limits are as in `Agent.plan`.

    Raises:
        NoWayError: rigid parts of the robot run into each other on every plan.
        ValueError: as `Agent.plan`.
    """

    def plan_on_skin(agent: Agent, **options: Any) -> Plan:
        return agent.plan(*targets, q_start=q_start, limits=limits, **options)

    unpractised = plan_on_skin(agent)
    if agent.imagination is not None:
        checked = _checked(plan_on_skin, agent, unpractised, slider)
        if checked is not None:
            return checked
        agent, known = agent.without_model(), agent
        start = plan_on_skin(agent)
    else:
        start, known = unpractised, agent
    wiser, plan, last_run = _repaired(plan_on_skin, agent, start, slider)
    if len(last_run.impossible):
        plan_in_air = partial(plan_on_skin, lift_off=True)
        wiser, plan, last_run = _repaired(plan_in_air, agent, plan_in_air(agent), slider)
    if len(last_run.impossible):
        raise NoWayError(
            f"no way to target {plan.goal} was found on which the rigid parts of the robot do not "
            "run into each other: choose another start or goal, or babble longer"
        )
    wiser = known.recalling(wiser.memory)
    return Practised(agent=wiser, unpractised=unpractised, plan=plan, dry_run=last_run)


def remembering(one: Try, agent: Agent, slider: Slider) -> Agent:
    """The agent that remembers a try: it practises slides where the try lost contact.

    Links on which it found no slide cost more from then on. If the goal was missed, the last link
    costs more, and plans end at other touches of the goal. After an imagined plan it presses more.
    Only its memory changes: it learns no other representation.
    """
    plan, known = one.execution.motion.plan, agent.representation
    if plan.is_imagined:
        memory = agent.memory if one.perfect else agent.memory.pressing()
        return agent.recalling(memory.after(np.zeros(0, dtype=int)))
    lost_touch = one.lost_steps[~plan.in_air[one.lost_steps]]
    memory, lost = other_ways(plan, lost_touch, slider, agent.memory, known)
    if not one.reached:
        goal, last_step = len(plan.nodes) - 1, len(plan.links) - 1
        memory = memory.missing(stored_touches(plan, [goal], known))
        if last_step >= 0:
            lost = np.union1d(lost, links_of(plan, [last_step]))
    return agent.recalling(memory.after(lost))


def _checked(
    plan_again: Callable[..., Plan], agent: Agent, plan: Plan, slider: Slider
) -> Practised | None:
    """An imagined plan after its check; None if it needs more than to press, or to stay apart."""
    unpractised, apart = plan, 0.0
    while True:
        last_run = dry_run(plan, slider)
        if not len(last_run.doubtful) and not misses(plan, last_run, agent.representation):
            if plan.doubts:  # it was followed
                plan = replace(plan, doubts=())
            return Practised(agent=agent, unpractised=unpractised, plan=plan, dry_run=last_run)
        if len(last_run.impossible):
            apart += _APART
            if apart > _MOST_APART or not plan.is_imagined:
                return None
        else:
            more = agent.memory.pressing()
            if more.same_as(agent.memory):
                return None
            agent = agent.recalling(more)
        plan = plan_again(agent, apart=apart)


def _repaired(
    plan_again: Callable[..., Plan], agent: Agent, plan: Plan, slider: Slider
) -> tuple[Agent, Plan, DryRun]:
    """The agent after practice, its plan, and the dry run of that plan.

    `plan_again` asks an agent for a plan, as `Agent.plan`, with further options.
    """
    last_run = dry_run(plan, slider)
    for _ in range(_MOST_ROUNDS):
        missed = missed_touches(plan, last_run, agent.representation)
        if not len(last_run.doubtful) and not missed:
            break
        before = agent.memory
        memory, lost = other_ways(plan, last_run.doubtful, slider, before, agent.representation)
        agent = agent.recalling(memory.avoiding(lost).missing(missed))
        if agent.memory.same_as(before):
            break
        plan = plan_again(agent)
        last_run = dry_run(plan, slider)
    return agent, plan, last_run
