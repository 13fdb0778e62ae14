"""The least-squares finish: joints, points of touchers and places of kernels together.

Noise is as it is: a kernel is flat along the skin's normal, so residuals along normals weigh more.
Its places are free, one for each kernel whoever touched it, and eliminated: at given joints the
best place is a weighted mean. What is minimised is, over parts, the logarithm of the noise's volume
less that of the total scatter, which has no scale.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from selftouch_drake.agent.body_model.chain import derivatives, places, turns
from selftouch_drake.agent.body_model.scene import (
    Scene,
    Sizes,
    Solution,
    bulges,
    kernel_sums,
    solution_places,
    way_arrays,
)
from selftouch_drake.agent.body_model.who_touched import expected, metric, settled, total_scatter

# Damping of the Gauss-Newton steps, relative to the largest eigenvalue, and how often it grows.
_DAMPING, _MOST_TRIES = 1e-7, 6


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Normal equations of a solution: n parameters.

    These are the twists, then the points, and then the shapes, where touchers have sizes.

    Attributes:
        gradient: `(n,)` of the criterion.
        hessian: `(n, n)` its Gauss-Newton approximation.
        scores: `(K, n)` parts of the gradient that each kernel contributes.
    """

    gradient: np.ndarray
    hessian: np.ndarray
    scores: np.ndarray


def equations(scene: Scene, solution: Solution) -> Equations:
    """Normal equations at a solution, with places eliminated."""
    num_joints, num_touchers = len(solution.twists), len(solution.points)
    size, number = 6 * num_joints + 3 * num_touchers, len(scene.part)
    size += 0 if solution.sizes is None else 5 * num_touchers
    gradient, hessian = np.zeros(size), np.zeros((size, size))
    scores = np.zeros((number, size))
    mean_slope, mass = np.zeros((number, 3, size)), np.zeros(number)
    per_part = len(scene.parts)
    W = np.zeros((number, 3, 3))
    for part in scene.parts:
        rows = scene.rows(part)
        touchers = scene.touchers(part)
        W[scene.part == part] = metric(solution.normal, solution.sigma[part])[scene.part == part]
        solved = []
        for toucher in touchers:
            kept = rows[solution.share[rows, toucher] > 1e-3]
            if len(kept) == 0:
                continue  # It does not touch this part after all.
            solved.append(
                (
                    kept,
                    solution.share[kept, toucher],
                    *place_slopes(scene, solution, kept, part, toucher),
                )
            )
        if not solved:
            continue
        count = sum(weight.sum() for _, weight, *_ in solved)
        # As in `settled`: each kernel's mean takes the freedom of one of its touches.
        met = [
            np.bincount(scene.target[kept], weights=weight, minlength=number)
            for kept, weight, *_ in solved
        ]
        free = max(count - (np.sum(met, axis=0) > 0.5).sum(), 1.0)
        center, total = total_scatter([(y, weight) for _, weight, y, *_ in solved])
        total_inverse = np.linalg.inv(total)
        for kept, weight, y, slope, columns in solved:
            target = scene.target[kept]
            factor = 2 * weight / free / per_part
            r, t = y - solution.place[target], y - center
            pull = np.einsum("nab,nb->na", W[target], r) - (free / count) * t @ total_inverse
            own = np.einsum("n,na,nap->np", factor, pull, slope)
            sums = kernel_sums(own, target, number)
            scores[:, columns] += sums
            root = np.linalg.cholesky(W[target]).swapaxes(1, 2) * np.sqrt(factor)[:, None, None]
            tall = (root @ slope).reshape(-1, len(columns))
            hessian[np.ix_(columns, columns)] += tall.T @ tall
            flat = (factor[:, None, None] * slope).reshape(len(kept), 3 * len(columns))
            mean_slope[:, :, columns] += kernel_sums(flat, target, number).reshape(
                number, 3, len(columns)
            )
            mass += np.bincount(target, weights=factor, minlength=number)
    gradient = scores.sum(axis=0)
    has = mass > 0
    mean = mean_slope[has] / mass[has][:, None, None]
    root = np.linalg.cholesky(W[has]).swapaxes(1, 2) * np.sqrt(mass[has])[:, None, None]
    tall = (root @ mean).reshape(-1, size)
    return Equations(gradient, hessian - tall.T @ tall, scores)


