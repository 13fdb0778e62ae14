"""Chooses the motor kernel sets to pass through (paper, section III)."""

import heapq
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit

from selftouch_drake.agent.representation.graphs import component_labels
from selftouch_drake.agent.representation.kernels import KernelSets
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.representation.set_distances import linked_nearest, quantile

#: What a route keeps short: its path on the `body`, or the motion of the `joints`.
Prefer = Literal["body", "joints"]

# Steps of joints cost this power of their squared length: in rad if a route prefers joints, in
# typical steps if it prefers the body (a whole power takes less time). Contact is lost on the
# longest tenth of the steps; to keep its path on the body short, a route must avoid these alone.
# Measured on 100 plans on each of three runs (torus twice, cube; 100,000 touches, 300 targets):
# with joints, the path is 1.63, 1.54, 1.45 times the shortest (median), contact 99.8, 99.5, 99.5 %;
# with body 1.29, 1.22, 1.22 and 99.8, 99.8, 99.5 %. If the length along the body counts twice,
# 1.20, 1.17, 1.15 and 99.6, 99.5, 98.9 %.
_POWER = {"joints": 1.5, "body": 4}

# Links between targets farther apart than this many spacings are leaps: they cut through the body.
_LEAP_SPACINGS = 1.25
# The cost of a leap grows with this power of its length beyond that. Measured on about 200 plans
# each on cube and torus (300 targets): out of contact 2.8 % of the time without it, 0.7 % with the
# 8th power, 0.6 % with the 16th, on paths 4 % longer. With 1000 targets all work equally well.
_LEAP_POWER = 16.0
# How many configurations of one kernel a search may visit, and their least distance (rad). The
# first visit is not always the best to continue from: with 1, 4 and 8 visits the sum of cubed steps
# is 1.3, 1.1 and 1.08 times the optimum.
_MAX_VISITS = 4
_APART = 0.3
# A configuration is isolated if it is farther than this from all strong ones of its kernel, in rad.
# Measured on a torus with two fingers (150 plans): out of contact on 1.1 % of the length if plans
# use the strongest half, on 0.7 % if they use the strongest third and the isolated ones. The worst
# of 200 plans with one finger: 18 % and 3 %.
_ISOLATED = 1.0


def firm_members(representation: QuotientRepresentation, kernel: int, mode: int) -> np.ndarray:
    """Rows of `kernel_q` that plans pass through: the strongest third of the touches of a kernel.

    Firm touches keep contact. But some postures of the arm were tried so rarely that no touch of
    the strongest third is near; a plan that starts there would have to leap. So isolated touches
    count as well, unless they are among the lightest quarter. All rows are of `mode`.
    """
    rows = _of_mode(representation, kernel, mode)
    if not len(rows):
        return rows
    strength = representation.kernel_strength[rows]
    x = representation.scaled(representation.kernel_q[rows])
    x = x[:, representation.mode_joints[mode]]
    strong, felt = strength >= _quantile(strength, 2 / 3), strength >= _quantile(strength, 0.25)
    return rows[_strong_or_isolated(x, strong, felt)]


def goal_members(
    representation: QuotientRepresentation, kernel: int, mode: int | None = None
) -> np.ndarray:
    """Rows of `kernel_q`: the half of a kernel nearest its target sensation, without light touches.

    A plan that ended near the border of a kernel could miss it by a small error of the motion.
    With the firm half alone, the last step would become long. All rows are of `mode`, if given.
    """
    rows = _of_mode(representation, kernel, mode)
    if not len(rows):
        return rows
    error, strength = representation.kernel_error[rows], representation.kernel_strength[rows]
    near, felt = error <= np.median(error), strength >= _quantile(strength, 0.25)
    return rows[near & felt if np.any(near & felt) else near]


def _of_mode(representation: QuotientRepresentation, kernel: int, mode: int | None) -> np.ndarray:
    members = representation.members(kernel)
    rows = np.arange(members.start, members.stop)
    return rows if mode is None else rows[representation.kernel_mode[rows] == mode]


