"""Practice: the agent follows a plan slowly and repairs it where it would fail (naive)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from selftouch_drake.agent.motions import Plan, steps, touching
from selftouch_drake.agent.planning.members import of_mode
from selftouch_drake.agent.rehearsal import RehearsalMemory
from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.agent.sliding import Slider, straight

#: rad of path between the places at which the agent feels, and checks that it can be there.
_SAMPLED = 0.03

#: Number of remembered configurations that a detour through the air may pass: first those that
#: lengthen the path least; then any, because few paths lead out of some configurations.
_NUM_SHORT, _NUM_ANY = 60, 300

#: Number of remembered configurations to try as a place to move aside.
_NUM_ASIDE = 24


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


def go_along(plan: Plan, representation: QuotientRepresentation, slider: Slider) -> DryRun:
    """Follows the smooth path of a plan slowly.

    Args:
        plan: the plan.
        representation: the one used to make the plan.
        slider: feels in the agent's world.
    """
    length = plan.waypoint_s[-1]
    s = np.linspace(0.0, length, 2 + int(length / _SAMPLED))
    x = representation.scaled(plan.path(s))
    felt = slider.feel(x)
    step = steps(plan.waypoint_s, s)
    lost = touching(plan.waypoint_s, plan.in_air, s) & ~felt.any(axis=1)
    impossible = ~slider.possible(x)
    if not len(plan.in_air):  # a plan to stay
        lost[:] = impossible[:] = False
    return DryRun(
        s=s, felt=felt, lost=np.unique(step[lost]), impossible=np.unique(step[impossible])
    )


def practise(
    plan: Plan,
    doubtful: np.ndarray,
    slider: Slider,
    memory: RehearsalMemory,
    representation: QuotientRepresentation,
) -> tuple[RehearsalMemory, np.ndarray]:
    """Searches other ways for steps of a plan: slides for touching steps, detours in the air.

    Args:
        plan: the plan.
        doubtful: `(n,)` steps of the plan.
        slider: slides in the agent's world.
        memory: what the agent remembers so far.
        representation: the one used to make the plan.

    Returns:
        The memory with the ways that were found, and `(n,)` bool, whether one was found per step.
    """
    slides, x = memory.slides, representation.scaled(plan.waypoints_q)
    found = np.zeros(len(doubtful), dtype=bool)
    for number, step in enumerate(doubtful):
        x_from, x_to = x[step : step + 2]
        if plan.in_air[step]:
            detour = _detour(representation, slider, x_from, x_to)
            if detour is None:
                continue
            passed, node = detour, np.repeat(plan.nodes[step + 1], len(detour))
        elif plan.links[step] < 0:
            continue  # The joints that move are not those that touch.
        else:
            slid = slider.slide(x_from, x_to)
            # An empty slide means that the step is already as short as a part of a slide.
            if slid is None or not len(slid[0]):
                continue
            passed = slid[0]
            node = (slid[1] @ representation.target_sensations.T).argmax(axis=1)
        slides = slides.and_also(x_from, x_to, passed, node)
        found[number] = True
    return replace(memory, slides=slides), found


def _detour(
    representation: QuotientRepresentation, slider: Slider, x_from: np.ndarray, x_to: np.ndarray
) -> np.ndarray | None:
    """`(n, J)` configurations that a detour through the air passes; None if none was found."""
    x = representation.scaled(representation.kernel_q[:: max(representation.num_rows // 2000, 1)])
    length = np.linalg.norm(x - x_from, axis=1) + np.linalg.norm(x - x_to, axis=1)
    shortest = x[np.argsort(length, kind="stable")]
    for over in (shortest[:_NUM_SHORT], shortest[:: max(len(shortest) // _NUM_ANY, 1)]):
        if (found := slider.detour(x_from, x_to, over)) is not None:
            return found
    return None


def out_of_the_way(
    plan: Plan, representation: QuotientRepresentation, slider: Slider
) -> np.ndarray | None:
    """Where to move joints that a plan does not use, so that they obstruct it less.

    Args:
        plan: one with configurations that the robot cannot take.
        representation: the one used to make the plan.
        slider: knows which configurations the robot can take.

    Returns:
        `(J,)` a scaled configuration with new positions of these joints; None if none is better.
    """
    x = representation.scaled(plan.waypoints_q)
    still = x.max(axis=0) == x.min(axis=0)
    if plan.in_air.any() or not still.any():
        return None
    best, most = None, int(slider.possible(x).sum())
    if most == len(x):
        return None
    rows = np.concatenate([of_mode(representation, k, None) for k in np.unique(plan.nodes)])
    for row in rows[:: max(len(rows) // _NUM_ASIDE, 1)]:
        other = np.where(still, representation.scaled(representation.kernel_q[row]), x)
        there = int(slider.possible(other).sum())
        if there > most and slider.possible(straight(x[0], other[0])).all():
            best, most = other[0], there
    return best
