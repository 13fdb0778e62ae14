"""Chooses the motor kernel sets to pass through (paper, section III)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.sparse import sparray
from scipy.sparse.csgraph import dijkstra

from selftouch_drake.agent.planning.heap import drop, push
from selftouch_drake.agent.planning.members import firm_members
from selftouch_drake.agent.planning.steps import least_square_step, square_step
from selftouch_drake.agent.representation.graphs import target_distances
from selftouch_drake.agent.representation.kernels import KernelSets
from selftouch_drake.agent.representation.neighbours import component_labels
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.representation.set_distances import LinkedNearest, linked_nearest

#: `linked_nearest`, or what knows its result.
FindNearest = Callable[[KernelSets, np.ndarray], LinkedNearest]
#: Links between targets farther apart than this many spacings are leaps: they cut through the body.
LEAP_SPACINGS = 1.25
#: The cost of a leap grows with this power of its length beyond that. Measured on about 200 plans
#: each on cube and torus (300 targets): out of contact 2.8 % of the time without it, 0.7 % with the
#: 8th power, 0.6 % with the 16th, on paths 4 % longer. With 1000 targets all work equally well.
LEAP_POWER = 16.0
# How many configurations of one kernel a search may visit, and their least distance (rad). The
# first visit is not always the best to continue from: with 1, 4 and 8 visits the sum of cubed steps
# is 1.3, 1.1 and 1.08 times the optimum.
_MAX_VISITS = 4
_APART = 0.3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RouteGraph:
    """Linked kernels and their firm configurations of one mode, arranged for search.

    Only the J joints that matter in the mode count.

    Attributes:
        joints: `(J,)` indices of these joints.
        firm_row: `(F,)` rows of the firm configurations in `kernel_q`, grouped by kernel.
        firm_x: `(F, J)` float32 rad, these configurations, scaled.
        firm_kernel: `(F,)` the kernel of each.
        firm_offsets: `(K + 1,)` kernel k owns rows `firm_offsets[k]:firm_offsets[k + 1]`.
        component: `(K,)` links join kernels of one component; -1 without firm configurations.
        link_offsets: `(K + 1,)` ways `link_offsets[k]:link_offsets[k + 1]` leave kernel k. A way is
            a link in one direction.
        link_kernel: `(2L,)` the kernel that each way leads to.
        link_row: `(2L,)` the link of each way.
        step_offsets: `(K + 1,)` kernel k owns steps `step_offsets[k]:step_offsets[k + 1]`: for
            each of its firm configurations, one along each way that leaves it.
        step_row: where each step leads: to the nearest firm configuration of the other kernel.
        step_squared: float32 rad^2, the squared length of each step.
        cost: `(F + 2,)` scratch of searches; infinite between them.
        before: `(F + 2,)` scratch of searches.
    """

    joints: np.ndarray
    firm_row: np.ndarray
    firm_x: np.ndarray
    firm_kernel: np.ndarray
    firm_offsets: np.ndarray
    component: np.ndarray
    link_offsets: np.ndarray
    link_kernel: np.ndarray
    link_row: np.ndarray
    step_offsets: np.ndarray
    step_row: np.ndarray
    step_squared: np.ndarray
    cost: np.ndarray
    before: np.ndarray

    @classmethod
    def of(
        cls,
        representation: QuotientRepresentation,
        links: np.ndarray,
        mode: int = 0,
        find_nearest: FindNearest = linked_nearest,
    ) -> RouteGraph:
        """Arranges one mode of `representation` and the `(L, 2)` links for search."""
        num_kernels = representation.num_targets
        joints = np.flatnonzero(representation.mode_joints[mode])
        by_kernel = [firm_members(representation, k, mode) for k in range(num_kernels)]
        firm_row = np.concatenate(by_kernel)
        firm_x = representation.scaled(representation.kernel_q[firm_row])[:, joints]
        firm_x = firm_x.astype(np.float32)
        sizes = np.array([len(rows) for rows in by_kernel])
        firm_offsets = np.concatenate([[0], np.cumsum(sizes)])
        usable = np.flatnonzero((sizes[links] > 0).all(axis=1))
        component = component_labels(links[usable], num_kernels)
        tail, head = np.concatenate([links[usable], links[usable, ::-1]]).T
        order = np.lexsort((head, tail))
        ways = np.stack([tail, head], axis=1)[order]
        link_offsets = np.searchsorted(ways[:, 0], np.arange(num_kernels + 1))
        nearest = find_nearest(KernelSets(firm_x, firm_offsets), ways)
        step_offsets = nearest.offsets[link_offsets]
        return cls(
            joints=joints,
            firm_row=firm_row,
            firm_x=firm_x,
            firm_kernel=np.repeat(np.arange(num_kernels), sizes),
            firm_offsets=firm_offsets,
            component=np.where(sizes > 0, component, -1),
            link_offsets=link_offsets,
            link_kernel=np.ascontiguousarray(ways[:, 1]),
            link_row=np.tile(usable, 2)[order],
            step_offsets=step_offsets,
            step_row=_by_configuration(nearest.row, step_offsets, sizes),
            step_squared=_by_configuration(nearest.squared, step_offsets, sizes),
            cost=np.full(len(firm_x) + 2, np.inf),
            before=np.empty(len(firm_x) + 2, dtype=np.int32),
        )

    def firm_configurations(self, kernel: int) -> np.ndarray:
        """`(n, J)` rad, the firm configurations of a kernel, scaled."""
        return self.firm_x[self.firm_offsets[kernel] : self.firm_offsets[kernel + 1]]

    def joins(self, start: int, goal: int) -> bool:
        """Whether links lead from one kernel to the other."""
        return bool(self.component[start] == self.component[goal] >= 0)


def _by_configuration(entries: np.ndarray, offsets: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Entries of `LinkedNearest` by the configuration that a step leaves, instead of by the link.

    A search leaves a configuration along all ways at once, so its steps should be in one place.

    Args:
        entries: for each kernel, one per way that leaves it and configuration.
        offsets: `(K + 1,)` kernel k owns `offsets[k]:offsets[k + 1]`.
        sizes: `(K,)` number of configurations of each kernel.
    """
    moved = np.empty_like(entries)
    for start, end, size in zip(offsets[:-1], offsets[1:], sizes, strict=True):
        if end > start:
            moved[start:end] = entries[start:end].reshape(-1, size).T.ravel()
    return moved


