"""A dry run: the agent follows a plan slowly and feels where it would fail (naive)."""

from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.motions import Plan, steps
from selftouch_drake.agent.practice.sliding import Slider
from selftouch_drake.agent.representation.quotient import QuotientRepresentation, stored_row
from selftouch_drake.agent.representation.touches import felt_kernels

#: mu of path length between the places at which the agent feels, and checks that it can be there.
_SAMPLED = 0.03

#: mu within which a plan may leave a start whose rigid parts are nearer to each other than practice
#: allows: it is there already. Without, 5 of 100 plans of an infant had no way.
_LEAVING = 0.3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DryRun:
    """What the agent felt when it followed a plan slowly.

    n places, S receptors.

    Attributes:
        s: `(n,)` path lengths of the places, as in `Plan.waypoint_s`.
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


def dry_run(plan: Plan, slider: Slider) -> DryRun:
    """Follows the smooth path of a plan slowly; nothing is dynamic, nothing is repaired."""
    length = plan.waypoint_s[-1]
    s = np.linspace(0.0, length, 2 + int(length / _SAMPLED))
    x = plan.path(s) * slider.joint_scale
    along = slider.feel_along(x)
    felt, impossible = along.sensation, ~along.reached
    leaves = int(along.reached.argmax())
    if s[leaves] <= _LEAVING:
        impossible[:leaves] = False
    step = steps(plan.waypoint_s, s)
    lost = plan.touching(s) & ~felt.any(axis=1)
    if not len(plan.in_air):  # a plan to stay
        lost[:] = impossible[:] = False
    return DryRun(
        s=s, felt=felt, lost=np.unique(step[lost]), impossible=np.unique(step[impossible])
    )


def missed_touches(plan: Plan, run: DryRun, representation: QuotientRepresentation) -> list[int]:
    """The stored touches, as rows of `kernel_q`, at which a dry run did not feel what it should."""
    return stored_touches(plan, misses(plan, run, representation), representation)


def misses(plan: Plan, run: DryRun, representation: QuotientRepresentation) -> list[int]:
    """The waypoints of a plan at which a dry run did not feel what it should.

    Where the plan lands after a way through the air, anything must be felt; at its end, the goal.
    """
    if not len(plan.in_air):  # a plan to stay
        return []
    landings = np.flatnonzero(plan.in_air) + 1
    felt = run.felt[np.abs(run.s - plan.waypoint_s[landings][:, None]).argmin(axis=1)]
    without = landings[~felt.any(axis=1)].tolist()
    if plan.goal not in felt_kernels(representation, run.felt[-1]):
        without.append(len(plan.nodes) - 1)
    return without


def stored_touches(
    plan: Plan, waypoints: list[int], representation: QuotientRepresentation
) -> list[int]:
    """Rows of `kernel_q`, of those waypoints of a plan that are stored touches."""
    rows = [stored_row(representation, plan.nodes[at], plan.waypoints_q[at]) for at in waypoints]
    return [row for row in rows if row is not None]
