"""Planning beside its peers, on the same pairs of a run that has learned. Run it as a script.

- selftouch: the quotient graph, which knows neither arm nor body.
- OMPL: RRT-Connect in a projected state space, given the true kinematics and the true surface.
- samples: shortest path over the nearest neighbours of all stored motor configurations.

All start in the same configuration and may end in the same ones; all paths are smoothed, timed and
executed alike. The table stands in docs/planning.md. `pip install 'selftouch-drake[bench]'` first.
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

from selftouch_drake.agent.planning import Planner, smooth_path
from selftouch_drake.agent.planning.route import goal_members
from selftouch_drake.experiment import Experiment
from selftouch_drake.robot.timing import TimedPath, time_path
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.motions import World, load_representation
from selftouch_drake.run.trials import random_pairs

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
    """What every planner is asked: `(J,)` rad where the arm is, and `(n, J)` where it may end."""

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
def on_surface(q, axis_W, p_WJ, p_WF, shape, size):
    """Signed distance of the nearest fingertip to the surface, and its slope in the joints."""
    num_joints, num_fingers = len(axis_W), len(p_WF)
    rotation = np.eye(3)
    shift = np.zeros(3)
    axes = np.empty((num_joints, 3))
    origins = np.empty((num_joints, 3))
    for j in range(num_joints):
        axis = axis_W[j]
        axes[j] = rotation @ axis
        origins[j] = rotation @ p_WJ[j] + shift
        x, y, z = axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turn = np.eye(3) + np.sin(q[j]) * cross + (1 - np.cos(q[j])) * (cross @ cross)
        shift = shift + rotation @ (p_WJ[j] - turn @ p_WJ[j])
        rotation = rotation @ turn
    best, slope = np.inf, np.zeros(num_joints)
    for finger in range(num_fingers):
        p = rotation @ p_WF[finger] + shift
        distance, gradient = surface_distance(p, shape, size)
        if np.abs(distance) < np.abs(best):
            best = distance
            for j in range(num_joints):
                slope[j] = np.dot(np.cross(axes[j], p - origins[j]), gradient)
    return best, slope


class OnSurface(ob.Constraint):
    """A fingertip at mid-depth of the skin."""

    def __init__(self, world: World, experiment: Experiment):
        super().__init__(world.probe.agent.plant.num_positions(), 1, 1e-3)
        known, body = world.probe.kinematics, experiment.body
        depth = experiment.skin.thickness / 2
        if body.shape not in SHAPES:
            raise SystemExit(f"the true surface of a {body.shape} is not known here")
        size = {
            "sphere": lambda: [body.radius - depth],
            "cube": lambda: [body.side / 2 - depth],
            "torus": lambda: [body.major_radius, body.minor_radius - depth],
        }[body.shape]()
        self.arguments = (
            known.axis_W, known.p_WJ, known.p_WF, SHAPES[body.shape], np.array(size)
        )  # fmt: skip

    def function(self, x, out):
        out[0] = on_surface(x, *self.arguments)[0]

    def jacobian(self, x, out):
        out[0] = on_surface(x, *self.arguments)[1]

    def projected(self, q: np.ndarray) -> np.ndarray:
        """The configuration on the surface that Newton's method finds from `q`."""
        q = q.copy()
        for _ in range(50):
            distance, slope = on_surface(q, *self.arguments)
            if abs(distance) < 1e-6:
                break
            q -= distance * slope / max(slope @ slope, 1e-9)
        return q


def ompl_planner(world: World, experiment: Experiment) -> Callable[[Question], np.ndarray | None]:
    """RRT-Connect on the manifold of touching configurations, with OMPL's simplification."""
    agent = world.probe.agent
    constraint = OnSurface(world, experiment)
    ambient = ob.RealVectorStateSpace(len(agent.lower))
    bounds = ob.RealVectorBounds(len(agent.lower))
    for joint, (low, high) in enumerate(zip(agent.lower, agent.upper, strict=True)):
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


def sample_planner(kernel_q: np.ndarray) -> Callable[[Question], np.ndarray | None]:
    """Dijkstra's shortest path over the nearest neighbours of all stored configurations."""
    tree = cKDTree(kernel_q)
    distance, near = tree.query(kernel_q, SAMPLE_NEIGHBOURS + 1)
    row = np.repeat(np.arange(len(kernel_q)), SAMPLE_NEIGHBOURS)
    links = (distance[:, 1:].ravel(), (row, near[:, 1:].ravel()))
    graph = coo_array(links, shape=(len(kernel_q),) * 2).tocsr()

    def plan(question: Question) -> np.ndarray | None:
        _, start = tree.query(question.q_start)
        _, goals = tree.query(question.goal_q)
        cost, parent = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
        node = goals[np.argmin(cost[goals])]
        if not np.isfinite(cost[node]):
            return None
        nodes = [node]
        while nodes[-1] != start:
            nodes.append(parent[nodes[-1]])
        return np.concatenate([question.q_start[None], kernel_q[nodes[::-1]].astype(float)])

    return plan


