"""Planning compared with other planners, on the same pairs of a learned run. Run it as a script.

- selftouch: the quotient graph, which knows neither the robot nor its body.
- OMPL: RRT-Connect in a projected state space, given the true kinematics and the true surface.
- samples: shortest path over the nearest neighbours of all stored motor configurations.

All start in the same configuration and may end in the same ones; all paths are smoothed, timed and
executed alike. The run must be of a robot with one skin that is a sphere, a cube or a torus about
the origin of its link; the skin may move. The table stands in docs/planning.md.
`pip install 'selftouch-drake[bench]'` first.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou
from scipy.interpolate import BSpline
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from selftouch_drake.agent.planning import Planner, goal_members, smooth_path
from selftouch_drake.agent.representation import QuotientRepresentation, felt_kernels
from selftouch_drake.evaluation import random_pairs
from selftouch_drake.experiment import SurfaceSettings
from selftouch_drake.robot import World
from selftouch_drake.robot.kinematics import _compose, _move
from selftouch_drake.robot.timing import TimedPath, time_path
from selftouch_drake.run import stages
from selftouch_drake.run.artifacts import load_representation
from selftouch_drake.run.directory import RunDirectory

# Goal configurations offered to a peer; more slow OMPL's nearest-neighbour search of its goal tree.
NUM_GOALS = 20
# s of CPU, after which OMPL gives up.
OMPL_TIMEOUT_S = 20.0
# Nearest neighbours that the graph of samples joins.
SAMPLE_NEIGHBOURS = 12
# rad of path length between the samples on which jerk is measured.
JERK_SPACING = 0.02
SHAPES = {"sphere": 0, "cube": 1, "torus": 2}


@dataclass(frozen=True)
class Question:
    """A task for all planners: `(J,)` start and `(n, J)` possible ends."""

    start: int
    goal: int
    q_start: np.ndarray
    goal_q: np.ndarray


@njit(cache=True)
def surface_distance(p, shape, size):
    """Signed distance of a point to a surface, and its gradient."""
    gradient = np.zeros(3)
    if shape == 0:
        norm = np.sqrt(np.sum(p * p))
        return norm - size[0], p / norm
    if shape == 2:
        ring = np.sqrt(p[0] ** 2 + p[1] ** 2)
        away = np.array([p[0] * (1 - size[0] / ring), p[1] * (1 - size[0] / ring), p[2]])
        norm = np.sqrt(np.sum(away * away))
        return norm - size[1], away / norm
    over = np.abs(p) - size[0]
    axis = np.argmax(over)
    if over[axis] <= 0.0:
        gradient[axis] = np.sign(p[axis])
        return over[axis], gradient
    outside = np.maximum(over, 0.0)
    norm = np.sqrt(np.sum(outside * outside))
    return norm, np.sign(p) * outside / norm


@njit(cache=True)
def on_surface(q, parent, X_PF, axis_F, turns, owner, X_JL, shape, size):
    """Signed distance of the nearest toucher to the surface, and its slope in the joints.

    The first frame is that of the skin's link, the others are those of the touchers.
    """
    num_joints = len(parent)
    # The world, then what each joint moves.
    X = np.zeros((num_joints + 1, 3, 4))
    for i in range(3):
        X[0, i, i] = 1.0
    X_WF, X_FJ = np.empty((1, 3, 4)), np.zeros((1, 3, 4))
    for joint in range(num_joints):
        _compose(X, parent[joint] + 1, X_PF, joint, X_WF, 0)
        _move(q[joint], axis_F, joint, turns[joint], X_FJ)
        _compose(X_WF, 0, X_FJ, 0, X, joint + 1)
    X_WJ, X_WL = X[1:], np.empty((len(owner), 3, 4))
    for frame in range(len(owner)):
        _compose(X, owner[frame] + 1, X_JL, frame, X_WL, frame)
    best, slope = np.inf, np.zeros(num_joints)
    for toucher in range(1, len(owner)):
        p_WT = X_WL[toucher, :, 3].copy()
        R_WS = X_WL[0, :, :3].copy()
        distance, gradient_S = surface_distance(R_WS.T @ (p_WT - X_WL[0, :, 3]), shape, size)
        if np.abs(distance) >= np.abs(best):
            continue
        best = distance
        gradient_W = R_WS @ gradient_S
        slope[:] = 0.0
        # What moves the toucher moves it over the skin; what moves the skin moves it away.
        for frame, sign in ((toucher, 1.0), (0, -1.0)):
            joint = owner[frame]
            while joint >= 0:
                axis_W = X_WJ[joint, :, :3].copy() @ axis_F[joint]
                motion = np.cross(axis_W, p_WT - X_WJ[joint, :, 3]) if turns[joint] else axis_W
                slope[joint] += sign * np.dot(motion, gradient_W)
                joint = parent[joint]
    return best, slope


class OnSurface(ob.Constraint):
    """A toucher at mid-depth of the skin."""

    def __init__(self, world: World):
        super().__init__(world.robot.num_joints, 1, 1e-3)
        (skin,) = world.experiment.skins.values()
        depth, known = skin.thickness / 2, world.robot.kinematics
        self.arguments = (
            known.parent, known.X_PF, known.axis_F, known.turns, known.owner, known.X_JL,
            SHAPES[skin.surface.shape], dimensions(skin.surface, depth),
        )  # fmt: skip

    def function(self, x, out):
        out[0] = on_surface(x, *self.arguments)[0]

    def jacobian(self, x, out):
        out[0] = on_surface(x, *self.arguments)[1]

    def projected(self, q: np.ndarray) -> np.ndarray:
        """Newton's method from `q` to a configuration on the surface."""
        q = q.copy()
        for _ in range(50):
            distance, slope = on_surface(q, *self.arguments)
            if abs(distance) < 1e-6:
                break
            q -= distance * slope / max(slope @ slope, 1e-9)
        return q


