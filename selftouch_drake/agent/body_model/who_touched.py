"""Who touched, and where, at given joints: expectation and maximisation in turn.

Each touch was made by one of the touchers that may reach its part, or is an outlier. From the
probabilities follow the places of kernels and the noise, and from these the probabilities.
"""

import itertools
from dataclasses import replace

import numpy as np

from selftouch_drake.agent.body_model.scene import (
    Scene,
    Solution,
    all_places,
    kernel_medians,
    kernel_sums,
    normals,
    solution_places,
)

# A share of outliers is believed to be at least this large.
_FEWEST_OUTLIERS = 0.002


def started(scene: Scene, twists: np.ndarray, points: np.ndarray) -> Solution:
    """The solution at given joints and points: places, noise and who touched."""
    num_parts, num_kernels = int(scene.part.max()) + 1, len(scene.part)
    solution = Solution(
        twists, points,
        np.zeros((len(scene.q), len(points))),
        np.full((num_kernels, 3), np.nan), np.full((num_kernels, 3), np.nan),
        np.full((num_parts, 2), np.nan), np.zeros((num_parts, len(points))),
        np.full(num_parts, np.nan),
    )  # fmt: skip
    Y = all_places(scene, twists, points)
    for part in scene.parts:
        solution = _started_part(scene, solution, Y, part)
    return expected(scene, solution, rounds=4)


def _started_part(scene: Scene, solution: Solution, Y: np.ndarray, part: int) -> Solution:
    """Who touched, from the densest place of each kernel among all hypotheses."""
    rows = scene.rows(part)
    touchers = scene.touchers(part)
    target, share = scene.target[rows], solution.share.copy()
    if len(touchers) == 1:
        share[rows, touchers[0]] = 1.0
    else:
        share[np.ix_(rows, touchers)] = _densest(Y[touchers][:, rows], target, len(scene.part))
    place = solution.place.copy()
    chosen = touchers[share[np.ix_(rows, touchers)].argmax(axis=1)]
    own = Y[chosen, rows]
    here = scene.part == part
    place[here] = kernel_medians(own, target, len(scene.part))[here]
    far = np.linalg.norm(own - place[target], axis=1)
    middle = np.median(far[far > 0]) if (far > 0).any() else 1.0
    sigma, frequency = solution.sigma.copy(), solution.frequency.copy()
    # 1.54 is the median of the norm of a standard normal vector in space.
    sigma[part] = middle / 1.54
    frequency[part, touchers] = 0.95 * np.maximum(
        np.bincount(chosen, minlength=len(Y))[touchers] / len(rows), 0.02
    )
    return replace(solution, share=share, place=place, sigma=sigma, frequency=frequency)