def questions(run: RunDirectory, representation, num_pairs: int) -> list[Question]:
    """The first pairs that `selftouch evaluate` tries, with the same start configurations."""
    asked = []
    for start, goal in random_pairs(run)[:num_pairs]:
        members = representation.kernel_q[representation.members(start)]
        stream = run.experiment.random_stream("start", start, goal)
        rng = np.random.default_rng(stream)
        q_start = members[rng.integers(len(members))].astype(float)
        goal_rows = rng.permutation(goal_members(representation, goal))[:NUM_GOALS]
        goal_q = representation.kernel_q[goal_rows].astype(float)
        asked.append(Question(start, goal, q_start, goal_q))
    return asked


def jerk(path: BSpline) -> float:
    """Root mean square of the third derivative, in 1/rad^2: third differences every 0.02 rad."""
    length = path.t[-1]
    q = path(np.linspace(0.0, length, max(5, int(length / JERK_SPACING))))
    return float(np.sqrt(np.mean(np.square(np.diff(q, 3, axis=0))))) / JERK_SPACING**3


def measure(name, plan, asked, world: World, experiment: Experiment, targets) -> str:
    """Asks one planner everything, executes its answers, and returns its line of the table."""
    rows = []
    for question in asked:
        began = time.process_time()
        path = plan(question)
        if path is None:
            rows.append([time.process_time() - began, 0.0, 0.0, np.nan, np.nan, np.nan])
            continue
        timed = timed_path(path, experiment)
        spent = time.process_time() - began
        felt = world.dynamic.execute(timed.time_s, timed.q, timed.v).felt
        touching = felt.any(axis=1)
        reached = touching[-1] and np.argmax(targets @ felt[-1]) == question.goal
        length = np.linalg.norm(np.diff(timed.q, axis=0), axis=1).sum()
        rows.append([spent, touching.mean(), reached, length, timed.time_s[-1], jerk(path)])
    spent, contact, reached, length, duration, rough = np.array(rows).T
    return (
        f"| {name} | {1e3 * np.median(spent):,.0f} / {1e3 * np.quantile(spent, 0.95):,.0f} "
        f"| {np.mean(~np.isnan(length)):.0%} | {contact.mean():.2%} / {contact.min():.1%} "
        f"| {reached.mean():.1%} | {np.nanmedian(length):.2f} | {np.nanmedian(duration):.1f} "
        f"| {np.nanmedian(rough):.0f} |"
    )


def timed_path(path: BSpline, experiment: Experiment) -> TimedPath:
    """The path timed as `selftouch plan` does it."""
    limits, num_joints = experiment.execution, path.c.shape[1]
    return time_path(
        path,
        velocity_limit=np.full(num_joints, limits.max_velocity),
        acceleration_limit=np.full(num_joints, limits.max_acceleration),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="a run that has learned")
    parser.add_argument("--pairs", type=int, default=40)
    parser.add_argument("--samples", type=int, default=200_000, help="in the graph of samples")
    arguments = parser.parse_args()
    ou.setLogLevel(ou.LogLevel.LOG_ERROR)
    ou.RNG.setSeed(1)

    run = RunDirectory.open(arguments.run)
    experiment, world = run.experiment, World(run.experiment)
    representation = load_representation(run)
    agent, knot_spacing = world.probe.agent, experiment.planning.knot_spacing
    planner = Planner(representation, knot_spacing=knot_spacing)
    rows = np.random.default_rng(0).permutation(len(representation.kernel_q))[: arguments.samples]

    def smoothed(plan):
        def answer(question: Question) -> BSpline | None:
            waypoints = plan(question)
            if waypoints is None:
                return None
            return smooth_path(
                waypoints, knot_spacing=knot_spacing, lower=agent.lower, upper=agent.upper
            )

        return answer

    def quotient(question: Question) -> BSpline:
        return planner.plan(question.q_start, question.start, question.goal).path

    asked = questions(run, representation, arguments.pairs)
    methods = {
        "selftouch": quotient,
        "OMPL, true model": smoothed(ompl_planner(world, experiment)),
        "samples": smoothed(sample_planner(representation.kernel_q[rows])),
    }
    print(f"{experiment.name}, {len(asked)} pairs\n")
    print("| planner | CPU ms, median / 95 % | solved | contact, mean / worst | reached ", end="")
    print("| length (rad) | duration (s) | jerk (1/rad²) |")
    print("|---" * 8 + "|")
    for name, plan in methods.items():
        plan(asked[0])  # compiles what is compiled
        print(
            measure(name, plan, asked, world, experiment, representation.target_sensations),
            flush=True,
        )


if __name__ == "__main__":
    main()