def dimensions(surface: SurfaceSettings, depth: float) -> np.ndarray:
    """Parameters of `surface_distance` for a shape, `depth` m below its surface."""
    if surface.shape == "sphere":
        return np.array([surface.radius - depth])
    if surface.shape == "cube":
        return np.array([surface.side / 2 - depth])
    return np.array([surface.major_radius, surface.minor_radius - depth])


def require_known(world: World) -> None:
    """Checks that the true surface of a robot is known here."""
    skins = list(world.experiment.skins.values())
    known = len(skins) == 1 and skins[0].surface.shape in SHAPES
    if not known or any(skins[0].surface.translation + skins[0].surface.rpy_deg):
        raise SystemExit(
            f"{world.experiment.name} has not one skin that is a sphere, a cube or a torus about "
            "the origin of its link; give the run of another experiment"
        )


def ompl_planner(world: World) -> Callable[[Question], np.ndarray | None]:
    """RRT-Connect on the manifold of touching configurations, with OMPL's simplification."""
    lower, upper = world.robot.babbled_range
    constraint = OnSurface(world)
    ambient = ob.RealVectorStateSpace(len(lower))
    bounds = ob.RealVectorBounds(len(lower))
    for joint, (low, high) in enumerate(zip(lower, upper, strict=True)):
        bounds.setLow(joint, float(low))
        bounds.setHigh(joint, float(high))
    ambient.setBounds(bounds)

    def plan(question: Question) -> np.ndarray | None:
        space = ob.ProjectedStateSpace(ambient, constraint)
        information = ob.ConstrainedSpaceInformation(space)
        setup = og.SimpleSetup(information)
        setup.setStateValidityChecker(lambda state: True)

        def state_at(q):
            state = information.allocState()
            state.copy(constraint.projected(q))
            return state

        setup.setStartState(state_at(question.q_start))
        goals = ob.GoalStates(information)
        for q in question.goal_q:
            goals.addState(state_at(q))
        setup.setGoal(goals)
        setup.setPlanner(og.RRTConnect(information))
        setup.setup()
        end = time.process_time() + OMPL_TIMEOUT_S
        setup.solve(ob.PlannerTerminationCondition(lambda: time.process_time() > end))
        if not setup.haveExactSolutionPath():
            return None
        setup.simplifySolution()
        path = setup.getSolutionPath()
        path.interpolate()
        num_joints = len(question.q_start)
        q = np.array([[state[j] for j in range(num_joints)] for state in path.getStates()])
        end = np.square(question.goal_q - q[-1]).sum(axis=1).argmin()
        return np.concatenate([question.q_start[None], q, question.goal_q[end][None]])

    return plan


def sample_planner(
    representation: QuotientRepresentation, num_samples: int
) -> Callable[[Question], np.ndarray | None]:
    """Dijkstra's shortest path over the nearest neighbours of many stored configurations."""
    rows = np.random.default_rng(0).permutation(representation.num_rows)[:num_samples]
    kernel_q = representation.kernel_q[rows]
    tree = cKDTree(representation.scaled(kernel_q))
    distance, near = tree.query(tree.data, SAMPLE_NEIGHBOURS + 1)
    row = np.repeat(np.arange(len(kernel_q)), SAMPLE_NEIGHBOURS)
    links = (distance[:, 1:].ravel(), (row, near[:, 1:].ravel()))
    graph = coo_array(links, shape=(len(kernel_q),) * 2).tocsr()

    def plan(question: Question) -> np.ndarray | None:
        _, start = tree.query(representation.scaled(question.q_start))
        _, goals = tree.query(representation.scaled(question.goal_q))
        cost, parent = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
        node = goals[np.argmin(cost[goals])]
        if not np.isfinite(cost[node]):
            return None
        nodes = [node]
        while nodes[-1] != start:
            nodes.append(parent[nodes[-1]])
        return np.concatenate([question.q_start[None], kernel_q[nodes[::-1]].astype(float)])

    return plan


