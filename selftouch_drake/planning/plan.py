"""A plan: from the motor configuration the agent is in to the sensation it wants."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.interpolate import BSpline

from selftouch_drake.planning.configurations import closest_configurations, smoothest_configurations
from selftouch_drake.planning.prediction import SensationPredictor
from selftouch_drake.planning.route import RouteGraph, carried_route, firm_members, shortest_route
from selftouch_drake.planning.smoothing import KNOT_SPACING, path_length, polyline, smooth_path
from selftouch_drake.representation.quotient import QuotientRepresentation

RouteMethod = Literal["carried", "literal"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A geometric path in motor space through one configuration of each kernel on a route.

    Attributes:
        nodes: `(W,)` kernels, from the start to the goal.
        edges: `(W - 1,)` row in the representation's `edges` of each step; -1 where the complete
            graph was used and the step follows no edge.
        waypoints_q: `(W, J)` rad, one motor configuration a kernel.
        waypoint_s: `(W,)` rad, length of the polyline up to each waypoint: where on `path` it is.
        path: smooth quintic B-spline over `[0, waypoint_s[-1]]`, from the first waypoint to the
            last; constant over `[0, 1]` if the start is the goal.
    """

    nodes: np.ndarray
    edges: np.ndarray
    waypoints_q: np.ndarray
    waypoint_s: np.ndarray
    path: BSpline

    @property
    def start(self) -> int:
        return int(self.nodes[0])

    @property
    def goal(self) -> int:
        return int(self.nodes[-1])


class Planner:
    """Plans over one quotient representation; built once, asked often.

    Args:
        representation: what the agent has learnt.
        route: `carried` for Dijkstra that carries a configuration along the pruned graph, one
            configuration a kernel by dynamic programming; `literal` for the paper's shortest path
            on the complete graph of set distances, through closest configurations.
        knot_spacing: rad of path length between knots of the smooth path; larger is smoother.
        lower: `(J,)` rad, no path goes below it; default: the lowest command in experience.
        upper: `(J,)` rad, no path goes above it; default: the highest command in experience.

    Raises:
        ValueError: if `route` is no such method or `knot_spacing` is not positive.
    """

    def __init__(
        self,
        representation: QuotientRepresentation,
        *,
        route: RouteMethod = "carried",
        knot_spacing: float = KNOT_SPACING,
        lower: np.ndarray | None = None,
        upper: np.ndarray | None = None,
    ):
        if route not in get_args(RouteMethod):
            raise ValueError(f"route is {route!r}: choose one of {', '.join(get_args(RouteMethod))}")
        if not knot_spacing > 0.0:
            raise ValueError(f"knot_spacing is {knot_spacing} rad: choose a positive spacing")
        self.representation = representation
        self.route = route
        self.knot_spacing = knot_spacing
        self.lower = representation.kernel_q.min(axis=0) if lower is None else np.asarray(lower)
        self.upper = representation.kernel_q.max(axis=0) if upper is None else np.asarray(upper)
        self._graph = RouteGraph.of(representation)
        self._predictor = SensationPredictor(representation)
        self._edge_row = {(int(i), int(j)): e for e, (i, j) in enumerate(representation.edges)}

    def plan(
        self,
        q_start: np.ndarray,
        start: int,
        goal: int,
        *,
        edge_penalty: np.ndarray | None = None,
    ) -> Plan:
        """Plans from a motor configuration to a target sensation.

        Args:
            q_start: `(J,)` rad, where the arm is.
            start: the target sensation felt there.
            goal: the target sensation to feel; if it is `start`, the plan is to stay.
            edge_penalty: `(E,)` factors on the cost of the representation's edges, above 1 where
                contact was lost before; the literal route has no edges and ignores it.

        Raises:
            ValueError: if a target is out of range, `q_start` or `edge_penalty` has another shape
                than the representation, or the graph does not connect the two targets.
        """
        q_start = self._checked_configuration(q_start)
        start, goal = self._checked_target(start), self._checked_target(goal)
        nodes = self._find_route(q_start, start, goal, edge_penalty)
        if nodes is None:
            raise ValueError(
                f"target {goal} cannot be reached from target {start}: the quotient graph does not "
                "connect them; collect more samples, or keep more neighbours for each kernel"
            )
        waypoints_q = self._choose_configurations(q_start, nodes)
        return Plan(
            nodes=nodes,
            edges=np.array(
                [self._edge_row.get((min(p), max(p)), -1) for p in _pairs(nodes)], dtype=np.int64
            ),
            waypoints_q=waypoints_q,
            waypoint_s=path_length(waypoints_q),
            path=smooth_path(
                waypoints_q, knot_spacing=self.knot_spacing, lower=self.lower, upper=self.upper
            ),
        )
