"""A route: the points of M/=_Psi that a motion passes through (paper, "Motor planning").

"In this way, the agent is able to proceed from any point to another along a path computed in the
graph." Each point is a set of motor configurations, so the cost of a step depends on where in a set
the agent is. The search carries the configuration along.
"""

import heapq
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from .distances import Nearest, linked_nearest, square_step
from .kernels import KernelSets

# A step of the joints costs this power of its squared length, in typical steps. Contact is lost on
# the longest tenth of the steps: a route avoids these alone, to keep its path on the body short. A
# whole power takes less time.
POWER = 4

# How many configurations of one kernel a search may visit, and their least distance (mu). The
# first visit is not always the best to continue from: with 1, 4 and 8 visits the sum of cubed steps
# is 1.3, 1.1 and 1.08 times the optimum.
_MAX_VISITS = 4
_APART = 0.3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RouteGraph:
    """Linked kernels and their firm configurations, arranged for search.

    Attributes:
        firm: F firm configurations of K kernels, scaled, float32 mu; a kernel may have none.
        firm_kernel: `(F,)` the kernel of each.
        way_offsets: `(K + 1,)` ways `way_offsets[k]:way_offsets[k + 1]` leave kernel k. A way is
            a link in one direction.
        way_kernel: `(2L,)` the kernel that each way leads to.
        way_link: `(2L,)` its link.
        steps: along each way, from each firm configuration of the kernel that it leaves to the
            nearest one of the kernel that it leads to.
        typical_step: mu, the median of these steps.
    """

    firm: KernelSets
    firm_kernel: np.ndarray
    way_offsets: np.ndarray
    way_kernel: np.ndarray
    way_link: np.ndarray
    steps: Nearest
    typical_step: float

    @classmethod
    def of(cls, firm: KernelSets, links: np.ndarray) -> "RouteGraph":
        """Arranges firm configurations and the `(L, 2)` links for search."""
        num_kernels, sizes = len(firm), firm.sizes
        usable = np.flatnonzero((sizes[links] > 0).all(axis=1))
        tail, head = np.concatenate([links[usable], links[usable, ::-1]]).T
        order = np.lexsort((head, tail))
        ways = np.stack([tail, head], axis=1)[order]
        steps = linked_nearest(firm, ways)
        typical = float(np.sqrt(np.median(steps.squared))) if len(steps.squared) else 0.0
        return cls(
            firm=firm,
            firm_kernel=firm.kernel,
            way_offsets=np.searchsorted(ways[:, 0], np.arange(num_kernels + 1)),
            way_kernel=np.ascontiguousarray(ways[:, 1]),
            way_link=np.tile(usable, 2)[order],
            steps=steps,
            typical_step=typical or 1.0,
        )

    def step_price(self, penalty: np.ndarray) -> np.ndarray:
        """`(L,)` what a squared step costs along each link, by `(L,)` penalties, 1 or more."""
        return penalty / self.typical_step ** (2 * POWER)


class Query(NamedTuple):
    """Where a route begins and ends.

    Attributes:
        start: the kernel at the start.
        x_start: `(J,)` the scaled configuration there.
        goal: the kernel at the end.
        x_goal: `(n, J)` the scaled configurations at which it may be entered.
    """

    start: int
    x_start: np.ndarray
    goal: int
    x_goal: np.ndarray


def carried_route(
    graph: RouteGraph, query: Query, price: np.ndarray, length: np.ndarray, power: float = POWER
) -> np.ndarray:
    """Dijkstra that carries motor configurations to every kernel it reaches.

    The search enters a kernel at its firm configuration nearest to the one carried by its parent.
    A step costs `price * squared distance ** power + length`, of the distance that the agent would
    really move. Powers prefer many short steps to a long one, which would leave the skin; the
    length keeps the route short on the body. The search may enter a kernel several times, at
    configurations far from each other.

    Args:
        graph: what is searched.
        query: where the route begins and ends.
        price: `(L,)` positive, of each link, as from `RouteGraph.step_price`.
        length: `(L,)` lengths of the links, as in `links.link_lengths`.
        power: of the squared distance.

    Returns:
        `(N,)` kernels from the start to the goal; empty if the links do not join them.
    """
    if query.start == query.goal:
        return np.array([query.start])
    x_start = np.asarray(query.x_start, dtype=np.float32)
    x_goal = np.ascontiguousarray(query.x_goal, dtype=np.float32)
    return _carry(
        (graph.firm.x, graph.firm_kernel, graph.firm.offsets),
        (graph.way_offsets, graph.way_kernel, *graph.steps),
        (price[graph.way_link], length[graph.way_link], power),
        (query.start, x_start, query.goal, x_goal),
    )


