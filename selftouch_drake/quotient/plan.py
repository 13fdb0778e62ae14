"""A motion from one sensation to another (paper, "Sensation trajectory planning").

A path in M/=_Psi is a continuous curve of classes of motor configurations. The agent finds it in
four steps: a route over linked kernels (`links`, `route`), through their firm touches (`firm`), one
configuration in each (`waypoints`), and a smooth curve through them (`smooth`). By the theorem it
is a continuous motion of the end effector in X/=_phi.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from .firm import firm_rows, goal_rows
from .kernels import KernelSets
from .links import leap_penalty, link_lengths, step_links
from .representation import Representation
from .route import Query, RouteGraph, carried_route
from .smooth import KNOT_SPACING, path_length, smooth_path
from .waypoints import smoothest_configurations

#: Lowest and highest motor configuration, `(J,)` each.
Limits = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotorPath:
    """A geometric path in motor space through one configuration of each kernel on a route.

    W waypoints and J joints. Motor configurations are in the robot's units; lengths along the path
    are between scaled configurations (mu).

    Attributes:
        nodes: `(W,)` kernels, from the start to the goal.
        waypoints_q: `(W, J)` one motor configuration per kernel.
        waypoint_s: `(W,)` mu, parameter of each waypoint on `path`: polyline length up to it.
        path: smooth quintic B-spline of motor configurations over `[0, waypoint_s[-1]]`, from the
            first waypoint to the last; constant over `[0, 1]` if the start is the goal.
    """

    nodes: np.ndarray
    waypoints_q: np.ndarray
    waypoint_s: np.ndarray
    path: BSpline

    @property
    def goal(self) -> int:
        """The kernel to be felt at the end."""
        return int(self.nodes[-1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanningGraph:
    """All that plans over one representation share: build it once for many plans.

    Attributes:
        graph: linked kernels and their firm configurations.
        penalty: `(L,)` factors on the cost of each link.
        length: `(L,)` lengths of the links along the body, in spacings of kernels.
    """

    graph: RouteGraph
    penalty: np.ndarray
    length: np.ndarray

    @classmethod
    def of(cls, representation: Representation) -> "PlanningGraph":
        """Links the kernels of a representation."""
        targets = representation.target_sensations
        links = step_links(targets, representation.edges)
        rows = [firm_rows(representation, k) for k in range(representation.num_targets)]
        firm_row = np.concatenate(rows)
        x = representation.scaled(representation.kernel_q[firm_row]).astype(np.float32)
        firm = KernelSets(x, np.cumsum([0, *map(len, rows)]))
        length = link_lengths(targets, links)
        graph = RouteGraph.of(firm, links)
        return cls(graph=graph, penalty=leap_penalty(length), length=length)


def plan(
    representation: Representation,
    start: int,
    goal: int,
    *,
    q_start: np.ndarray | None = None,
    planning_graph: PlanningGraph | None = None,
) -> MotorPath:
    """Plans a smooth motion from one target sensation to another.

    Args:
        representation: what was learned.
        start: the target sensation that is felt now.
        goal: the target sensation to feel at the end.
        q_start: `(J,)` the configuration now; by default, the one of the start whose sensation is
            nearest to the target.
        planning_graph: that of the representation, if there are many plans.

    Raises:
        ValueError: a target is out of range, or no links lead to the goal.
    """
    start, goal = representation.checked_target(start), representation.checked_target(goal)
    if planning_graph is None:
        planning_graph = PlanningGraph.of(representation)
    graph = planning_graph.graph
    if q_start is None:
        q_start = most_typical(representation, start)
    q_start = np.asarray(q_start, dtype=float)
    x_start = representation.scaled(q_start)
    ends = representation.scaled(representation.kernel_q[goal_rows(representation, goal)])
    ends = ends.astype(np.float32)
    query = Query(start, x_start, goal, ends)
    price = graph.step_price(planning_graph.penalty)
    nodes = carried_route(graph, query, price, planning_graph.length)
    if not len(nodes):
        raise ValueError(
            f"no links lead from target {start} to {goal}: babble longer, or give fewer targets"
        )
    waypoints_x = x_start[None]
    if start != goal:
        between = [graph.firm.configurations(kernel) for kernel in nodes[1:-1]]
        waypoints_x = smoothest_configurations([waypoints_x, *between, ends])
    return path_through(nodes, waypoints_x, q_start, representation)


def path_through(
    nodes: np.ndarray,
    waypoints_x: np.ndarray,
    q_start: np.ndarray,
    representation: Representation,
    *,
    limits: Limits | None = None,
    knot_spacing: float = KNOT_SPACING,
) -> MotorPath:
    """The smooth path through scaled configurations `(W, J)` of kernels `(W,)`.

    It starts at `(J,)` q_start, the first of them, to the last bit. No joint passes the limits, in
    the robot's units, unless a waypoint does; by default they are the range of experience.
    """
    if limits is None:
        known = representation.kernel_q
        limits = known.min(axis=0), known.max(axis=0)
    lower, upper = map(representation.scaled, limits)
    path = smooth_path(waypoints_x, knot_spacing=knot_spacing, limits=(lower, upper))
    path.c = path.c / representation.joint_scale
    waypoints_q = waypoints_x / representation.joint_scale
    waypoints_q[0] = path.c[0] = q_start
    return MotorPath(
        nodes=np.asarray(nodes),
        waypoints_q=waypoints_q,
        waypoint_s=path_length(waypoints_x),
        path=path,
    )


def most_typical(representation: Representation, kernel: int) -> np.ndarray:
    """`(J,)` the configuration of a kernel whose sensation is nearest to its target sensation."""
    members = representation.members(kernel)
    row = representation.kernel_error[members].argmin()
    return representation.kernel_q[members][row].astype(float)
