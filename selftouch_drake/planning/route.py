"""Which motor kernel sets to pass through: routes over the quotient graph (paper, section III)."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.sparse import sparray
from scipy.sparse.csgraph import dijkstra

from selftouch_drake.representation.quotient import QuotientRepresentation

#: Links between targets further apart than this many spacings are leaps: they cut through the body.
LEAP_SPACINGS = 1.25
#: The cost of a leap grows with this power of how far it exceeds that. Of the time of some 200
#: plans each on cube and torus, 300 targets, 2.8 % is out of contact without it, 0.7 % with the 8th
#: power, and 0.6 % with the 16th, on paths 4 % longer; with 1000 targets all do equally well.
LEAP_POWER = 16.0
# The spacing of targets is their distance to this many-th neighbour, as on a surface.
_SPACING_NEIGHBOUR = 6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RouteGraph:
    """The quotient graph and the firm configurations of its kernels, laid out for search.

    Attributes:
        firm_q: `(J, F)` float32 rad, firm configurations, grouped by kernel, one row a joint.
        firm_offsets: `(K + 1,)` kernel k owns columns `firm_offsets[k]:firm_offsets[k + 1]`.
        link_offsets: `(K + 1,)` links `link_offsets[k]:link_offsets[k + 1]` leave kernel k.
        link_kernel: `(2E,)` the kernel each link leads to.
        link_edge: `(2E,)` the row of each link in the representation's `edges`.
    """

    firm_q: np.ndarray
    firm_offsets: np.ndarray
    link_offsets: np.ndarray
    link_kernel: np.ndarray
    link_edge: np.ndarray

    @classmethod
    def of(cls, representation: QuotientRepresentation) -> RouteGraph:
        """Lays out `representation`; done once, for any number of routes."""
        num_kernels = representation.num_targets
        firm_rows = [firm_members(representation, k) for k in range(num_kernels)]
        firm_q = representation.kernel_q[np.concatenate(firm_rows)]
        edges = np.asarray(representation.edges, dtype=np.int64).reshape(-1, 2)
        tail, head = np.concatenate([edges, edges[:, ::-1]]).T
        order = np.lexsort((head, tail))
        return cls(
            firm_q=np.ascontiguousarray(firm_q.T, dtype=np.float32),
            firm_offsets=np.cumsum([0, *map(len, firm_rows)]),
            link_offsets=np.searchsorted(tail[order], np.arange(num_kernels + 1)),
            link_kernel=head[order],
            link_edge=order % max(len(edges), 1),
        )

    def firm_configurations(self, kernel: int) -> np.ndarray:
        """`(n, J)` rad, the firm configurations of a kernel."""
        return self.firm_q[:, self.firm_offsets[kernel] : self.firm_offsets[kernel + 1]].T


def firm_members(representation: QuotientRepresentation, kernel: int) -> np.ndarray:
    """Rows of `kernel_q`: the half of a kernel that is felt most strongly, which holds contact."""
    members = representation.members(kernel)
    strength = representation.kernel_strength[members]
    return members.start + np.flatnonzero(strength >= np.median(strength))


def goal_members(representation: QuotientRepresentation, kernel: int) -> np.ndarray:
    """Rows of `kernel_q`: the half of a kernel nearest its target sensation, without light touches.

    To end anywhere in a kernel would be to end near its border, from where a small error of the
    motion leads into another kernel. To ask for the firm half as well leaves so few
    configurations that the last step grows long.
    """
    members = representation.members(kernel)
    error, strength = representation.kernel_error[members], representation.kernel_strength[members]
    near, felt = error <= np.median(error), strength >= np.quantile(strength, 0.25)
    return members.start + np.flatnonzero(near & felt if np.any(near & felt) else near)


def leap_penalty(
    representation: QuotientRepresentation,
    *,
    spacings: float = LEAP_SPACINGS,
    power: float = LEAP_POWER,
) -> np.ndarray:
    """Factors on the cost of edges that join far-off sensations.

    Configurations of two kernels may be close although the places they touch are not: the finger
    then leaps through the inside of the body. The distance of the target sensations tells these
    edges from others (area under the curve 0.94 to 0.98; the motor step alone 0.60 to 0.63).

    Args:
        representation: what the agent has learnt.
        spacings: how many spacings of the target sensations are not yet a leap.
        power: how fast the factor grows beyond; 0 for no penalty.

    Returns:
        `(E,)` factors, 1 or more.
    """
    targets = np.asarray(representation.target_sensations, dtype=float)
    distance = np.sqrt(np.clip(2.0 - 2.0 * targets @ targets.T, 0.0, None))
    neighbour = min(_SPACING_NEIGHBOUR, len(targets) - 1)
    spacing = np.median(np.partition(distance, neighbour, axis=1)[:, neighbour])
    i, j = representation.edges.reshape(-1, 2).T
    return np.maximum(1.0, distance[i, j] / (spacings * spacing)) ** power


def carried_route(
    graph: RouteGraph,
    q_start: np.ndarray,
    start: int,
    goal: int,
    goal_q: np.ndarray,
    *,
    penalty: np.ndarray | None = None,
) -> np.ndarray | None:
    """Dijkstra that carries a motor configuration to every kernel it reaches.

    A kernel is entered by its firm configuration nearest to the one carried by its parent, and
    the step costs that distance cubed: what the arm would truly move, given where it is. Cubes
    prefer many short steps to one long one, which would leave the skin; higher powers hold contact
    no better, and only lengthen the path.

    Args:
        graph: the quotient graph.
        q_start: `(J,)` rad, a configuration of kernel `start`.
        start: the kernel to leave.
        goal: the kernel to reach.
        goal_q: `(n, J)` rad, the configurations by which the goal may be entered.
        penalty: `(E,)` positive factors on the cost of each edge.

    Returns:
        `(N,)` kernels from `start` to `goal`, or None if the graph does not connect them.
    """
    factor = np.ones(len(graph.link_edge)) if penalty is None else penalty[graph.link_edge]
    parent = _carry(
        graph.firm_q,
        graph.firm_offsets,
        graph.link_offsets,
        graph.link_kernel,
        factor.astype(np.float64),
        np.asarray(q_start, dtype=np.float32),
        start,
        goal,
        np.ascontiguousarray(goal_q.T, dtype=np.float32),
    )
    return _backtrack(parent, start, goal)


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
def _carry(firm_q, firm_offsets, link_offsets, link_kernel, factor, q_start, start, goal, goal_q):
    """`(K,)` parent of each kernel on its cheapest way from `start`; negative where none is."""
    num_joints, num_kernels = len(firm_q), len(firm_offsets) - 1
    cost = np.full(num_kernels, np.inf)
    parent = np.full(num_kernels, -1)
    carried = np.empty((num_kernels, num_joints), dtype=firm_q.dtype)
    settled = np.zeros(num_kernels, dtype=np.bool_)
    squared = np.empty(max(np.max(np.diff(firm_offsets)), goal_q.shape[1]), dtype=firm_q.dtype)
    cost[start], carried[start] = 0.0, q_start
    queue = [(0.0, start)]
    while len(queue) > 0:
        here = heapq.heappop(queue)[1]
        if here == goal:
            break
        if settled[here]:
            continue
        settled[here] = True
        for link in range(link_offsets[here], link_offsets[here + 1]):
            there = link_kernel[link]
            if settled[there]:
                continue
            if there == goal:
                candidates = goal_q
            else:
                candidates = firm_q[:, firm_offsets[there] : firm_offsets[there + 1]]
            count = candidates.shape[1]
            squared[:count] = 0.0
            for joint in range(num_joints):  # joint by joint, so that the inner loop vectorises
                at = carried[here, joint]
                for i in range(count):
                    step = candidates[joint, i] - at
                    squared[i] += step * step
            nearest = np.argmin(squared[:count])
            through = cost[here] + factor[link] * squared[nearest] ** 1.5
            if through < cost[there]:
                cost[there], parent[there] = through, here
                carried[there] = candidates[:, nearest]
                heapq.heappush(queue, (through, there))
    return parent