# Plain tuples: numba takes a tenth of a millisecond to recognise named ones, in each call. The
# choice of an entry stays in the loop: as a function that is handed these tuples it takes twice the
# time.
@njit(cache=True)
def _carry(firm, ways, costs, query):
    """The search of `carried_route`."""
    firm_x, firm_kernel, firm_offsets = firm
    way_offsets, way_kernel, step_offsets, step_row, step_squared = ways
    price, length, power = costs
    start, x_start, goal, x_goal = query
    num_firm, num_kernels = len(firm_x), len(firm_offsets) - 1
    # Places are firm configurations, then the start and the goal.
    at_start, at_goal = num_firm, num_firm + 1
    cost, before = np.full(num_firm + 2, np.inf), np.empty(num_firm + 2, dtype=np.int32)
    num_visits = np.zeros(num_kernels, dtype=np.int64)
    visited = np.empty((num_kernels, _MAX_VISITS), dtype=np.int64)
    cost[at_start], before[at_start] = 0.0, -1
    queue = [(0.0, at_start)]
    while queue:
        through, place = heapq.heappop(queue)
        if place == at_goal:
            return _walked_back(before, firm_kernel, start, goal)
        if through > cost[place]:
            continue
        if place == at_start:
            x, kernel = x_start, start
        else:
            x, kernel = firm_x[place], firm_kernel[place]
            if not _visit(firm_x, place, visited[kernel], num_visits[kernel]):
                continue
            num_visits[kernel] += 1
        for way in range(way_offsets[kernel], way_offsets[kernel + 1]):
            there = way_kernel[way]
            if there == goal:
                to, step = at_goal, _nearest_step(x, x_goal)[1]
            elif num_visits[there] == _MAX_VISITS:
                continue
            elif place == at_start:
                first = firm_offsets[there]
                nearest, step = _nearest_step(x, firm_x[first : firm_offsets[there + 1]])
                to = first + nearest
            else:
                entry = step_offsets[way] + place - firm_offsets[kernel]
                to, step = step_row[entry], step_squared[entry]
            onward = through + price[way] * np.float64(step) ** power + length[way]
            if onward < cost[to] and onward < cost[at_goal]:
                cost[to], before[to] = onward, place
                heapq.heappush(queue, (onward, to))
    return np.empty(0, dtype=np.int64)


# What follows is not cached: the function that calls it keeps it.
@njit
def _visit(firm_x, place, visited, num_visits):
    """Whether a search may visit a place of a kernel; writes that it does."""
    if num_visits == _MAX_VISITS:
        return False
    for visit in range(num_visits):
        if square_step(firm_x[place], firm_x[visited[visit]]) <= _APART**2:
            return False
    visited[num_visits] = place
    return True


@njit
def _walked_back(before, firm_kernel, start, goal):
    """The kernels from the start to the goal, by the place before each place."""
    num_firm = len(firm_kernel)
    route = [goal]
    place = before[num_firm + 1]
    while place != num_firm:
        route.append(firm_kernel[place])
        place = before[place]
    route.append(start)
    return np.array(route[::-1])


@njit
def _nearest_step(x, candidates):
    """The first row of `(n, J)` candidates that is nearest to x, and its squared distance."""
    nearest, least = 0, np.float32(np.inf)
    for row in range(len(candidates)):
        square = square_step(x, candidates[row])
        if square < least:
            nearest, least = row, square
    return nearest, least
