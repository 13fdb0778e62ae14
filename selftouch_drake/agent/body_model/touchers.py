"""Several touchers on one link: points that one chain carries, told apart touch by touch."""

from dataclasses import replace

import numpy as np

from selftouch_drake.agent.body_model.chain import derivatives
from selftouch_drake.agent.body_model.fit import Way
from selftouch_drake.agent.body_model.refine import refined
from selftouch_drake.agent.body_model.scene import Scene, Solution, all_places
from selftouch_drake.agent.body_model.who_touched import expected, metric, started

#: A further point is added only if the negative log-likelihood of held-out labels falls by more,
#: in nats per touch. Measured on one and two fingers: 0.4 for a true one, 0.01 for a false one.
GAIN = 0.05
# Touches on which candidates compete, and on which labels are predicted.
_SOME, _PREDICTED = 8000, 2500


def in_hand(scene: Scene, solution: Solution, rows: np.ndarray, way: Way) -> np.ndarray:
    """`(n, 3)` where a point of the toucher's link must be to touch its kernel's place."""
    joints = np.array([joint for joint, _ in way], dtype=int)
    signs = np.array([sign for _, sign in way], dtype=float)
    origin, _, turn, _ = derivatives(
        scene.q[np.ix_(rows, joints)], solution.twists[joints], np.zeros(3), signs
    )
    away = solution.place[scene.target[rows]] - origin
    return np.einsum("nba,nb->na", turn, away)


def label_loss(scene: Scene, solution: Solution, part: int, counts: np.ndarray) -> float:
    """Mean negative log-likelihood of the labels of held-out touches, nats.

    Args:
        scene: held-out touches.
        solution: of the training touches.
        part: the part that is looked at.
        counts: `(K,)` training touches of each kernel.
    """
    rows = scene.rows(part)
    rows = rows[:: max(1, len(rows) // _PREDICTED)]
    touchers = scene.touchers(part)
    Y = all_places(scene.some(rows), solution.twists, solution.points)[touchers]
    kernels = np.flatnonzero(np.isfinite(solution.place).all(axis=1) & (scene.part == part))
    W = metric(solution.normal[kernels], solution.sigma[part])
    prior = counts[kernels] / counts[kernels].sum()
    log = np.full((len(rows), len(kernels)), -np.inf)
    for index, toucher in enumerate(touchers):
        r = Y[index][:, None] - solution.place[kernels][None]
        far = np.einsum("nka,kab,nkb->nk", r, W, r, optimize=True)
        share = solution.frequency[part, toucher]
        log = np.logaddexp(log, np.log(share + 1e-9) - 0.5 * far + np.log(prior + 1e-12))
    log -= log.max(axis=1, keepdims=True)
    chance = np.exp(log)
    chance /= chance.sum(axis=1, keepdims=True)
    wrong = np.clip(1 - solution.frequency[part].sum(), 0.01, 0.9)
    chance = (1 - wrong) * chance + wrong * prior
    column = np.full(len(scene.part), -1)
    column[kernels] = np.arange(len(kernels))
    own = column[scene.target[rows]]
    known = own >= 0
    return float(-np.log(chance[known, own[known]]).mean())


def candidates(scene: Scene, solution: Solution, part: int, link_of: int) -> list[np.ndarray]:
    """`(U + 1, 3)` points to try, one more than there are, on the link of one of them."""
    way = scene.ways[part, link_of]
    rows = scene.rows(part)
    cloud = in_hand(scene, solution, rows, way)
    kept = np.isfinite(cloud).all(axis=1)
    cloud, outlying = cloud[kept], 1 - solution.share[rows[kept]].sum(axis=1)
    own = solution.points[link_of]
    found = []
    near = np.linalg.norm(cloud - np.median(cloud, axis=0), axis=1)
    close = cloud[near < 3 * np.median(near)]
    axes = np.linalg.svd(close - close.mean(axis=0), full_matrices=False)[2]
    spread = (close - close.mean(axis=0)) @ axes.T
    for axis in range(3):
        for share in (0.7, 1.4):
            step = share * spread[:, axis].std() * axes[axis]
            # The point splits in two.
            split = solution.points.copy()
            split[link_of] = own - step
            found.append(np.concatenate([split, [own + step]]))
    lost = cloud[outlying > 0.5]
    if len(lost) > 30:
        found.append(np.concatenate([solution.points, [_densest(lost)]]))
    doubtful = cloud[outlying > 0.01]
    if len(doubtful) > 30:
        found.append(np.concatenate([solution.points, [_densest(doubtful)]]))
    return found


def _densest(cloud: np.ndarray, most: int = 600) -> np.ndarray:
    some = cloud[:: max(1, len(cloud) // most)]
    squares = np.sort(((some[:, None] - some[None]) ** 2).sum(axis=2), axis=1)
    rank = max(3, len(some) // 20)
    center = some[squares[:, min(rank, len(some) - 1)].argmin()]
    for _ in range(5):
        far = np.linalg.norm(cloud - center, axis=1)
        center = cloud[far <= np.quantile(far, 0.05)].mean(axis=0)
    return center


def with_more(
    scene: Scene, test: Scene, solution: Solution, part: int, most: int, random: np.random.Generator
) -> tuple[Scene, Scene, Solution]:
    """Adds touchers on the same link as long as held-out labels are predicted better.

    Args:
        scene: training touches.
        test: held-out touches.
        solution: with one toucher.
        part: what is touched.
        most: touchers in all.
        random: which touches the candidates compete on.
    """
    counts = np.bincount(scene.target, minlength=len(scene.part))
    loss = label_loss(test, solution, part, counts)
    while len(solution.points) < most:
        some = scene.some(np.sort(random.permutation(len(scene.q))[:_SOME]))
        fewer = started(some, solution.twists, solution.points)
        added = len(solution.points)
        more = {**scene.ways, (part, added): scene.ways[part, 0]}
        trial_scene, best = replace(some, ways=more), None
        for points in candidates(some, fewer, part, 0):
            trial = started(trial_scene, solution.twists, points)
            trial = refined(trial_scene, trial, steps=3)
            value = label_loss(replace(test, ways=more), trial, part, counts)
            if best is None or value < best[0]:
                best = value, trial
        if best is None or best[0] > loss - GAIN:
            break
        trial = refined(trial_scene, best[1], steps=10)
        full = replace(scene, ways=more)
        grown = expected(full, started(full, trial.twists, trial.points), rounds=4)
        value = label_loss(replace(test, ways=more), grown, part, counts)
        if value > loss - GAIN:
            break
        scene, test, solution, loss = full, replace(test, ways=more), grown, value
    return scene, test, solution