def _quantile(values: np.ndarray, share: float) -> np.floating:
    return quantile(values[:, None], share)[0]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RouteGraph:
    """Linked kernels and their firm configurations of one mode, arranged for search.

    Only the J joints that matter in the mode count.

    Attributes:
        joints: `(J,)` indices of these joints.
        firm: F firm configurations, scaled, float32 rad.
        firm_row: `(F,)` their rows in `kernel_q`.
        firm_kernel: `(F,)` the kernel of each.
        component: `(K,)` links join kernels of one component; -1 without firm configurations.
        way_offsets: `(K + 1,)` ways `way_offsets[k]:way_offsets[k + 1]` leave kernel k. A way is
            a link in one direction.
        way_kernel: `(2L,)` the kernel that each way leads to.
        way_link: `(2L,)` its link.
        steps: along each way, from each firm configuration of the kernel that it leaves, as of
            `linked_nearest`.
        typical_step: rad, the median of these steps.
    """

    joints: np.ndarray
    firm: KernelSets
    firm_row: np.ndarray
    firm_kernel: np.ndarray
    component: np.ndarray
    way_offsets: np.ndarray
    way_kernel: np.ndarray
    way_link: np.ndarray
    steps: tuple[np.ndarray, np.ndarray, np.ndarray]
    typical_step: float

    @classmethod
    def of(
        cls, representation: QuotientRepresentation, links: np.ndarray, mode: int = 0
    ) -> "RouteGraph":
        """Arranges one mode of `representation` and the `(L, 2)` links for search."""
        num_kernels = representation.num_targets
        joints = np.flatnonzero(representation.mode_joints[mode])
        by_kernel = [firm_members(representation, k, mode) for k in range(num_kernels)]
        firm_row = np.concatenate(by_kernel)
        x = representation.scaled(representation.kernel_q[firm_row])[:, joints]
        sizes = np.array([len(rows) for rows in by_kernel])
        firm = KernelSets(x.astype(np.float32), np.concatenate([[0], np.cumsum(sizes)]))
        usable = np.flatnonzero((sizes[links] > 0).all(axis=1))
        component = component_labels(links[usable], num_kernels)
        tail, head = np.concatenate([links[usable], links[usable, ::-1]]).T
        order = np.lexsort((head, tail))
        ways = np.stack([tail, head], axis=1)[order]
        steps = linked_nearest(firm, ways)
        typical = float(np.sqrt(np.median(steps[2]))) if len(steps[2]) else 0.0
        return cls(
            joints=joints,
            firm=firm,
            firm_row=firm_row,
            firm_kernel=firm.kernel,
            component=np.where(sizes > 0, component, -1),
            way_offsets=np.searchsorted(ways[:, 0], np.arange(num_kernels + 1)),
            way_kernel=np.ascontiguousarray(ways[:, 1]),
            way_link=np.tile(usable, 2)[order],
            steps=steps,
            typical_step=typical or 1.0,
        )

    def joins(self, start: int, goal: int) -> bool:
        """Whether links lead from one kernel to the other."""
        return bool(self.component[start] == self.component[goal] >= 0)


def leap_penalty(length: np.ndarray) -> np.ndarray:
    """`(L,)` factors, 1 or more, on the cost of links of these lengths, of `link_lengths`.

    Configurations of two kernels can be close although the places that they touch are not: the
    finger would leap through the inside of the body. The distance of the target sensations
    separates these links from the others (area under the ROC curve, on edges of the graph, 0.94 to
    0.98; the motor step alone 0.60 to 0.63).
    """
    return np.maximum(1.0, length / _LEAP_SPACINGS) ** _LEAP_POWER


def carried_route(
    graph: "RouteGraph",
    x_start: np.ndarray,
    start: int,
    goal: int,
    goal_x: np.ndarray,
    penalty: np.ndarray,
    length: np.ndarray | None = None,
) -> np.ndarray:
    """Dijkstra that carries motor configurations to every kernel it reaches.

    The search enters a kernel at its firm configuration nearest to the one carried by its parent.
    The step costs a power of that distance, which is the distance that the agent would really move.
    Powers prefer many short steps to a long one, which would leave the skin. A route that is to be
    short on the body also pays for the length of each link. The search may enter a kernel several
    times, at configurations far from each other.

    It leaves `(J,)` x_start of the kernel `start`, and may enter the goal at `(n, J)` goal_x, both
    scaled, rad; `(L,)` positive penalties are factors on the cost of each link; `(L,)` lengths are
    as of `link_lengths`, None if only joints count.

    Returns:
        `(N,)` kernels from `start` to `goal`; empty if the links do not join them.
    """
    if start == goal:
        return np.array([start])
    if length is None:
        power, unit, length = _POWER["joints"], 1.0, np.zeros(len(penalty))
    else:
        power, unit = _POWER["body"], graph.typical_step
    return _carry(
        graph.firm.x,
        graph.firm_kernel,
        graph.firm.offsets,
        graph.way_offsets,
        graph.way_kernel,
        *graph.steps,
        (penalty / unit ** (2 * power))[graph.way_link],
        length[graph.way_link],
        power,
        np.asarray(x_start, dtype=np.float32),
        start,
        goal,
        np.ascontiguousarray(goal_x, dtype=np.float32),
    )


