"""A plan: from the motor configuration the agent is in to the sensation it wants."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, get_args

import numpy as np
from scipy.interpolate import BSpline

from selftouch_drake.agent.planning.configurations import (
    closest_configurations,
    smoothest_configurations,
)
from selftouch_drake.agent.planning.route import (
    RouteGraph,
    carried_route,
    goal_members,
    leap_penalty,
    near_links,
    shortest_route,
)
from selftouch_drake.agent.planning.smoothing import (
    KNOT_SPACING,
    path_length,
    polyline,
    smooth_path,
)
from selftouch_drake.agent.representation.quotient import QuotientRepresentation

RouteMethod = Literal["carried", "literal"]

#: Stands in a plan's nodes for a configuration in which nothing is felt.
NO_KERNEL = -1

# Jerk is compared on samples this far apart, in rad of path length. The jerk of a polyline has no
# limit as samples get denser, so that the figure means something only for a stated spacing.
_JERK_SPACING = 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """A geometric path in motor space through one configuration of each kernel on a route.

    Attributes:
        nodes: `(W,)` kernels, from the start to the goal; the first is `NO_KERNEL` if the arm
            does not touch yet.
        links: `(W - 1,)` row in the planner's `links` of each step; -1 where it follows none, as on
            a literal route and towards the first touch.
        waypoints_q: `(W, J)` rad, one motor configuration a kernel.
        waypoint_s: `(W,)` rad, where on `path` each waypoint is: length of the polyline up to it.
        path: smooth quintic B-spline over `[0, waypoint_s[-1]]`, from the first waypoint to the
            last; constant over `[0, 1]` if the start is the goal.
    """

    nodes: np.ndarray
    links: np.ndarray
    waypoints_q: np.ndarray
    waypoint_s: np.ndarray
    path: BSpline


class Planner:
    """Plans over one quotient representation; built once, asked often.

    Args:
        representation: what the agent has learnt.
        route: `carried` for Dijkstra on the quotient graph that carries a firm configuration
            along, then the smoothest configurations; `literal` for the paper's shortest path on
            the complete graph of `set_distance`, then the closest configurations.
        knot_spacing: rad of path length between knots of the smooth path; larger is smoother.
        lower: `(J,)` rad, no path goes below it, nor may it start there; by default no path goes
            below the lowest configuration in experience, unless it starts there.
        upper: `(J,)` rad, the same above.

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
    ) -> None:
        if route not in get_args(RouteMethod):
            raise ValueError(
                f"route is {route!r}: choose one of {', '.join(get_args(RouteMethod))}"
            )
        if not knot_spacing > 0.0:
            raise ValueError(f"knot_spacing is {knot_spacing} rad: choose a positive spacing")
        kernel_q = representation.kernel_q
        self.representation = representation
        self.route = route
        self.knot_spacing = knot_spacing
        self.lower = kernel_q.min(axis=0) if lower is None else np.asarray(lower, dtype=float)
        self.upper = kernel_q.max(axis=0) if upper is None else np.asarray(upper, dtype=float)
        self._limits = (
            np.full(kernel_q.shape[1], -np.inf) if lower is None else self.lower,
            np.full(kernel_q.shape[1], np.inf) if upper is None else self.upper,
        )
        self.links = near_links(representation)
        self._graph = RouteGraph.of(representation, self.links)
        self._leap_penalty = leap_penalty(representation, self.links)
        self._link_row = {(int(i), int(j)): row for row, (i, j) in enumerate(self.links)}

    def plan(
        self,
        q_start: np.ndarray,
        start: int | None,
        goal: int,
        *,
        link_penalty: np.ndarray | None = None,
    ) -> Plan:
        """Plans from a motor configuration to a target sensation.

        Args:
            q_start: `(J,)` rad, where the arm is.
            start: the target sensation felt there; None if nothing is, see `plan_tour`.
            goal: the target sensation to feel; if it is `start`, the plan is to stay.
            link_penalty: `(L,)` factors on the cost of the links, above 1 where contact was lost
                before; a literal route has no links and ignores it.

        Raises:
            ValueError: if a target is out of range, `q_start` or `link_penalty` does not fit the
                representation, or no links join the two targets.
        """
        return self.plan_tour(q_start, [start, goal], link_penalty=link_penalty)

    def plan_tour(
        self,
        q_start: np.ndarray,
        targets: Sequence[int | None],
        *,
        link_penalty: np.ndarray | None = None,
    ) -> Plan:
        """Plans one continuous motion through a list of target sensations.

        Args:
            q_start: `(J,)` rad, where the arm is.
            targets: the target sensation felt there, then those to feel, in order. The first may
                be None if nothing is felt; the arm then goes straight to the nearest firm touch it
                knows, and the plan's first node is `NO_KERNEL`.
            link_penalty: `(L,)` as in `plan`.

        Raises:
            ValueError: as in `plan`, or there is no target to feel.
        """
        q_start = self.checked_configuration(q_start)
        if len(targets) < 2:
            raise ValueError(
                f"targets is {list(targets)}: give the sensation felt now, or None, and one to feel"
            )
        start, goals = targets[0], [self._checked_target(goal) for goal in targets[1:]]
        penalty = self._leap_penalty * self._checked_penalty(link_penalty)
        if start is None:
            here, q_touch = self._nearest_touch(q_start)
            nodes, layers = [NO_KERNEL, here], [q_start[None], q_touch[None]]
        else:
            here = self._checked_target(start)
            nodes, layers = [here], [q_start[None]]

        for goal in goals:
            # The configuration that the legs before would end in decides where this one goes.
            q = smoothest_configurations(layers)[-1]
            after, candidates = self._leg(q, here, goal, penalty)
            nodes += after
            layers += candidates
            here = goal
        chosen = closest_configurations if self.route == "literal" else smoothest_configurations
        waypoints_q = chosen(layers)
        return Plan(
            nodes=np.array(nodes),
            links=np.array(
                [self._link_row.get((min(a, b), max(a, b)), -1) for a, b in pairwise(nodes)],
                dtype=np.int64,
            ),
            waypoints_q=waypoints_q,
            waypoint_s=path_length(waypoints_q),
            path=smooth_path(
                waypoints_q, knot_spacing=self.knot_spacing, lower=self.lower, upper=self.upper
            ),
        )

    def _leg(
        self, q: np.ndarray, start: int, goal: int, penalty: np.ndarray
    ) -> tuple[list[int], list[np.ndarray]]:
        """The kernels after `start` on the way to `goal`, and the candidates in each."""
        representation = self.representation
        goal_q = representation.kernel_q[goal_members(representation, goal)]
        if self.route == "literal":
            nodes = shortest_route(representation.set_distance, start, goal)
        else:
            nodes = carried_route(self._graph, q, start, goal, goal_q, penalty=penalty)
        if nodes is None:
            raise ValueError(
                f"target {goal} cannot be reached from target {start}: the quotient graph does not "
                "connect them; babble longer, or learn with a larger num_neighbours"
            )
        after = nodes[1:].tolist()
        if self.route == "literal":
            return after, [representation.kernel_q[representation.members(k)] for k in after]
        firm = [self._graph.firm_configurations(k) for k in after[:-1]]
        return after, firm + [goal_q] * bool(after)

    def _nearest_touch(self, q: np.ndarray) -> tuple[int, np.ndarray]:
        """The kernel of the firm configuration nearest to `q`, and that configuration."""
        column = int(np.square(self._graph.firm_q - q[:, None]).sum(axis=0).argmin())
        kernel = int(np.searchsorted(self._graph.firm_offsets, column, side="right")) - 1
        return kernel, self._graph.firm_q[:, column].astype(float)

    def _checked_target(self, target: int | None) -> int:
        num_targets = self.representation.num_targets
        try:
            index = operator.index(target)  # type: ignore[arg-type]
        except TypeError:
            raise ValueError(f"target {target!r} is not an index: give a whole number") from None
        if not 0 <= index < num_targets:
            raise ValueError(
                f"target {target} is out of range: "
                f"this representation has targets 0 to {num_targets - 1}"
            )
        return index

    def checked_configuration(self, q_start: np.ndarray) -> np.ndarray:
        """The same as floats, if a plan may start there.

        Raises:
            ValueError: it has not one finite angle a joint, or is outside the limits given.
        """
        q_start = np.asarray(q_start, dtype=float)
        num_joints = self.representation.kernel_q.shape[1]
        if q_start.shape != (num_joints,):
            raise ValueError(
                f"q_start has shape {q_start.shape}: "
                f"this representation needs ({num_joints},), one angle a joint"
            )
        if not np.all(np.isfinite(q_start)):
            raise ValueError(f"q_start is {q_start.tolist()}: give finite joint angles in rad")
        lower, upper = self._limits
        # Stored configurations are float32.
        outside = np.flatnonzero((q_start < lower - 1e-6) | (q_start > upper + 1e-6))
        if outside.size:
            joint = outside[0]
            raise ValueError(
                f"q_start[{joint}] is {q_start[joint]:g} rad: "
                f"give one within the joint's limits, {lower[joint]:g} to {upper[joint]:g} rad"
            )
        return q_start

    def _checked_penalty(self, link_penalty: np.ndarray | None) -> np.ndarray:
        num_links = len(self.links)
        if link_penalty is None:
            return np.ones(num_links)
        link_penalty = np.asarray(link_penalty, dtype=float)
        if link_penalty.shape != (num_links,):
            raise ValueError(
                f"link_penalty has shape {link_penalty.shape}: "
                f"this representation needs ({num_links},), one factor a link"
            )
        if not np.all(np.isfinite(link_penalty) & (link_penalty > 0.0)):
            raise ValueError(
                "link_penalty holds a factor that is not finite and positive: use 1 "
                "for links without penalty"
            )
        return link_penalty


def jerk_reduction(plan: Plan) -> float:
    """How many times smaller the jerk of the smooth path is than that of its polyline.

    Both are sampled every 0.02 rad of path length; jerk is the root mean square of third
    differences. 1 if the polyline has no corner.
    """
    if len(np.unique(plan.waypoint_s)) < 3:
        return 1.0
    length = plan.waypoint_s[-1]
    s = np.linspace(0.0, length, max(5, int(length / _JERK_SPACING)))
    rough, smooth = (
        np.sqrt(np.mean(np.square(np.diff(path(s), 3, axis=0))))
        for path in (polyline(plan.waypoints_q), plan.path)
    )
    return float(rough / smooth)
