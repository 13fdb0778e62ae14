"""OMPL's planner with the true model, which `table.py` compares with the agent's.

RRT-Connect in a projected state space is given the true kinematics and the true surface. It starts
in the same configurations as the agent and may end in the same ones. The run must be of a robot
with one skin that is a sphere, a cube or a torus about the origin of its link; the skin may move.
`pip install 'selftouch-drake[bench]'` first.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numba import njit
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from selftouch_drake.experiment.schema import SurfaceSettings
from selftouch_drake.robot import World
from selftouch_drake.robot.kinematics import _compose, _move

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.cost.questions import Question

# s of CPU, after which OMPL gives up.
OMPL_TIMEOUT_S = 20.0
SHAPES = {"sphere": 0, "cube": 1, "torus": 2}


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
def on_surface(q, parent, X_PF, turns, owner, X_JL, shape, size):
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
        _move(q[joint], turns[joint], X_FJ)
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
                axis_W = X_WJ[joint, :, 2].copy()
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
            known.parent, known.X_PF, known.turns, known.owner, known.X_JL,
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


def begin(seed: int) -> None:
    """Makes OMPL draw the same numbers every time, and write errors only."""
    ou.setLogLevel(ou.LogLevel.LOG_ERROR)
    ou.RNG.setSeed(seed)