def _densest(Y: np.ndarray, target: np.ndarray, number: int, most: int = 60) -> np.ndarray:
    """`(n, U)` 1 for the toucher whose place lies nearest to the densest place of the kernel."""
    whiten = np.linalg.cholesky(np.linalg.inv(np.cov(Y.reshape(-1, 3).T)))
    order = np.argsort(target, kind="stable")
    bounds = np.searchsorted(target[order], np.arange(number + 1))
    share = np.zeros((Y.shape[1], len(Y)))
    for start, end in itertools.pairwise(bounds):
        if end == start:
            continue
        rows = order[start:end]
        cloud = Y[:, rows] @ whiten
        some = cloud[:, :: max(1, len(rows) * len(Y) // most)].reshape(-1, 3)
        squares = ((some[:, None] - some[None]) ** 2).sum(axis=2)
        # A touch lies there under one hypothesis in U, if at all.
        rank = max(1, min(len(some) - 1, int(0.4 * len(some) / len(Y))))
        nearest = np.argsort(squares, axis=1)
        densest = np.take_along_axis(squares, nearest, axis=1)[:, rank].argmin()
        mode = some[nearest[densest, : rank + 1]].mean(axis=0)
        far = ((cloud - mode) ** 2).sum(axis=2)
        share[rows, far.argmin(axis=0)] = 1.0
    return share


def metric(normal: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """`(n, 3, 3)` inverse covariances: flat along the normals; round where these are unknown."""
    known = np.isfinite(normal).all(axis=1)
    n = np.where(known[:, None], normal, 0.0)
    across, along = 1 / sigma[0] ** 2, 1 / sigma[1] ** 2
    return across * np.eye(3) + (along - across) * n[:, :, None] * n[:, None, :]


def expected(
    scene: Scene, solution: Solution, rounds: int = 2, Y: np.ndarray | None = None
) -> Solution:
    """Who touched, and from that places and noise, so many times over, at given joints."""
    Y = solution_places(scene, solution) if Y is None else Y
    for turn in range(rounds):
        solution = settled(scene, _shared(scene, solution, Y), Y, fresh_normals=turn == 0)
    return solution


def _shared(scene: Scene, solution: Solution, Y: np.ndarray) -> Solution:
    """The solution with the probabilities of who touched."""
    share = np.zeros_like(solution.share)
    weight = kernel_sums(solution.share.sum(axis=1), scene.target, len(scene.part))
    for part in scene.parts:
        rows = scene.rows(part)
        touchers = scene.touchers(part)
        share[np.ix_(rows, touchers)] = probabilities(
            solution, Y[touchers][:, rows], scene.target[rows], part, touchers, weight
        )
    return replace(solution, share=share)


def probabilities(
    solution: Solution,
    Y: np.ndarray,
    target: np.ndarray,
    part: int,
    touchers: np.ndarray,
    weight: np.ndarray | None = None,
) -> np.ndarray:
    """`(n, U)` probability that each toucher made each touch of a part.

    Args:
        solution: places and noise.
        Y: `(U, n, 3)` places of the touchers.
        target: `(n,)` target sensations.
        part: of all these touches.
        touchers: U indices of touchers.
        weight: `(K,)` touches that made each kernel's place, if these are among them.
    """
    sigma = solution.sigma[part]
    W = metric(solution.normal, sigma)[target]
    frequency = solution.frequency[part][touchers]
    outliers = max(1 - frequency.sum(), _FEWEST_OUTLIERS)
    known = Y.reshape(-1, 3)
    # Outliers spread at least as noise does: a chain in a plane spreads in two dimensions only.
    noise = max(sigma[0] ** 2, 1e-12) * np.eye(3)
    spread = np.linalg.slogdet(np.cov(known[np.isfinite(known).all(axis=1)].T) + noise)[1]
    # One of n touches pulls the mean of n towards itself.
    pull = 1.0 if weight is None else np.maximum(weight[target], 1.0)
    lone = 1.0 if weight is None else pull / np.maximum(pull - 1, 0.2)
    logs = [np.full(len(target), np.log(outliers) - 0.5 * spread - 1.5)]
    for index, places_of_one in enumerate(Y):
        r = places_of_one - solution.place[target]
        far = lone * np.einsum("ni,nij,nj->n", r, W, r)
        volume = 2 * np.log(sigma[0]) + np.log(sigma[1])
        log = np.log(frequency[index] + 1e-9) - 0.5 * far - volume
        logs.append(np.where(np.isfinite(log), log, -np.inf))
    stacked = np.stack(logs, axis=1)
    stacked = np.exp(stacked - stacked.max(axis=1, keepdims=True))
    return stacked[:, 1:] / stacked.sum(axis=1, keepdims=True)


def settled(
    scene: Scene, solution: Solution, Y: np.ndarray, *, fresh_normals: bool = False
) -> Solution:
    """The solution with the best places and noise for its shares."""
    number = len(scene.part)
    share = solution.share
    held = np.einsum("nu,una->na", share, np.nan_to_num(Y))
    mass = kernel_sums(share.sum(axis=1), scene.target, number)
    sums = kernel_sums(held, scene.target, number)
    with np.errstate(invalid="ignore", divide="ignore"):
        fresh = sums / mass[:, None]
    place = np.where((mass > 0.5)[:, None], fresh, solution.place)
    normal = normals(place, scene.part) if fresh_normals else solution.normal
    sigma, frequency = solution.sigma.copy(), solution.frequency.copy()
    criterion = solution.criterion.copy()
    for part in scene.parts:
        rows = scene.rows(part)
        target, own = scene.target[rows], share[rows]
        n = np.nan_to_num(normal[target])
        along = across = 0.0
        total, cloud = own.sum(), []
        for toucher in range(len(Y)):
            if (part, toucher) not in scene.ways:
                continue
            r = np.nan_to_num(Y[toucher, rows] - place[target])
            high = np.einsum("na,na->n", r, n)
            along += (own[:, toucher] * high**2).sum()
            across += (own[:, toucher] * ((r**2).sum(axis=1) - high**2)).sum()
            cloud.append((Y[toucher, rows], own[:, toucher]))
        # Each kernel's mean takes the freedom of one of its touches.
        kernels = (mass[scene.part == part] > 0.5).sum()
        free = max(total - kernels, 1.0)
        sigma[part] = np.sqrt(np.maximum([across / 2 / free, along / free], 1e-12))
        if scene.blunt:
            # What a hand's points leave is as large along normals. Were it less, joints would bend
            # the skin until it is, at the cost of what is across.
            sigma[part] = np.sqrt(max((across + along) / 3 / free, 1e-12))
        frequency[part] = own.mean(axis=0)
        volume = 2 * np.sum(np.log(sigma[part]) * [2, 1])
        criterion[part] = volume - np.linalg.slogdet(total_scatter(cloud)[1])[1]
    return replace(
        solution, place=place, normal=normal, sigma=sigma, frequency=frequency, criterion=criterion
    )


def total_scatter(cloud: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean and covariance of places."""
    Y, weight = np.concatenate([y for y, _ in cloud]), np.concatenate([w for _, w in cloud])
    kept = weight > 1e-6
    Y, weight = Y[kept], weight[kept]
    center = weight @ Y / weight.sum()
    away = Y - center
    return center, (weight[:, None] * away).T @ away / weight.sum() + 1e-12 * np.eye(3)
