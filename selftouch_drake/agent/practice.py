"""Practice: the agent follows a plan slowly, without dynamics, and repairs it where it would fail.

A plan before practice (`Agent.tour`) comes from what the agent has learned alone. In practice the
agent feels along the plan and searches other ways for its doubtful steps; it remembers them. Also
here: what it learns from a try under dynamics (naive).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.memory import RehearsalMemory
from selftouch_drake.agent.motions import Plan, steps
from selftouch_drake.agent.rehearsal import Try
from selftouch_drake.agent.representation.quotient import QuotientRepresentation, stored_row
from selftouch_drake.agent.representation.touches import felt_kernels
from selftouch_drake.agent.sliding import Slider, straight
from selftouch_drake.quotient.plan import Limits

#: rad of path between the places at which the agent feels, and checks that it can be there.
_SAMPLED = 0.03

#: Most rounds of practice: a plan round steps without another way may have other doubtful steps.
_MOST_ROUNDS = 8

#: Number of remembered configurations that a detour through the air may pass: first those that
#: lengthen the path least; then any, because few paths lead out of some configurations.
_NUM_SHORT, _NUM_ANY = 60, 300

#: Number of remembered configurations to try as a place to move aside.
_NUM_ASIDE = 24


class NoWayError(ValueError):
    """No motion was found that keeps the rigid parts of the robot apart."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DryRun:
    """What the agent felt when it followed a plan slowly.

    n places, S receptors.

    Attributes:
        s: `(n,)` rad, path lengths of the places.
        felt: `(n, S)` N, sensations there.
        lost: steps on which expected contact was lost.
        impossible: steps with configurations that the robot cannot take.
    """

    s: np.ndarray
    felt: np.ndarray
    lost: np.ndarray
    impossible: np.ndarray

    @property
    def doubtful(self) -> np.ndarray:
        """Steps for which another way is needed."""
        return np.union1d(self.lost, self.impossible)


def practise(
    agent: Agent,
    slider: Slider,
    targets: Sequence[int | None],
    *,
    q_start: np.ndarray,
    limits: Limits | None = None,
) -> tuple[Agent, Plan, Plan, DryRun]:
    """Plans, and practises the plan.

    Where the plan would lose contact, the agent slides; in the air it takes detours; joints that
    are in the way move aside. Then it plans again. If rigid parts of the robot still run into each
    other, the agent lifts off, lands at each goal, and practises that. Targets, start and limits
    are as of `Agent.tour`. Returns the agent with what it learned in practice, the plan before
    practice, the practised one (the same if nothing was to be repaired), and what was felt along
    it.

    Raises:
        NoWayError: rigid parts of the robot run into each other on every plan.
        ValueError: as `Agent.tour`.
    """
    tour = partial(Agent.tour, targets=targets, q_start=q_start, limits=limits)
    unpractised = tour(agent)
    wiser, plan, felt = _repaired(tour, agent, unpractised, slider)
    if len(felt.impossible):
        in_air = partial(tour, lift_off=True)
        wiser, plan, felt = _repaired(in_air, agent, in_air(agent), slider)
    if len(felt.impossible):
        raise NoWayError(
            f"no way to target {plan.goal} was found on which the rigid parts of the robot do not "
            "run into each other: choose another start or goal, or babble longer"
        )
    return wiser, unpractised, plan, felt


def dry_run(plan: Plan, slider: Slider) -> DryRun:
    """Follows the smooth path of a plan slowly; nothing is dynamic, nothing is repaired."""
    length = plan.waypoint_s[-1]
    s = np.linspace(0.0, length, 2 + int(length / _SAMPLED))
    x = plan.path(s) * slider.joint_scale
    there = slider.feel_along(x)
    felt, impossible = there.sensation, ~there.reached
    step = steps(plan.waypoint_s, s)
    lost = plan.touching(s) & ~felt.any(axis=1)
    if not len(plan.in_air):  # a plan to stay
        lost[:] = impossible[:] = False
    return DryRun(
        s=s, felt=felt, lost=np.unique(step[lost]), impossible=np.unique(step[impossible])
    )


def learn_from(one: Try, agent: Agent, slider: Slider) -> Agent:
    """The agent after it practised slides where a try lost contact.

    Links on which it found no slide cost more from then on. If the goal was missed, the last link
    costs more, and plans end at other touches of the goal.
    """
    plan = one.execution.motion.plan
    in_touch = one.lost_steps[~plan.in_air[one.lost_steps]]
    memory, lost = other_ways(plan, in_touch, slider, agent.memory, agent.representation)
    missed = plan.links[len(plan.links) - (not one.reached) :]
    if not one.reached:
        memory = memory.missing(_stored(plan, [len(plan.nodes) - 1], agent.representation))
    return agent.recalling(memory.after(_links(np.append(lost, missed))))


def missed_touches(plan: Plan, run: DryRun, representation: QuotientRepresentation) -> list[int]:
    """Rows of `kernel_q` at which the plan lands or ends, and what was expected was not felt.

    At a landing that is a touch, in the end it is the goal.
    """
    if not len(plan.in_air):  # a plan to stay
        return []
    landings = np.flatnonzero(plan.in_air) + 1
    felt = run.felt[np.abs(run.s - plan.waypoint_s[landings][:, None]).argmin(axis=1)]
    without = landings[~felt.any(axis=1)].tolist()
    if plan.goal not in felt_kernels(representation, run.felt[-1]):
        without.append(len(plan.nodes) - 1)
    return _stored(plan, without, representation)