def leap_penalty(
    representation: QuotientRepresentation,
    links: np.ndarray,
    *,
    spacings: float = LEAP_SPACINGS,
    power: float = LEAP_POWER,
) -> np.ndarray:
    """Factors on the cost of links that join very different sensations.

    Configurations of two kernels can be close although the places that they touch are not: the
    finger would leap through the inside of the body. The distance of the target sensations
    separates these links from the others (area under the ROC curve, on edges of the graph, 0.94 to
    0.98; the motor step alone 0.60 to 0.63).

    Args:
        representation: what the agent has learned.
        links: `(L, 2)` pairs of kernels.
        spacings: greatest distance that is not a leap, in spacings of the target sensations.
        power: how fast the factor grows beyond that; 0 for no penalty.

    Returns:
        `(L,)` factors, 1 or more.
    """
    distance, spacing = target_distances(representation)
    i, j = links.T
    return np.maximum(1.0, distance[i, j] / (spacings * spacing)) ** power


def carried_route(
    graph: RouteGraph,
    x_start: np.ndarray,
    start: int,
    goal: int,
    goal_x: np.ndarray,
    *,
    penalty: np.ndarray | None = None,
) -> np.ndarray | None:
    """Dijkstra that carries motor configurations to every kernel it reaches.

    The search enters a kernel at its firm configuration nearest to the one carried by its parent.
    The step costs the cube of that distance, which is the distance that the agent would really
    move. Cubes prefer many short steps to a long one, which would leave the skin; higher powers
    keep contact no better and only lengthen the path. The search may enter a kernel several times,
    at configurations far from each other.

    Args:
        graph: the linked kernels.
        x_start: `(J,)` rad, a scaled configuration of kernel `start`.
        start: the kernel to leave.
        goal: the kernel to reach.
        goal_x: `(n, J)` rad, the configurations at which the goal may be entered.
        penalty: `(L,)` positive factors on the cost of each link.

    Returns:
        `(N,)` kernels from `start` to `goal`, or None if the links do not join them.
    """
    if start == goal:
        return np.array([start])
    factor = np.ones(len(graph.link_row)) if penalty is None else penalty[graph.link_row]
    route = _carry(
        graph.firm_x,
        graph.firm_kernel,
        graph.firm_offsets,
        graph.link_offsets,
        graph.link_kernel,
        graph.step_offsets,
        graph.step_row,
        graph.step_squared,
        factor.astype(np.float64),
        np.asarray(x_start, dtype=np.float32),
        start,
        goal,
        np.ascontiguousarray(goal_x, dtype=np.float32),
        graph.cost,
        graph.before,
    )
    return route if len(route) else None


