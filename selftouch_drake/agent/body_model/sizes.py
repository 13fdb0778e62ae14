"""A toucher's size: a surface of its own where held-out touches say that it is no point.

A fist touches with its knuckles or with its back, as its hand is turned; a fingertip is a point or
a ball, which feel the same. Five numbers for each toucher say how its surface differs from a ball's
(`support`). They are fitted together with joints and places at the end, when the tree is known, and
kept for the touchers whose held-out touches lie nearer to the places of their kernels with them.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import (
    breadth_first_order,
    connected_components,
    minimum_spanning_tree,
)

from selftouch_drake.agent.body_model.refine import refined, with_skin_of_now
from selftouch_drake.agent.body_model.scene import (
    Scene,
    Sizes,
    Solution,
    all_places,
    solution_places,
)
from selftouch_drake.agent.body_model.support import beside
from selftouch_drake.agent.body_model.who_touched import expected, started

#: Touchers have sizes if the mean logarithm of the distances of their held-out touches to their
#: kernels falls by more. Measured on fists of the infant: 0.06 to 0.09; on fingertips: 0.0005.
EARNED = 0.03
# Joints between a toucher and some skin, at least. With four joints a kernel leaves two motions
# free: five more numbers explained touches of a point better than the truth did.
_FEWEST_JOINTS = 5
# Touches with which it is found out whether sizes pay, and steps for it.
_TRIED, _TRIAL_STEPS = 8000, 3
# A patch is flat if its normals look away from its middle by less: the mean cosine, 1 for a ball.
_FLAT = 0.1


def outward_normals(scene: Scene, solution: Solution) -> np.ndarray:
    """`(K, 3)` normals of the skin that look to where it is touched from; NaN where unknown.

    Neighbours look to the same side. Where a patch of skin is curved, the outside is where it
    bulges: touchers come from there, but what carries them may come from behind, as an arm comes
    from the side to the chest. Where it is flat the outside is where the link of the toucher lies.
    """
    with np.errstate(invalid="ignore"):
        normal = solution.normal / np.linalg.norm(solution.normal, axis=1, keepdims=True)
    near = beside(solution.place, scene.part)
    patch, normal = _one_sided(normal, near)
    behind = _behind(scene, solution)
    # Kernels without a normal are in no patch.
    for number in np.unique(patch[patch >= 0]):
        here = np.flatnonzero(patch == number)
        away = solution.place[here] - solution.place[here].mean(axis=0)
        side = np.einsum("ka,ka->k", away, normal[here]).sum()
        if abs(side) <= _FLAT * np.linalg.norm(away, axis=1).sum():
            side = np.einsum("ka,ka->k", behind[here], normal[here]).sum()
        if side < 0:
            normal[here] *= -1
    return normal


def _one_sided(normal: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`(K,)` number of each connected patch, -1 for none, and normals that agree within it."""
    known = np.isfinite(normal).all(axis=1)
    kernel = np.repeat(np.arange(len(near)), near.shape[1])
    other = near.ravel()
    kept = (other >= 0) & known[kernel] & known[other] & (other != kernel)
    kernel, other = kernel[kept], other[kept]
    # Over edges between the most parallel normals first.
    alike = np.abs(np.einsum("na,na->n", normal[kernel], normal[other]))
    cost = csr_array((1.01 - alike, (kernel, other)), shape=(len(near), len(near)))
    tree = minimum_spanning_tree(cost.maximum(cost.T))
    number, patch = connected_components(tree, directed=False)
    normal = normal.copy()
    for component in range(number):
        order, before = breadth_first_order(
            tree, np.flatnonzero(patch == component)[0], directed=False
        )
        for one in order[1:]:
            if normal[one] @ normal[before[one]] < 0:
                normal[one] *= -1
    return np.where(known, patch, -1), normal


def _behind(scene: Scene, solution: Solution) -> np.ndarray:
    """`(K, 3)` towards points behind the touchers, on the axes of their links' joints, in all."""
    Y = solution_places(scene, solution)
    side = np.zeros((len(scene.part), 3))
    points = solution.points.copy()
    for (_, toucher), way in scene.ways.items():
        turning = [j for j, s in way if s > 0 and np.linalg.norm(solution.twists[j, :3]) > 1e-6]
        if not turning:
            continue
        w, v = solution.twists[turning[-1], :3], solution.twists[turning[-1], 3:]
        foot = np.cross(w, v) / (w @ w)
        points[toucher] = foot + w * ((solution.points[toucher] - foot) @ w) / (w @ w)
    back = all_places(scene, solution.twists, points)
    for toucher in range(len(points)):
        weight = np.nan_to_num(solution.share[:, toucher])
        away = np.nan_to_num(back[toucher] - Y[toucher]) * weight[:, None]
        for axis in range(3):
            side[:, axis] += np.bincount(
                scene.target, weights=away[:, axis], minlength=len(scene.part)
            )
    return side