def questions(
    run: RunDirectory, representation: QuotientRepresentation, num_pairs: int
) -> list[Question]:
    """The first pairs that `selftouch evaluate` tries, with the same start configurations."""
    asked = []
    for start, goal in random_pairs(run.experiment, representation)[:num_pairs]:
        members = representation.kernel_q[representation.members(start)]
        stream = run.experiment.random_stream("start", start, goal)
        rng = np.random.default_rng(stream)
        q_start = members[rng.integers(len(members))].astype(float)
        goal_rows = rng.permutation(goal_members(representation, goal))[:NUM_GOALS]
        goal_q = representation.kernel_q[goal_rows].astype(float)
        asked.append(Question(start, goal, q_start, goal_q))
    return asked


def jerk(path: BSpline, scale: np.ndarray) -> float:
    """Root mean square of the third derivative, in 1/rad^2: third differences every 0.02 rad."""
    length = path.t[-1]
    x = path(np.linspace(0.0, length, max(5, int(length / JERK_SPACING)))) * scale
    return float(np.sqrt(np.mean(np.square(np.diff(x, 3, axis=0))))) / JERK_SPACING**3


def measure(name, plan, asked, world: World, representation: QuotientRepresentation) -> str:
    """Runs one planner on all tasks, executes its plans, and returns its line of the table."""
    rows = []
    for question in asked:
        began = time.process_time()
        path = plan(question)
        if path is None:
            rows.append([time.process_time() - began, 0.0, 0.0, np.nan, np.nan, np.nan])
            continue
        timed = timed_path(path, world)
        spent = time.process_time() - began
        felt = world.simulation.execute(timed.time_s, timed.q, timed.v).felt
        reached = question.goal in felt_kernels(representation, felt[-1])
        length = np.linalg.norm(np.diff(representation.scaled(timed.q), axis=0), axis=1).sum()
        rough = jerk(path, representation.joint_scale)
        rows.append([spent, felt.any(axis=1).mean(), reached, length, timed.time_s[-1], rough])
    spent, contact, reached, length, duration, rough = np.array(rows).T
    return (
        f"| {name} | {1e3 * np.median(spent):,.0f} / {1e3 * np.quantile(spent, 0.95):,.0f} "
        f"| {np.mean(~np.isnan(length)):.0%} | {contact.mean():.2%} / {contact.min():.1%} "
        f"| {reached.mean():.1%} | {np.nanmedian(length):.2f} | {np.nanmedian(duration):.1f} "
        f"| {np.nanmedian(rough):.0f} |"
    )


def measure_cpu(work: Callable[[], object]) -> float:
    """CPU time in s."""
    began = time.process_time()
    work()
    return time.process_time() - began


def timed_path(path: BSpline, world: World) -> TimedPath:
    """The path timed as `selftouch plan` does it."""
    limits = world.limits
    return time_path(path, velocity_limit=limits.velocity, acceleration_limit=limits.acceleration)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="a run that has learned")
    parser.add_argument("--pairs", type=int, default=40, help="of start and goal")
    parser.add_argument("--samples", type=int, default=200_000, help="in the graph of samples")
    arguments = parser.parse_args()
    ou.setLogLevel(ou.LogLevel.LOG_ERROR)
    ou.RNG.setSeed(1)

    run = RunDirectory.open(arguments.run)
    experiment, world = run.experiment, stages.make_world(run)
    require_known(world)
    representation = load_representation(run)
    limits = world.robot.lower, world.robot.upper
    lower, upper = (representation.scaled(limit) for limit in limits)
    knot_spacing = experiment.planning.knot_spacing
    planner = Planner(representation, knot_spacing=knot_spacing)

    def smoothed(plan):
        def answer(question: Question) -> BSpline | None:
            waypoints = plan(question)
            if waypoints is None:
                return None
            path = smooth_path(
                representation.scaled(waypoints),
                knot_spacing=knot_spacing,
                lower=lower,
                upper=upper,
            )
            path.c = representation.unscaled(path.c)
            return path

        return answer

    def quotient(question: Question) -> BSpline:
        return planner.plan(question.q_start, [question.start, question.goal]).path

    asked = questions(run, representation, arguments.pairs)
    methods = {
        "selftouch": quotient,
        "OMPL, true model": smoothed(ompl_planner(world)),
        "samples": smoothed(sample_planner(representation, arguments.samples)),
    }
    print(f"{experiment.name}, {len(asked)} pairs\n")
    print("| planner | CPU ms, median / 95 % | solved | contact, mean / worst | reached ", end="")
    print("| length (rad) | duration (s) | jerk (1/rad²) |")
    print("|---" * 8 + "|")
    for name, plan in methods.items():
        plan(asked[0])  # compiles what is compiled
        print(measure(name, plan, asked, world, representation), flush=True)


if __name__ == "__main__":
    main()
