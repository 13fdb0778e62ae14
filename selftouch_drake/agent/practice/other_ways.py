"""Other ways for the doubtful steps of a plan: slides, and detours in the air (naive)."""

from dataclasses import replace

import numpy as np

from selftouch_drake.agent.memory import RehearsalMemory
from selftouch_drake.agent.motions import Plan
from selftouch_drake.agent.practice.sliding import Slider
from selftouch_drake.agent.representation.quotient import QuotientRepresentation

#: Number of remembered configurations that a detour through the air may pass: first those that
#: lengthen the path least; then any, because few paths lead out of some configurations.
_NUM_SHORT, _NUM_ANY = 60, 300

#: Most configurations, evenly taken from all, among which a detour looks for those.
_NUM_FOR_DETOURS = 2000


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
        x_from, x_to = x[touches[number - 1]], x[touches[number]]
        if plan.in_air[step]:
            passed = _detour(representation, slider, x_from, x_to)
            node = np.repeat(plan.nodes[step + 1], len(passed))
        elif plan.links[step] >= 0:
            passed, node = _slide(representation, slider, x_from, x_to, plan.nodes[step])
        else:
            # On a step without a link, the joints that move are not those that touch.
            passed, node = x[:0], plan.nodes[:0]
        # An empty slide means that the step is already as short as a part of a slide.
        if len(passed):
            slides = slides.and_also(x_from, x_to, passed, node)
        else:
            without.append(step)
    return replace(memory, slides=slides), links_of(plan, without)


def links_of(plan: Plan, doubtful: list[int] | np.ndarray) -> np.ndarray:
    """The links of some steps of a plan, unique and sorted; steps in the air have none."""
    links = plan.links[doubtful]
    return np.unique(links[links >= 0]).astype(int)


def _slide(
    representation: QuotientRepresentation,
    slider: Slider,
    x_from: np.ndarray,
    x_to: np.ndarray,
    kernel: int,
) -> tuple[np.ndarray, np.ndarray]:
    """`(n, J)` scaled configurations that a slide passes, and `(n,)` the kernel felt at each.

    Kernels are of the part to which the step's first kernel belongs. Both arrays are empty if no
    slide was found.
    """
    slid = slider.slide(x_from, x_to)
    if slid is None:
        return np.empty((0, len(x_from))), np.empty(0, dtype=int)
    passed, felt = slid
    part = representation.part == representation.part[kernel]
    likeness = np.where(part, felt @ representation.target_sensations.T, -1.0)
    return passed, likeness.argmax(axis=1)


def _detour(
    representation: QuotientRepresentation, slider: Slider, x_from: np.ndarray, x_to: np.ndarray
) -> np.ndarray:
    """`(n, J)` scaled configurations that a detour through the air passes; empty without one."""
    every = max(representation.num_rows // _NUM_FOR_DETOURS, 1)
    x = representation.scaled(representation.kernel_q[::every])
    length = np.linalg.norm(x - x_from, axis=1) + np.linalg.norm(x - x_to, axis=1)
    shortest = x[np.argsort(length, kind="stable")]
    for over in (shortest[:_NUM_SHORT], shortest[:: max(len(shortest) // _NUM_ANY, 1)]):
        if (found := slider.detour(x_from, x_to, over)) is not None:
            return found
    return x[:0]
