"""The least-squares finish: joints, points of touchers and places of kernels together.

Each touch was made by one of the touchers that may reach its part, or is an outlier. Noise is as it
is: a kernel is flat along the skin's normal, so residuals along normals weigh more. Its places are
free, one for each kernel whoever touched it, and eliminated: at given joints the best place is a
weighted mean. What is minimised is, over parts, the logarithm of the noise's volume less that of
the total scatter, which has no scale.
"""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.chain import adjoint, derivatives, places, turns
from selftouch_drake.agent.body_model.fit import Way
from selftouch_drake.agent.body_model.support import (
    beside,
    blended_normals,
    bulge_slopes,
    shape_moved,
    smoothed,
)

# Neighbouring kernels that give a kernel's normal.
_NEIGHBOURS = 8
# Places lie in a plane if they spread by less across it, relative to their longest spread.
_FLAT = 1e-6
# Damping of the Gauss-Newton steps, relative to the largest eigenvalue, and how often it grows.
_DAMPING, _MOST_TRIES = 1e-7, 6
# A share of outliers is believed to be at least this large.
_FEWEST_OUTLIERS = 0.002


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Touches of all parts, and which way each toucher reaches each part.

    Attributes:
        q: `(R, J)` standardised readings.
        target: `(R,)` target sensation of each touch.
        part: `(K,)` part of each target sensation.
        ways: way of each pair of part and toucher that may touch.
    """

    q: np.ndarray
    target: np.ndarray
    part: np.ndarray
    ways: Mapping[tuple[int, int], Way]

    @property
    def num_touchers(self) -> int:
        """Touchers that any part meets."""
        return 1 + max(toucher for _, toucher in self.ways)

    @property
    def parts(self) -> list[int]:
        """Parts that a toucher reaches, and that touches met."""
        met = set(self.part[self.target].tolist())
        return sorted({part for part, _ in self.ways} & met)

    def touchers(self, part: int) -> np.ndarray:
        """Touchers that may touch a part."""
        return np.array(sorted(u for p, u in self.ways if p == part), dtype=int)

    def rows(self, part: int) -> np.ndarray:
        """Touches of a part."""
        return np.flatnonzero(self.part[self.target] == part)

    def some(self, rows: np.ndarray) -> "Scene":
        """The same scene with some of its touches."""
        return replace(self, q=self.q[rows], target=self.target[rows])


@dataclass(frozen=True, slots=True, eq=False)
class Sizes:
    """Surfaces of touchers, and the skin that they meet, which tells where on them they touch.

    Attributes:
        shape: `(U, 5)` support functions over `SHAPE_BASIS`, in the frame of all at standardised
            readings of 0; zeros for a point.
        sized: `(U,)` bool, touchers that are no points: the others keep zeros.
        place: `(K, 3)` places of kernels.
        normal: `(K, 3)` outward normals of the skin; NaN where unknown.
        near: `(K, N)` as of `beside`.
    """

    shape: np.ndarray
    sized: np.ndarray
    place: np.ndarray
    normal: np.ndarray
    near: np.ndarray

    @staticmethod
    def of(shape, sized, place, normal, part) -> "Sizes":
        """With the neighbours of kernels, among which normals are smoothed."""
        near = beside(place, part)
        return Sizes(shape, sized, place, smoothed(normal, near), near)


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Joints, points and places, and who touched.

    Attributes:
        twists: `(J, 6)` for standardised readings.
        points: `(U, 3)` touchers.
        share: `(R, U)` probability that each toucher made each touch; the rest is that of an
            outlier.
        place: `(K, 3)` places of kernels; NaN where nothing was met.
        normal: `(K, 3)` of the skin, without a side; NaN likewise.
        sigma: `(P, 2)` noise of each part across and along the normal; NaN where nothing was met.
        frequency: `(P, U)` share of the part's touches that each toucher made.
        criterion: `(P,)` logarithm of the noise's volume less that of the total scatter.
        sizes: surfaces of the touchers; None: all are points.
    """

    twists: np.ndarray
    points: np.ndarray
    share: np.ndarray
    place: np.ndarray
    normal: np.ndarray
    sigma: np.ndarray
    frequency: np.ndarray
    criterion: np.ndarray
    sizes: Sizes | None = None

    def inliers(self, scene: Scene, part: int) -> float:
        """Share of a part's touches that are no outliers."""
        rows = scene.rows(part)
        return float(self.share[rows].sum(axis=1).mean()) if len(rows) else np.nan


def _way_arrays(scene: Scene, twists: np.ndarray, rows: np.ndarray, way: Way):
    """Readings, twists and signs of the joints of a way."""
    joints = np.array([joint for joint, _ in way], dtype=int)
    signs = np.array([sign for _, sign in way], dtype=float)
    return scene.q[np.ix_(rows, joints)], twists[joints], signs


def way_places(
    scene: Scene, twists: np.ndarray, point: np.ndarray, rows: np.ndarray, way: Way
) -> np.ndarray:
    """`(n, 3)` places of a point, or of a point for each, at some touches, along a way."""
    q, twists, signs = _way_arrays(scene, twists, rows, way)
    return places(q, twists, point, signs)