def place_slopes(
    scene: Scene, solution: Solution, rows: np.ndarray, part: int, toucher: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`(n, 3)` places of a toucher at some touches of a part, and what they depend on.

    Also `(n, 3, m)` derivatives by m parameters, and `(m,)` which of all parameters these are, in
    the order of `Equations`.
    """
    way = scene.ways[part, toucher]
    arrays = way_arrays(scene, solution.twists, rows, way)
    q, twists, signs = arrays
    first = 6 * len(solution.twists) + 3 * toucher
    columns = [6 * joint + entry for joint, _ in way for entry in range(6)]
    columns += [first, first + 1, first + 2]
    sizes, point = solution.sizes, solution.points[toucher]
    if sizes is None or not sizes.sized[toucher]:
        y, by_twist, by_point, _ = derivatives(q, twists, point, signs)
        slope = np.concatenate([by_twist.reshape(len(rows), 3, 6 * len(way)), by_point], axis=2)
        return y, slope, np.array(columns)
    # The normal that tells where the toucher touches is held still.
    turn = turns(*arrays)
    by_shape = bulges(scene, sizes, (part, toucher), places(q, twists, point, signs), turn)
    in_hand = np.einsum("nba,nb->na", turn, by_shape @ sizes.shape[toucher])
    y, by_twist, by_point, _ = derivatives(q, twists, point + in_hand, signs)
    slope = np.concatenate(
        [by_twist.reshape(len(rows), 3, 6 * len(way)), by_point, by_shape], axis=2
    )
    first = 6 * len(solution.twists) + 3 * len(solution.points) + 5 * toucher
    return y, slope, np.array([*columns, *range(first, first + 5)])


def moved_by(solution: Solution, step: np.ndarray) -> Solution:
    """The solution with its twists, points and shapes moved."""
    size = solution.twists.size
    end = size + solution.points.size
    sizes = solution.sizes
    if sizes is not None:
        sizes = replace(sizes, shape=sizes.shape + step[end:].reshape(-1, 5))
    return replace(
        solution,
        twists=solution.twists + step[:size].reshape(-1, 6),
        points=solution.points + step[size:end].reshape(-1, 3),
        sizes=sizes,
    )


def with_skin_of_now(scene: Scene, solution: Solution) -> Solution:
    """The solution whose touchers meet the skin where its kernels lie by now."""
    sizes = solution.sizes
    if sizes is None:
        return solution
    turned = np.einsum("ka,ka->k", solution.normal, sizes.normal) < 0
    normal = np.where(turned[:, None], -solution.normal, solution.normal)
    # Kernels that had no side yet stay without one.
    normal[np.isnan(sizes.normal).any(axis=1)] = np.nan
    sizes = Sizes.of(sizes.shape, sizes.sized, solution.place, normal, scene.part)
    return expected(scene, replace(solution, sizes=sizes), rounds=1)


def held(fixed: np.ndarray, number: int) -> np.ndarray:
    """`(number,)` bool, parameters that stay: `fixed` tells the first, the others are free."""
    return np.concatenate([fixed, np.zeros(number - len(fixed), dtype=bool)])


def refined(
    scene: Scene,
    solution: Solution,
    *,
    steps: int = 10,
    fixed: np.ndarray | None = None,
    tick: Callable[[], None] = lambda: None,
) -> Solution:
    """Gauss-Newton steps, each followed by who touched; ends where nothing gains.

    Args:
        scene: touches.
        solution: where to start.
        steps: at most.
        fixed: `(m,)` bool, of the first m parameters those that stay, for instance the turning of
            a slide.
        tick: called before each step.
    """
    damping = _DAMPING
    for _ in range(steps):
        tick()
        found = equations(scene, solution)
        before = _mean_criterion(scene, solution)
        free = np.flatnonzero(np.abs(np.diag(found.hessian)) > 0)
        if fixed is not None:
            free = free[~held(fixed, len(found.gradient))[free]]
        if len(free) == 0:
            break  # All touches are outliers.
        values, vectors = np.linalg.eigh(found.hessian[np.ix_(free, free)])
        along = vectors.T @ found.gradient[free]
        for _ in range(_MOST_TRIES):
            step = np.zeros(len(found.gradient))
            step[free] = -vectors @ (along / (np.maximum(values, 0) + damping * values[-1]))
            trial = moved_by(solution, step)
            Y = solution_places(scene, trial)
            trial = settled(scene, trial, Y)
            gain = before - _mean_criterion(scene, trial)
            if gain > 0:
                break
            damping *= 30
        else:
            break
        damping = max(damping / 10, _DAMPING)
        solution = with_skin_of_now(scene, expected(scene, trial, rounds=1, Y=Y))
        if gain < 2e-4:
            break
    return solution


def _mean_criterion(scene: Scene, solution: Solution) -> float:
    value = float(np.mean([solution.criterion[part] for part in scene.parts]))
    return value if np.isfinite(value) else np.inf