@njit(cache=True)
def _carry(
    firm_x,
    firm_kernel,
    firm_offsets,
    way_offsets,
    way_kernel,
    step_offsets,
    step_row,
    step_squared,
    factor,
    length,
    power,
    x_start,
    start,
    goal,
    goal_x,
):
    num_firm, num_kernels = len(firm_x), len(firm_offsets) - 1
    # Places are firm configurations, then the start and the goal.
    at_start, at_goal = num_firm, num_firm + 1
    cost, before = np.full(num_firm + 2, np.inf), np.empty(num_firm + 2, dtype=np.int32)
    visits = np.zeros(num_kernels, dtype=np.int64)
    visited = np.empty((num_kernels, _MAX_VISITS), dtype=np.int64)
    cost[at_start], before[at_start] = 0.0, -1
    queue = [(0.0, at_start)]
    while queue:
        through, place = heapq.heappop(queue)
        if place == at_goal:
            break
        if through > cost[place]:
            continue
        if place == at_start:
            x, kernel = x_start, start
        else:
            x, kernel = firm_x[place], firm_kernel[place]
            new = visits[kernel] < _MAX_VISITS
            for visit in range(visits[kernel]):
                new &= square_step(x, firm_x[visited[kernel, visit]]) > _APART**2
            if not new:
                continue
            visited[kernel, visits[kernel]] = place
            visits[kernel] += 1
        for way in range(way_offsets[kernel], way_offsets[kernel + 1]):
            there = way_kernel[way]
            if there == goal:
                to, step = at_goal, _nearest_step(x, goal_x)[1]
            elif visits[there] == _MAX_VISITS:
                continue
            elif place == at_start:
                first = firm_offsets[there]
                nearest, step = _nearest_step(x, firm_x[first : firm_offsets[there + 1]])
                to = first + nearest
            else:
                entry = step_offsets[way] + place - firm_offsets[kernel]
                to, step = step_row[entry], step_squared[entry]
            onward = through + factor[way] * np.float64(step) ** power + length[way]
            if onward < cost[to] and onward < cost[at_goal]:
                cost[to], before[to] = onward, place
                heapq.heappush(queue, (onward, to))
    route = [goal]
    if cost[at_goal] < np.inf:
        place = before[at_goal]
        while place != at_start:
            route.append(firm_kernel[place])
            place = before[place]
        route.append(start)
    return np.array(route[::-1] if len(route) > 1 else route[:0])


@njit(cache=True)
def _strong_or_isolated(x, strong, felt):
    """`(n,)` bool: `strong`, or `felt` and far from all strong ones; x is `(n, J)` rad."""
    kept, among = strong.copy(), x[strong]
    for row in np.flatnonzero(felt & ~strong):
        for other in range(len(among)):
            if square_step(x[row], among[other]) <= _ISOLATED**2:
                break
        else:
            kept[row] = True
    return kept


# These two are not cached: the functions that call them keep them.
@njit
def square_step(x, y):
    """The squared distance of two configurations `(J,)`."""
    total = np.float32(0.0)
    for joint in range(len(x)):
        step = x[joint] - y[joint]
        total += step * step
    return total


@njit
def _nearest_step(x, candidates):
    """The first row of `(n, J)` candidates that is nearest to x, and its squared distance."""
    nearest, least = 0, np.float32(np.inf)
    for row in range(len(candidates)):
        square = square_step(x, candidates[row])
        if square < least:
            nearest, least = row, square
    return nearest, least