def other_ways(
    plan: Plan,
    doubtful: np.ndarray,
    slider: Slider,
    memory: RehearsalMemory,
    representation: QuotientRepresentation,
) -> tuple[RehearsalMemory, np.ndarray]:
    """Searches other ways for steps of a plan: slides for touching steps, detours in the air.

    The `(n,)` steps are doubtful; the representation is the one used to make the plan. Returns the
    memory with the ways that were found, and the links of the steps without one.
    """
    slides, x = memory.slides, representation.scaled(plan.waypoints_q)
    # What the agent only imagined between two touches is no place to slide from.
    touches = np.flatnonzero(~plan.imagined)
    without = []
    for number in np.unique(np.searchsorted(touches, doubtful, side="right")).tolist():
        step = touches[number - 1]
        x_from, x_to = x[touches[number - 1 : number + 1]]
        passed, node = x[:0], plan.nodes[:0]
        if plan.in_air[step]:
            passed = _detour(representation, slider, x_from, x_to)
            node = np.repeat(plan.nodes[step + 1], len(passed))
        # On a step without a link, the joints that move are not those that touch.
        elif plan.links[step] >= 0 and (slid := slider.slide(x_from, x_to)) is not None:
            passed, felt = slid
            part = representation.part == representation.part[plan.nodes[step]]
            node = np.where(part, felt @ representation.target_sensations.T, -1.0).argmax(axis=1)
        # An empty slide means that the step is already as short as a part of a slide.
        if len(passed):
            slides = slides.and_also(x_from, x_to, passed, node)
        else:
            without.append(step)
    return replace(memory, slides=slides), _links(plan.links[without])


def out_of_the_way(
    plan: Plan, representation: QuotientRepresentation, slider: Slider
) -> np.ndarray | None:
    """Where to move joints that a plan does not use, so that they obstruct it less.

    The plan has configurations that the robot cannot take, as the slider knows. Returns a scaled
    configuration `(J,)` with new positions of these joints; None if none is better.
    """
    x = representation.scaled(plan.waypoints_q)
    still = x.max(axis=0) == x.min(axis=0)
    if plan.in_air.any() or not still.any():
        return None
    best, most = None, int(slider.feel(x).reached.sum())
    if most == len(x):
        return None
    members = [representation.members(kernel) for kernel in np.unique(plan.nodes)]
    rows = np.concatenate([np.r_[some] for some in members])
    for row in rows[:: max(len(rows) // _NUM_ASIDE, 1)]:
        other = np.where(still, representation.scaled(representation.kernel_q[row]), x)
        there = int(slider.feel(other).reached.sum())
        if there > most and slider.feel_along(straight(x[0], other[0])).reached.all():
            best, most = other[0], there
    return best


def _repaired(
    tour: Callable[..., Plan], agent: Agent, plan: Plan, slider: Slider
) -> tuple[Agent, Plan, DryRun]:
    """The agent after practice, its plan, and what it felt along it; `tour` plans again."""
    felt, aside = dry_run(plan, slider), None
    for _ in range(_MOST_ROUNDS):
        missed = missed_touches(plan, felt, agent.representation)
        if not len(felt.doubtful) and not missed:
            break
        if aside is None:
            aside = out_of_the_way(plan, agent.representation, slider)
            if aside is not None:
                plan = tour(agent, aside=aside)
                felt = dry_run(plan, slider)
        before = agent.memory
        memory, lost = other_ways(plan, felt.doubtful, slider, before, agent.representation)
        agent = agent.recalling(memory.avoiding(lost).missing(missed))
        if agent.memory.same_as(before):
            break
        plan = tour(agent, aside=aside)
        felt = dry_run(plan, slider)
    return agent, plan, felt


def _detour(
    representation: QuotientRepresentation, slider: Slider, x_from: np.ndarray, x_to: np.ndarray
) -> np.ndarray:
    """`(n, J)` configurations that a detour through the air passes; none if none was found."""
    x = representation.scaled(representation.kernel_q[:: max(representation.num_rows // 2000, 1)])
    length = np.linalg.norm(x - x_from, axis=1) + np.linalg.norm(x - x_to, axis=1)
    shortest = x[np.argsort(length, kind="stable")]
    for over in (shortest[:_NUM_SHORT], shortest[:: max(len(shortest) // _NUM_ANY, 1)]):
        if (found := slider.detour(x_from, x_to, over)) is not None:
            return found
    return x[:0]


def _stored(plan: Plan, waypoints: list[int], representation: QuotientRepresentation) -> list[int]:
    """The rows of `kernel_q` that some waypoints of a plan are."""
    rows = [stored_row(representation, plan.nodes[at], plan.waypoints_q[at]) for at in waypoints]
    return [row for row in rows if row is not None]


def _links(rows: np.ndarray) -> np.ndarray:
    """The rows that are links, unique and sorted; steps in the air have none."""
    return np.unique(rows[rows >= 0]).astype(int)
