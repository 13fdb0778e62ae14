"""The planner: from the current motor configuration to a target sensation."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from selftouch_drake.agent.memory import RehearsalMemory, Slides
from selftouch_drake.agent.motions import NO_KERNEL, Plan
from selftouch_drake.agent.planning.legs import Waypoints
from selftouch_drake.agent.planning.members import firm_members, goal_members
from selftouch_drake.agent.planning.touch_model import TouchModel
from selftouch_drake.agent.representation.quotient import NO_MODE, QuotientRepresentation
from selftouch_drake.quotient.kernels import KernelSets
from selftouch_drake.quotient.links import leap_penalty, link_lengths
from selftouch_drake.quotient.paths import component_labels
from selftouch_drake.quotient.plan import Limits, path_through
from selftouch_drake.quotient.route import Query, RouteGraph, carried_route
from selftouch_drake.quotient.smooth import KNOT_SPACING

# A route that keeps the motion of the joints short pays this power of each squared step, in mu. Its
# path on the body is 1.45 to 1.63 times the shortest, against 1.22 to 1.29, for the same contact.
_JOINTS_POWER = 1.5

#: What a route keeps short: its path on the `body`, or the motion of the `joints`.
Preference = Literal["body", "joints"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModeGraph:
    """What routes of one mode are searched in.

    Attributes:
        joints: indices of the joints that matter in the mode; only these count.
        graph: linked kernels, and their firm configurations in these joints.
        firm_row: `(F,)` the rows in which these configurations are stored.
        component: `(K,)` links join kernels of one component; -1 without firm configurations.
    """

    joints: np.ndarray
    graph: RouteGraph
    firm_row: np.ndarray
    component: np.ndarray

    @classmethod
    def of(
        cls, representation: QuotientRepresentation, links: np.ndarray, mode: int = 0
    ) -> "ModeGraph":
        """Arranges one mode of `representation` and the `(L, 2)` links for search."""
        joints = np.flatnonzero(representation.mode_joints[mode])
        kernels = range(representation.num_targets)
        by_kernel = [firm_members(representation, kernel, mode) for kernel in kernels]
        firm_row = np.concatenate(by_kernel)
        x = representation.scaled(representation.kernel_q[firm_row])[:, joints]
        offsets = np.cumsum([0, *map(len, by_kernel)])
        firm = KernelSets(x.astype(np.float32), offsets)
        is_firm = firm.sizes > 0
        component = component_labels(links[is_firm[links].all(axis=1)], len(firm))
        return cls(
            joints=joints,
            graph=RouteGraph.of(firm, links),
            firm_row=firm_row,
            component=np.where(is_firm, component, -1),
        )


class Planner:
    """Plans over one quotient representation; build it once and use it for many plans.

    Args:
        representation: what the agent has learned.
        knot_spacing: mu of path length between knots of the smooth path; larger is smoother.
        touch_model: bends steps along links into the skin; without, they are straight.
        prefer: what routes keep short.

    Raises:
        ValueError: `knot_spacing` is not positive.
    """

    def __init__(
        self,
        representation: QuotientRepresentation,
        *,
        knot_spacing: float = KNOT_SPACING,
        touch_model: TouchModel | None = None,
        prefer: Preference = "body",
    ) -> None:
        if not knot_spacing > 0.0:
            raise ValueError(f"knot_spacing is {knot_spacing} mu: give a positive number")
        self.representation = representation
        self.knot_spacing = knot_spacing
        self.touch_model = touch_model
        self.links = representation.step_links()
        self._modes = [
            ModeGraph.of(representation, self.links, mode)
            for mode in range(len(representation.mode_joints))
        ]
        # Float32, as stored configurations are.
        self._rows_x = representation.scaled(representation.kernel_q).astype(np.float32)
        length = link_lengths(representation.target_sensations, self.links)
        self._leap_penalty = leap_penalty(length)
        self._prefer, self._length = prefer, length
        self._range = representation.kernel_q.min(axis=0), representation.kernel_q.max(axis=0)
        self._link_row = {(i, j): row for row, (i, j) in enumerate(self.links.tolist())}

    def plan(
        self,
        q_start: np.ndarray,
        targets: Sequence[int | None],
        *,
        memory: RehearsalMemory | None = None,
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
            memory: links that cost more, slides between touches, where all other steps are
                straight, and rows of `kernel_q` at which to end and to land no more, if there are
                others; by default nothing was rehearsed.
            lift_off: move to each goal through the air, even if links lead there.
            limits: the path starts and stays within them. By default the path stays within the
                range of experience, unless the start or a slide lies outside.

        Raises:
            ValueError: a target is out of range, no goal is given, or `q_start` does not fit the
                representation or the limits.
        """
        q_start, here, goals = self.checked(q_start, targets, limits)
        memory = memory or RehearsalMemory.blank(self.representation)
        x = self.representation.scaled(q_start)
        mode = NO_MODE if here is None else self._mode_at(x, here)
        way = Waypoints(NO_KERNEL if here is None else here, x, self._joints(mode))
        for goal in goals:
            # Where the previous leg ends decides the route of this one.
            if here == goal:
                continue
            if lift_off:
                here, mode = self._lift_off(way, goal, memory)
            elif here is None or not self._joins(here, goal, mode):
                here, mode = self._land(way, goal, mode, memory)
            if here != goal:
                self._follow_links(way, here, goal, mode, memory)
            here = goal
        return self._through(q_start, way, memory.slides, limits)

    def checked(
        self, q_start: np.ndarray, targets: Sequence[int | None], limits: Limits | None = None
    ) -> tuple[np.ndarray, int | None, list[int]]:
        """Start, first target and goals of a plan, if they fit the representation.

        Raises:
            ValueError: as `plan`.
        """
        q_start = checked_configuration(q_start, self.representation, limits)
        if len(targets) < 2:
            raise ValueError(
                f"targets is {list(targets)}: give the target sensation felt now (or None), then "
                "at least one goal"
            )
        here = None if targets[0] is None else self.representation.checked_target(targets[0])
        return q_start, here, [self.representation.checked_target(goal) for goal in targets[1:]]

    def _joints(self, mode: int) -> np.ndarray:
        """The joints that move in a mode."""
        if mode == NO_MODE:
            return np.arange(len(self.representation.joint_scale))
        return self._modes[mode].joints

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
        nearest = [off[modes == m][:, self._modes[m].joints].mean(axis=1).min() for m in known]
        return int(known[np.argmin(nearest)])

    def _joins(self, here: int, goal: int, mode: int) -> bool:
        """Whether links of a mode, if it is known, lead from one kernel to the goal."""
        if mode == NO_MODE:
            return False
        component = self._modes[mode].component
        return bool(component[here] == component[goal] >= 0)

    def _lift_off(self, way: Waypoints, goal: int, memory: RehearsalMemory) -> tuple[int, int]:
        """Moves through the air to the nearest touch of the goal; returns the goal and its mode."""
        at = self._nearest(way.end, goal_members(self.representation, goal), memory)
        mode = int(self.representation.kernel_mode[at])
        way.move(goal, self._rows_x[at].astype(float), self._joints(mode), in_air=True)
        return goal, mode

    def _land(
        self, way: Waypoints, goal: int, mode: int, memory: RehearsalMemory
    ) -> tuple[int, int]:
        """Moves to the nearest firm touch from which links of its mode lead to `goal`.

        If the modes of the goal's touches are unknown, it is the nearest of these touches. If other
        joints make the touch, the current ones hold still until it is made. Returns its kernel and
        its mode.
        """
        x, found = way.end, []
        for after, known in enumerate(self._modes):
            if (component := known.component[goal]) >= 0:
                leads = np.repeat(known.component == component, known.graph.firm.sizes)
                found.append((self._nearest(x, known.firm_row[leads], memory), after))
        if not found:
            members = np.r_[self.representation.members(goal)]
            found.append((self._nearest(x, members, memory), NO_MODE))
        row, after = min(found, key=lambda one: np.square(self._rows_x[one[0]] - x).sum())
        kernel = int(np.searchsorted(self.representation.kernel_offsets, row, side="right")) - 1
        to, joints = self._rows_x[row].astype(float), self._joints(after)
        holds = mode != NO_MODE and not np.isin(joints, self._joints(mode)).any()
        if holds and self.representation.part[way.nodes[-1]] == self.representation.part[kernel]:
            both = x.copy()
            both[joints] = to[joints]
            way.move(kernel, both, joints, in_air=False)
            left = both.copy()
            left[self._joints(mode)] = to[self._joints(mode)]
            way.move(kernel, left, joints, in_air=False)
        else:
            way.move(kernel, to, joints, in_air=True)
        return kernel, after

    def _nearest(self, x: np.ndarray, rows: np.ndarray, memory: RehearsalMemory) -> int:
        """The row of `rows` whose scaled configuration is nearest to `x`, not missed before."""
        rows = memory.not_missed(rows)
        return int(rows[np.square(self._rows_x[rows] - x).sum(axis=1).argmin()])

    def _follow_links(
        self, way: Waypoints, start: int, goal: int, mode: int, memory: RehearsalMemory
    ) -> None:
        """Goes along links to the goal, through any of the firm touches of the kernels between."""
        joints, graph = self._modes[mode].joints, self._modes[mode].graph
        ends = memory.not_missed(goal_members(self.representation, goal, mode))
        goal_x = self._rows_x[ends][:, joints]
        penalty = self._leap_penalty * memory.link_penalty
        query = Query(start, way.end[joints], goal, goal_x)
        if self._prefer == "body":
            price, length = graph.step_price(penalty), self._length * memory.link_penalty
            nodes = carried_route(graph, query, price, length).tolist()
        else:
            nothing = np.zeros(len(penalty))
            nodes = carried_route(graph, query, penalty, nothing, _JOINTS_POWER).tolist()
        links = [self._link_row[min(step), max(step)] for step in pairwise(nodes)]
        layers = [*(graph.firm.configurations(k) for k in nodes[1:-1]), goal_x]
        way.follow(nodes[1:], links, layers, mode)

    def _through(
        self, q_start: np.ndarray, way: Waypoints, slides: Slides, limits: Limits | None
    ) -> Plan:
        """The smooth plan through the waypoints."""
        representation = self.representation
        lower, upper = (representation.scaled(limit) for limit in limits or self._range)
        if limits is not None:
            slides = slides.within(lower, upper)
        passed = way.passed(slides, self.touch_model, (lower, upper))
        found = path_through(
            passed.nodes,
            passed.waypoints_x,
            q_start,
            representation,
            limits=limits or self._range,
            knot_spacing=self.knot_spacing,
        )
        return Plan(
            nodes=found.nodes,
            links=np.array(way.links, dtype=np.int64)[passed.of_step],
            in_air=np.array(way.in_air, dtype=bool)[passed.of_step],
            modes=np.array(way.modes, dtype=np.int64)[passed.of_step],
            imagined=passed.imagined,
            waypoints_q=found.waypoints_q,
            waypoint_s=found.waypoint_s,
            path=found.path,
        )


def checked_configuration(
    q_start: np.ndarray, representation: QuotientRepresentation, limits: Limits | None = None
) -> np.ndarray:
    """Returns `q_start` as floats, if a plan may start there.

    Raises:
        ValueError: `q_start` does not hold one finite number per joint, or is outside the limits.
    """
    q_start = np.asarray(q_start, dtype=float)
    num_joints = representation.kernel_q.shape[1]
    if q_start.shape != (num_joints,) or not np.isfinite(q_start).all():
        raise ValueError(
            f"q_start is {q_start.tolist()}: give {num_joints} finite numbers, one per joint"
        )
    if limits is not None:
        lower, upper = limits
        # Stored configurations are float32.
        outside = np.flatnonzero((q_start < lower - 1e-6) | (q_start > upper + 1e-6))
        if outside.size:
            joint = outside[0]
            raise ValueError(
                f"q_start[{joint}] is {q_start[joint]:g}: give a position within the limits of "
                f"the joint, {lower[joint]:g} to {upper[joint]:g}"
            )
    return q_start