def all_places(
    scene: Scene, twists: np.ndarray, points: np.ndarray, sizes: Sizes | None = None
) -> np.ndarray:
    """`(U, R, 3)` places of all touchers; NaN where a toucher does not reach a part.

    The place of a toucher with a size is the centre of a ball that touches the skin where it does.
    """
    found = np.full((len(points), len(scene.q), 3), np.nan)
    for (part, toucher), way in scene.ways.items():
        rows = scene.rows(part)
        found[toucher, rows] = way_places(scene, twists, points[toucher], rows, way)
        if sizes is not None and sizes.sized[toucher]:
            turn = turns(*_way_arrays(scene, twists, rows, way))
            slopes = _bulges(scene, sizes, (part, toucher), found[toucher, rows], turn)
            found[toucher, rows] += slopes @ sizes.shape[toucher]
    return found


def solution_places(scene: Scene, solution: Solution) -> np.ndarray:
    """`(U, R, 3)` as of `all_places`, at a solution of this scene or of other touches."""
    return all_places(scene, solution.twists, solution.points, solution.sizes)


def _bulges(
    scene: Scene, sizes: Sizes, pair: tuple[int, int], center: np.ndarray, turn: np.ndarray
) -> np.ndarray:
    """`(n, 3, 5)` derivatives of places by a toucher's shape, where it meets the skin.

    Args:
        scene: whose kernels these are.
        sizes: of the touchers.
        pair: part and toucher.
        center: `(n, 3)` places of the toucher's centre.
        turn: `(n, 3, 3)` rotation of its link.
    """
    part, toucher = pair
    place = np.where((scene.part == part)[:, None], sizes.place, np.nan)
    at, slopes = center, np.zeros((len(center), 3, 5))
    # Where it touches depends on its shape, and the other way round.
    for _ in range(2):
        normal = blended_normals(place, sizes.normal, sizes.near, at)
        slopes = turn @ bulge_slopes(-np.einsum("nba,nb->na", turn, normal))
        at = center + slopes @ sizes.shape[toucher]
    return slopes


def kernel_sums(values: np.ndarray, target: np.ndarray, number: int) -> np.ndarray:
    """Sums of `(n, ...)` values over the touches of each kernel."""
    flat = values.reshape(len(values), int(np.prod(values.shape[1:])))
    sums = [np.bincount(target, weights=flat[:, k], minlength=number) for k in range(flat.shape[1])]
    return np.stack(sums, axis=1).reshape(number, *values.shape[1:])


def kernel_medians(Y: np.ndarray, target: np.ndarray, number: int, least: int = 1) -> np.ndarray:
    """`(K, 3)` medians of places over the touches of each kernel; NaN with fewer than `least`."""
    found = np.full((number, 3), np.nan)
    kept = np.isfinite(Y).all(axis=1)
    Y, target = Y[kept], target[kept]
    count = np.bincount(target, minlength=number)
    start = np.concatenate([[0], np.cumsum(count)])[:-1]
    for axis in range(3):
        ordered = Y[np.lexsort((Y[:, axis], target)), axis]
        has = count >= max(least, 1)
        low = ordered[start[has] + (count[has] - 1) // 2]
        found[has, axis] = (low + ordered[start[has] + count[has] // 2]) / 2
    return found


def neighbour_distance(place: np.ndarray) -> float:
    """The median distance from each of the `(n, 3)` known places to the nearest other."""
    return float(np.median(cKDTree(place).query(place, k=2)[0][:, 1]))


def normals(place: np.ndarray, part: np.ndarray) -> np.ndarray:
    """`(K, 3)` normals of planes through the neighbours of each kernel, without a side."""
    found = np.full(place.shape, np.nan)
    for number in np.unique(part):
        kernels = np.flatnonzero((part == number) & np.isfinite(place).all(axis=1))
        if len(kernels) < 4:
            continue
        near = cKDTree(place[kernels]).query(place[kernels], k=min(_NEIGHBOURS + 1, len(kernels)))[
            1
        ]
        around = place[kernels][near]
        around = around - around.mean(axis=1, keepdims=True)
        size = np.linalg.svd(place[kernels] - place[kernels].mean(axis=0), compute_uv=False)
        # In a plane the skin is a line, and its normal lies in the plane.
        flat = size[2] < _FLAT * size[0]
        found[kernels] = np.linalg.svd(around, full_matrices=False)[2][:, 1 if flat else 2]
    return found


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
        frequency[part] = own.mean(axis=0)
        volume = 2 * np.sum(np.log(sigma[part]) * [2, 1])
        criterion[part] = volume - np.linalg.slogdet(_total(cloud)[1])[1]
    return replace(
        solution, place=place, normal=normal, sigma=sigma, frequency=frequency, criterion=criterion
    )


def _total(cloud: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean and covariance of places."""
    Y, weight = np.concatenate([y for y, _ in cloud]), np.concatenate([w for _, w in cloud])
    kept = weight > 1e-6
    Y, weight = Y[kept], weight[kept]
    center = weight @ Y / weight.sum()
    away = Y - center
    return center, (weight[:, None] * away).T @ away / weight.sum() + 1e-12 * np.eye(3)


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
                    *_slopes(scene, solution, kept, part, toucher),
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
        center, total = _total([(y, weight) for _, weight, y, *_ in solved])
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


def _slopes(scene, solution, rows, part, toucher):
    """Places, `(n, 3, m)` derivatives by m parameters, and the `(m,)` columns of these."""
    way = scene.ways[part, toucher]
    arrays = _way_arrays(scene, solution.twists, rows, way)
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
    by_shape = _bulges(scene, sizes, (part, toucher), places(q, twists, point, signs), turn)
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