def shortest_route(distance: np.ndarray | sparray, start: int, goal: int) -> np.ndarray | None:
    """The shortest path over distances between kernels: the paper's literal method.

    Args:
        distance: `(K, K)` any unit; dense for the complete graph, sparse for a pruned one.
        start: the kernel to leave.
        goal: the kernel to reach.

    Returns:
        `(N,)` kernels from `start` to `goal`, or None if there is no path.
    """
    _, parent = dijkstra(distance, directed=False, indices=start, return_predecessors=True)
    return _backtrack(parent, start, goal)


def _backtrack(parent: np.ndarray, start: int, goal: int) -> np.ndarray | None:
    nodes = [goal]
    while nodes[-1] != start:
        if parent[nodes[-1]] < 0:
            return None
        nodes.append(int(parent[nodes[-1]]))
    return np.array(nodes[::-1])


@njit(cache=True)
def _carry(
    firm_x,
    firm_kernel,
    firm_offsets,
    link_offsets,
    link_kernel,
    step_offsets,
    step_row,
    step_squared,
    factor,
    x_start,
    start,
    goal,
    goal_x,
    cost,
    before,
):
    """`(N,)` kernels on the cheapest route from `start` to `goal`; empty if there is none."""
    num_firm, num_kernels = len(firm_x), len(firm_offsets) - 1
    # Places are firm configurations, then the start and the goal.
    at_start, at_goal = num_firm, num_firm + 1
    visits = np.zeros(num_kernels, dtype=np.int64)
    visited = np.empty((num_kernels, _MAX_VISITS), dtype=np.int64)
    # Entries of the queue, and all places that it ever held; each way leads to one per visit.
    most = (_MAX_VISITS + 1) * len(link_kernel) + 1
    costs, places = np.empty(most), np.empty(most, dtype=np.int32)
    queued, num_queued = np.empty(most, dtype=np.int32), 0
    cost[at_start], before[at_start] = 0.0, -1
    size = push(costs, places, 0, 0.0, at_start)
    while size > 0:
        through, place = costs[0], np.int64(places[0])
        size = drop(costs, places, size)
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
        first_way, last_way = link_offsets[kernel], link_offsets[kernel + 1]
        entry = step_offsets[kernel] + (place - firm_offsets[kernel]) * (last_way - first_way)
        for way in range(first_way, last_way):
            there = link_kernel[way]
            if there == goal:
                to, step = at_goal, least_square_step(x, goal_x)[1]
            elif visits[there] == _MAX_VISITS:
                continue
            elif place == at_start:
                firm = firm_x[firm_offsets[there] : firm_offsets[there + 1]]
                nearest, step = least_square_step(x, firm)
                to = firm_offsets[there] + nearest
            else:
                to, step = step_row[entry + way - first_way], step_squared[entry + way - first_way]
            onward = through + factor[way] * step * np.sqrt(step)
            if onward < cost[to] and onward < cost[at_goal]:
                cost[to], before[to] = onward, place
                queued[num_queued] = to
                num_queued += 1
                size = push(costs, places, size, onward, to)
    route = [goal]
    if cost[at_goal] < np.inf:
        passed = np.int64(before[at_goal])
        while passed != at_start:
            route.append(firm_kernel[passed])
            passed = np.int64(before[passed])
        route.append(start)
    for number in range(num_queued):
        cost[queued[number]] = np.inf
    return np.array(route[::-1] if len(route) > 1 else route[:0])
