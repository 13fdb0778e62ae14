"""How exact a refined body is: the covariance of its parameters, and what touch cannot tell."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.chain import adjoint
from selftouch_drake.agent.body_model.refine import equations, held
from selftouch_drake.agent.body_model.scene import Scene, Solution, solution_places
from selftouch_drake.agent.body_model.support import shape_moved
from selftouch_drake.agent.body_model.who_touched import settled


def gauge(twists: np.ndarray, points: np.ndarray, shapes: np.ndarray | None = None) -> np.ndarray:
    """`(n, 7)` orthonormal directions that change nothing that touch can tell: a similarity."""
    columns = []
    for axis in range(7):
        motion = np.eye(4)
        step = 1e-6
        if axis < 3:
            motion[axis, 3] = step
        elif axis < 6:
            a, b = (axis - 2) % 3, (axis - 1) % 3
            motion[a, b], motion[b, a] = -step, step
        else:
            motion[:3, :3] *= 1 + step
        moved = adjoint(motion, twists)
        carried = points @ motion[:3, :3].T + motion[:3, 3]
        change = [(moved - twists).ravel(), (carried - points).ravel()]
        if shapes is not None:
            change.append(np.ravel([shape_moved(motion, one) - one for one in shapes]))
        columns.append(np.concatenate(change) / step)
    return np.linalg.qr(np.stack(columns, axis=1))[0]


def covariance(scene: Scene, solution: Solution, *, fixed: np.ndarray | None = None) -> np.ndarray:
    """`(n, n)` mean squared errors of the parameters, without the directions of the gauge.

    Two errors add up. That of chance is the sandwich estimate, clustered by kernels: residuals of
    one kernel depend on each other. The other does not shrink with more touches: kernels have a
    size, and a map that is bent a little makes them smaller. The model itself tells how much:
    touches are given to the kernels whose places they lie at, as if the model were true, and what
    another step of the fit would then change is the error.
    Parameters that nothing depends on have NaN.

    Args:
        scene: touches.
        solution: of them.
        fixed: `(m,)` bool, of the first m parameters those that the fit held: the turning of a
            slide. They have NaN.
    """
    found = equations(scene, solution)
    size = len(found.gradient)
    known = np.diag(found.hessian) > 0
    free = np.flatnonzero(known if fixed is None else known & ~held(fixed, size))
    shapes = None if solution.sizes is None else solution.sizes.shape
    basis = gauge(solution.twists, solution.points, shapes)[free]
    values, vectors = np.linalg.eigh(np.eye(len(free)) - basis @ np.linalg.pinv(basis))
    rest = vectors[:, values > 0.5]
    inverse = np.linalg.pinv(rest.T @ found.hessian[np.ix_(free, free)] @ rest, rcond=1e-12)
    scores = (found.scores[:, free] - found.gradient[free] / len(found.scores)) @ rest
    Y = solution_places(scene, solution)
    again = as_if_true(scene, solution, Y)
    slope = equations(again, settled(again, solution, Y)).gradient[free] @ rest
    inner = rest @ (inverse @ (scores.T @ scores + np.outer(slope, slope)) @ inverse) @ rest.T
    result = np.full((size, size), np.nan)
    result[np.ix_(free, free)] = inner
    return result


def as_if_true(scene: Scene, solution: Solution, Y: np.ndarray) -> Scene:
    """The scene with each touch given to the kernel whose place it lies at; outliers stay.

    Args:
        scene: touches.
        solution: of them.
        Y: `(U, R, 3)` their places.
    """
    target = scene.target.copy()
    for part in scene.parts:
        rows = scene.rows(part)
        rows = rows[solution.share[rows].sum(axis=1) > 0.5]
        kernels = np.flatnonzero((scene.part == part) & np.isfinite(solution.place).all(axis=1))
        if len(rows) == 0 or len(kernels) == 0:
            continue
        own = Y[solution.share[rows].argmax(axis=1), rows]
        target[rows] = kernels[cKDTree(solution.place[kernels]).query(own)[1]]
    return replace(scene, target=target)