def sized(scene: Scene, solution: Solution, which: np.ndarray | None = None) -> Solution:
    """The solution whose touchers may have surfaces; they are points still.

    Args:
        scene: its touches.
        solution: with points.
        which: `(U,)` bool, touchers that may; all by default.
    """
    number = len(solution.points)
    which = np.ones(number, dtype=bool) if which is None else which
    normal = outward_normals(scene, solution)
    sizes = Sizes.of(np.zeros((number, 5)), which, solution.place, normal, scene.part)
    return replace(solution, sizes=sizes)


def carried_over(scene: Scene, solution: Solution) -> Solution:
    """A solution for other touches: who made them, places and noise, at the same joints and sizes.

    Args:
        scene: the other touches.
        solution: of some.
    """
    points = started(scene, solution.twists, solution.points)
    if solution.sizes is None:
        return expected(scene, points, rounds=2)
    points = expected(scene, replace(points, sizes=solution.sizes), rounds=2)
    return with_skin_of_now(scene, points)


def log_distances(tests: Scene, solution: Solution) -> np.ndarray:
    """`(m,)` logarithms of distances of held-out touches to their kernels; NaN where unknown.

    Each is that of the nearest toucher, relative to the size of the part's skin.
    """
    Y = solution_places(tests, solution)
    far = np.linalg.norm(Y - solution.place[tests.target], axis=2)
    far = np.nan_to_num(far, nan=np.inf).min(axis=0)
    size = np.ones(int(tests.part.max()) + 1)
    for part in tests.parts:
        place = solution.place[tests.part == part]
        size[part] = np.linalg.norm(place[np.isfinite(place).all(axis=1)].std(axis=0))
    far = np.maximum(far / size[tests.part[tests.target]], 1e-6)
    return np.where(np.isfinite(far), np.log(far), np.nan)


def with_sizes(
    scene: Scene,
    tests: Scene,
    solution: Solution,
    random: np.random.Generator,
    *,
    fixed: np.ndarray | None = None,
    tick: Callable[[], None] = lambda: None,
) -> Solution:
    """The solution with surfaces of those touchers that held-out touches give one.

    Args:
        scene: training touches.
        tests: held-out touches.
        solution: of the training touches, with points.
        random: which touches the first trial takes.
        fixed: as in `refined`.
        tick: called before each step.
    """
    long = np.zeros(len(solution.points), dtype=bool)
    ways = Counter((part, way) for (part, _), way in scene.ways.items())
    for (part, toucher), way in scene.ways.items():
        # Several points of one link are its surface already.
        long[toucher] |= len(way) >= _FEWEST_JOINTS and ways[part, way] == 1
    if not long.any():
        return solution
    some = scene.some(np.sort(random.permutation(len(scene.q))[:_TRIED]))
    start = started(some, solution.twists, solution.points)
    as_points = refined(some, start, steps=_TRIAL_STEPS, fixed=fixed, tick=tick)
    trial = refined(some, sized(some, start, long), steps=_TRIAL_STEPS, fixed=fixed, tick=tick)
    if not (_gains(tests, as_points, trial) > EARNED).any():
        return solution
    full = refined(scene, sized(scene, solution, long), fixed=fixed, tick=tick)
    earned = _gains(tests, solution, full) > EARNED
    if earned.any() and (earned != long).any():
        full = refined(scene, sized(scene, solution, earned), fixed=fixed, tick=tick)
    return full if earned.any() else solution


def _gains(tests: Scene, points: Solution, trial: Solution) -> np.ndarray:
    """`(U,)` how much the held-out touches of each toucher come nearer by sizes."""
    before, after = log_distances(tests, points), log_distances(tests, trial)
    Y = solution_places(tests, trial)
    far = np.linalg.norm(Y - trial.place[tests.target], axis=2)
    nearest = np.nan_to_num(far, nan=np.inf).argmin(axis=0)
    known = np.isfinite(before) & np.isfinite(after)
    gains = np.zeros(len(points.points))
    for toucher in range(len(gains)):
        own = known & (nearest == toucher)
        if own.any():
            # Outliers lie far away with and without sizes.
            gains[toucher] = np.mean(before[own] - after[own])
    return gains
