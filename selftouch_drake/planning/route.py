"""Which motor kernel sets to pass through: routes over the quotient graph (paper, section III)."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.sparse.csgraph import dijkstra

from selftouch_drake.representation.quotient import QuotientRepresentation

# Cost of a step = distance to this power. Steps through the air are the long ones, and a high
# power goes a long way round to avoid them: measured contact rises up to the third power and is
# flat beyond it.
STEP_POWER = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class RouteGraph:
    """The quotient graph and the firm configurations of its kernels, laid out for search.

    Attributes:
        firm_q: `(J, F)` float32 rad, firm configurations, grouped by kernel, one row a joint.
        firm_row: `(F,)` the row of each in `kernel_q`.
        firm_offsets: `(K + 1,)` kernel k owns columns `firm_offsets[k]:firm_offsets[k + 1]`.
        link_offsets: `(K + 1,)` links `link_offsets[k]:link_offsets[k + 1]` leave kernel k.
        link_kernel: `(2E,)` the kernel each link leads to.
        link_edge: `(2E,)` the row of each link in `edges`.
    """

    firm_q: np.ndarray
    firm_row: np.ndarray
    firm_offsets: np.ndarray
    link_offsets: np.ndarray
    link_kernel: np.ndarray
    link_edge: np.ndarray

    @classmethod
    def of(cls, representation: QuotientRepresentation) -> RouteGraph:
        """Lays out `representation`; done once, for any number of routes."""
        num_kernels = representation.num_targets
        firm_rows = [firm_members(representation, k) for k in range(num_kernels)]
        firm_row = np.concatenate(firm_rows)
        edges = representation.edges.reshape(-1, 2)
        tail, head = np.concatenate([edges, edges[:, ::-1]]).T
        order = np.lexsort((head, tail))
        return cls(
            firm_q=np.ascontiguousarray(representation.kernel_q[firm_row].T, dtype=np.float32),
            firm_row=firm_row,
            firm_offsets=np.cumsum([0, *map(len, firm_rows)]),
            link_offsets=np.searchsorted(tail[order], np.arange(num_kernels + 1)),
            link_kernel=head[order].astype(np.int64),
            link_edge=order % max(len(edges), 1),
        )


def firm_members(representation: QuotientRepresentation, kernel: int) -> np.ndarray:
    """Rows of `kernel_q`: the half of a kernel that is felt most strongly, which holds contact."""
    members = representation.members(kernel)
    strength = representation.kernel_strength[members]
    if not len(strength):
        return np.empty(0, dtype=np.int64)
    return members.start + np.flatnonzero(strength >= np.median(strength))


def carried_route(
    graph: RouteGraph,
    q_start: np.ndarray,
    start: int,
    goal: int,
    *,
    edge_penalty: np.ndarray | None = None,
    power: float = STEP_POWER,
) -> np.ndarray | None:
    """Dijkstra that carries a motor configuration to every kernel it reaches.

    A kernel is entered by its firm configuration nearest to the one carried by its parent, and
    the step costs that distance to the `power`: what the arm would truly move, given where it is.

    Args:
        graph: the quotient graph.
        q_start: `(J,)` rad, a configuration of kernel `start`.
        start: the kernel to leave.
        goal: the kernel to reach.
        edge_penalty: `(E,)` factors on the cost of each edge, at least 1 to discourage.
        power: exponent of the step's length.

    Returns:
        `(N,)` kernels from `start` to `goal`, or None if the graph does not connect them.
    """
    num_edges = len(graph.link_edge) // 2
    penalty = np.ones(num_edges) if edge_penalty is None else np.asarray(edge_penalty, dtype=float)
    parent = _carry(
        graph.firm_q,
        graph.firm_offsets,
        graph.link_offsets,
        graph.link_kernel,
        penalty[graph.link_edge],
        np.asarray(q_start, dtype=np.float32),
        start,
        goal,
        float(power),
    )
    return _backtrack(parent, start, goal)


def shortest_route(distance: np.ndarray, start: int, goal: int) -> np.ndarray | None:
    """The shortest path over a matrix of distances between kernels; the paper's literal method.

    Args:
        distance: `(K, K)` any unit; dense for the complete graph, scipy sparse for a pruned one.
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


@njit(cache=True, fastmath=True)
def _carry(firm_q, firm_offsets, link_offsets, link_kernel, penalty, q_start, start, goal, power):
    """`(K,)` parent of each kernel on its cheapest way from `start`; -1 where none was found."""
    num_joints, num_kernels = len(firm_q), len(firm_offsets) - 1
    cost = np.full(num_kernels, np.inf)
    parent = np.full(num_kernels, -1)
    carried = np.empty((num_kernels, num_joints), dtype=firm_q.dtype)
    settled = np.zeros(num_kernels, dtype=np.bool_)
    squared = np.empty(np.max(np.diff(firm_offsets)), dtype=firm_q.dtype)
    cost[start], carried[start] = 0.0, q_start
    queue = [(0.0, start)]
    while queue:
        _, here = heapq.heappop(queue)
        if here == goal:
            break
        if settled[here]:
            continue
        settled[here] = True
        for link in range(link_offsets[here], link_offsets[here + 1]):
            there = link_kernel[link]
            first, count = firm_offsets[there], firm_offsets[there + 1] - firm_offsets[there]
            if settled[there] or count == 0:
                continue
            squared[:count] = 0.0
            for joint in range(num_joints):  # joint by joint, so that the inner loop vectorises
                at = carried[here, joint]
                for i in range(count):
                    step = firm_q[joint, first + i] - at
                    squared[i] += step * step
            nearest = np.argmin(squared[:count])
            through = cost[here] + penalty[link] * squared[nearest] ** (0.5 * power)
            if through < cost[there]:
                cost[there], parent[there] = through, here
                carried[there] = firm_q[:, first + nearest]
                heapq.heappush(queue, (through, there))
    return parent
