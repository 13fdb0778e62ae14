"""The planner: from the current motor configuration to a target sensation."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Literal, get_args

import numpy as np

from selftouch_drake.agent.motions import NO_KERNEL, Plan
from selftouch_drake.agent.planning.checks import (
    Limits,
    checked_configuration,
    checked_penalty,
    checked_target,
)
from selftouch_drake.agent.planning.configurations import (
    closest_configurations,
    smoothest_configurations,
)
from selftouch_drake.agent.planning.members import goal_members, of_mode
from selftouch_drake.agent.planning.route import (
    FindNearest,
    RouteGraph,
    carried_route,
    leap_penalty,
    shortest_route,
)
from selftouch_drake.agent.planning.smoothing import (
    KNOT_SPACING,
    path_length,
    smooth_path,
)
from selftouch_drake.agent.planning.way import Way
from selftouch_drake.agent.representation.graphs import step_links
from selftouch_drake.agent.representation.quotient import NO_MODE, QuotientRepresentation
from selftouch_drake.agent.representation.set_distances import linked_nearest
from selftouch_drake.agent.sliding import Slides

RouteMethod = Literal["carried", "literal"]


class Planner:
    """Plans over one quotient representation; build it once and use it for many plans.

    Args:
        representation: what the agent has learned.
        route: `carried` for Dijkstra on the quotient graph that carries a firm configuration
            along, then the smoothest configurations; `literal` for the paper's shortest path on
            the complete graph of `set_distance`, then the closest configurations.
        knot_spacing: rad of path length between knots of the smooth path; larger is smoother.
        find_nearest: finds the nearest configurations in linked kernels.

    Raises:
        ValueError: `route` is not one of these, or `knot_spacing` is not positive.
    """

    def __init__(
        self,
        representation: QuotientRepresentation,
        *,
        route: RouteMethod = "carried",
        knot_spacing: float = KNOT_SPACING,
        find_nearest: FindNearest = linked_nearest,
    ) -> None:
        if route not in get_args(RouteMethod):
            raise ValueError(
                f"route is {route!r}: choose one of {', '.join(get_args(RouteMethod))}"
            )
        if not knot_spacing > 0.0:
            raise ValueError(f"knot_spacing is {knot_spacing} rad: give a positive number")
        self.representation = representation
        self.route = route
        self.knot_spacing = knot_spacing
        self.links = step_links(representation)
        self._graphs = [
            RouteGraph.of(representation, self.links, mode, find_nearest)
            for mode in range(len(representation.mode_joints))
        ]
        # Float32, as stored configurations are.
        self._rows_x = representation.scaled(representation.kernel_q).astype(np.float32)
        self._leap_penalty = leap_penalty(representation, self.links)
        self._range = representation.kernel_q.min(axis=0), representation.kernel_q.max(axis=0)
        self._link_row = {(int(i), int(j)): row for row, (i, j) in enumerate(self.links)}

    def plan(self, q_start: np.ndarray, start: int | None, goal: int, **how: Any) -> Plan:
        """Plans from a motor configuration to one target sensation; see `plan_tour`."""
        return self.plan_tour(q_start, [start, goal], **how)

    def plan_tour(
        self,
        q_start: np.ndarray,
        targets: Sequence[int | None],
        *,
        link_penalty: np.ndarray | None = None,
        slides: Slides | None = None,
        aside: np.ndarray | None = None,
        lift_off: bool = False,
        limits: Limits | None = None,
    ) -> Plan:
        """Plans one continuous motion through a list of target sensations.

        Joints that do not matter to a touch stay where they are. If no links lead to a goal (it is
        on another part of the body, or nothing is felt at the start), the agent moves through the
        air: straight to the nearest known firm touch that links join to the goal, and along the
        links from there. If that touch is on the same part but uses other joints, these joints
        land first while the current ones hold still; then the current ones leave.

        Args:
            q_start: `(J,)` positions of the joints at the start, in the robot's units.
            targets: the target sensation felt at the start, None if nothing is felt; then one or
                more to feel, in order. If a goal is felt already, the plan is to stay.
            link_penalty: `(L,)` factors on the cost of the links, above 1 where contact was lost
                before; a literal route has no links and ignores it.
            slides: known slides between touches; all other steps are straight.
            aside: `(J,)` scaled; at the start, the joints that do not matter move there, out of the
                way.
            lift_off: move to each goal through the air, even if links lead there.
            limits: the path starts and stays within them. By default the path stays within the
                range of experience, unless the start or a slide lies outside.

        Raises:
            ValueError: a target is out of range, no goal is given, or `q_start` or `link_penalty`
                does not fit the representation.
        """
        q_start = checked_configuration(q_start, self.representation, limits)
        if len(targets) < 2:
            raise ValueError(
                f"targets is {list(targets)}: give the target sensation felt now (or None), then "
                "at least one goal"
            )
        here = None if targets[0] is None else checked_target(targets[0], self.representation)
        goals = [checked_target(goal, self.representation) for goal in targets[1:]]
        penalty = self._leap_penalty * checked_penalty(link_penalty, len(self.links))
        x = self.representation.scaled(q_start)
        mode = NO_MODE if here is None else self._mode_at(x, here)
        choose = closest_configurations if self._is_literal else smoothest_configurations
        way = Way(NO_KERNEL if here is None else here, x, self._joints(mode), choose)
        if aside is not None and mode != NO_MODE:
            joints = self._joints(mode)
            out_of_the_way = aside.copy()
            out_of_the_way[joints] = x[joints]
            way.move(way.nodes[0], out_of_the_way, joints, in_air=False)
        for goal in goals:
            # Where the previous leg ends decides the route of this one.
            if lift_off and here != goal:
                here, mode = self._fly(way, goal)
            elif here is None or self._lifts_off(here, goal, mode):
                here, mode = self._land(way, goal, mode)
            way.follow(*self._leg(way.end, here, goal, mode, penalty))
            here = goal
        return self._through(q_start, way, slides, limits)

    @property
    def _is_literal(self) -> bool:
        return self.route == "literal"

    def _joints(self, mode: int) -> np.ndarray:
        """The joints that move in a mode; the literal route knows no modes."""
        if mode == NO_MODE or self._is_literal:
            return np.arange(len(self.representation.joint_scale))
        return self._graphs[mode].joints

    def _mode_at(self, x: np.ndarray, kernel: int) -> int:
        """The mode of the configuration of `kernel` most similar to the scaled `x`, or `NO_MODE`.

        Only the joints that matter in a mode are compared.
        """
        members = self.representation.members(kernel)
        modes = self.representation.kernel_mode[members]
        known = np.unique(modes[modes != NO_MODE])
        if len(known) < 2:
            return int(known[0]) if len(known) else NO_MODE
        off = np.square(self.representation.scaled(self.representation.kernel_q[members]) - x)
        nearest = [off[modes == m][:, self._graphs[m].joints].mean(axis=1).min() for m in known]
        return int(known[np.argmin(nearest)])

    def _fly(self, way: Way, goal: int) -> tuple[int, int]:
        """Moves through the air to the nearest touch of `goal`; returns its kernel and mode."""
        row = self._nearest(way.end, goal_members(self.representation, goal))
        mode = int(self.representation.kernel_mode[row])
        way.move(goal, self._rows_x[row].astype(float), self._joints(mode), in_air=True)
        return goal, mode

    def _land(self, way: Way, goal: int, mode: int) -> tuple[int, int]:
        """Moves to another touch, from which links lead to `goal`; returns its kernel and mode.

        If other joints make that touch, the current ones hold still until it is made.
        """
        kernel, after, to = self._landing(way.end, goal)
        joints = self._joints(after)
        holds = mode != NO_MODE and not np.isin(joints, self._joints(mode)).any()
        if holds and self.representation.part[way.nodes[-1]] == self.representation.part[kernel]:
            both = way.end.copy()
            both[joints] = to[joints]
            way.move(kernel, both, joints, in_air=False)
            left = both.copy()
            left[self._joints(mode)] = to[self._joints(mode)]
            way.move(kernel, left, joints, in_air=False)
        else:
            way.move(kernel, to, joints, in_air=True)
        return kernel, after

    def _through(
        self, q_start: np.ndarray, way: Way, slides: Slides | None, limits: Limits | None
    ) -> Plan:
        """The smooth plan through the waypoints of a way."""
        representation = self.representation
        links = [
            self._link_row.get((min(a, b), max(a, b)), -1) if along_link else -1
            for (a, b), along_link in zip(pairwise(way.nodes), way.along_link, strict=True)
        ]
        lower, upper = (representation.scaled(limit) for limit in limits or self._range)
        if limits is not None and slides is not None:
            slides = slides.within(lower, upper)
        nodes, of_step, waypoints_x = way.passed(slides)
        if limits is None:
            lower = np.minimum(lower, waypoints_x.min(axis=0))
            upper = np.maximum(upper, waypoints_x.max(axis=0))
        path = smooth_path(waypoints_x, knot_spacing=self.knot_spacing, lower=lower, upper=upper)
        path.c = representation.unscaled(path.c)
        waypoints_q = representation.unscaled(waypoints_x)
        waypoints_q[0] = path.c[0] = q_start
        return Plan(
            nodes=np.array(nodes),
            links=np.array(links, dtype=np.int64)[of_step],
            in_air=np.array(way.in_air, dtype=bool)[of_step],
            waypoints_q=waypoints_q,
            waypoint_s=path_length(waypoints_x),
            path=path,
        )

    def _lifts_off(self, here: int, goal: int, mode: int) -> bool:
        """Whether no links of the current mode lead to `goal`, so that the agent must lift off.

        The literal route knows neither parts nor modes.
        """
        if self._is_literal:
            return False
        return here != goal and (mode == NO_MODE or not self._graphs[mode].joins(here, goal))

    def _leg(
        self, x: np.ndarray, start: int, goal: int, mode: int, penalty: np.ndarray
    ) -> tuple[list[int], list[np.ndarray]]:
        """The kernels after `start` on the way to `goal`, and the scaled candidates in each."""
        representation = self.representation
        if start == goal:
            return [], []
        if self._is_literal:
            nodes = shortest_route(representation.set_distance, start, goal)
            if nodes is None:
                raise ValueError(
                    f"target {goal} cannot be reached from target {start}: `set_distance` joins "
                    "them by no path; learn again"
                )
            after = nodes[1:].tolist()
            layers = [self._rows_x[of_mode(representation, k, None)] for k in after[:-1]]
            return after, [*layers, self._rows_x[goal_members(representation, goal)]]
        graph = self._graphs[mode]
        goal_x = self._rows_x[goal_members(representation, goal, mode)][:, graph.joints]
        nodes = carried_route(graph, x[graph.joints], start, goal, goal_x, penalty=penalty)
        assert nodes is not None, "links join the two"
        after = nodes[1:].tolist()
        firm = [graph.firm_configurations(k) for k in after[:-1]]
        return after, [*firm, goal_x]

    def _landing(self, x: np.ndarray, goal: int) -> tuple[int, int, np.ndarray]:
        """The firm touch nearest to the scaled `x` from which links of its mode lead to `goal`.

        Returns its kernel, its mode and its scaled configuration. If the modes of the goal's
        touches are unknown, it is the nearest of these touches.
        """
        found = []
        for mode, graph in enumerate(self._graphs):
            if (component := graph.component[goal]) < 0:
                continue
            leads = np.repeat(graph.component == component, np.diff(graph.firm_offsets))
            row = self._nearest(x, graph.firm_row[leads])
            found.append((row, mode))
        if not found:
            found.append((self._nearest(x, of_mode(self.representation, goal, None)), NO_MODE))
        far = [np.square(self._rows_x[row] - x).sum() for row, _ in found]
        row, mode = found[int(np.argmin(far))]
        kernel = int(np.searchsorted(self.representation.kernel_offsets, row, side="right")) - 1
        return kernel, mode, self._rows_x[row].astype(float)

    def _nearest(self, x: np.ndarray, rows: np.ndarray) -> int:
        """The row of `rows` whose scaled configuration is nearest to `x`."""
        return int(rows[np.square(self._rows_x[rows] - x).sum(axis=1).argmin()])
