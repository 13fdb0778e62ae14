"""Touches, and what explains them: ways of touchers to parts, joints, points, places of kernels.

A `Scene` is what is given, a `Solution` what is found. Places of a scene's touches follow from the
joints and points of a solution; kernels have the places and normals that most of their touches say.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.chain import places, turns
from selftouch_drake.agent.body_model.fit import Way
from selftouch_drake.agent.body_model.support import beside, blended_normals, bulge_slopes, smoothed

#: A hand of so many points of one link is none.
BLUNT = 3
# Neighbouring kernels that give a kernel's normal.
_NEIGHBOURS = 8
# Places lie in a plane if they spread by less across it, relative to their longest spread.
_FLAT = 1e-6


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

    @property
    def blunt(self) -> bool:
        """Whether three points of one link touch, or more: a hand that is no point."""
        number = Counter((part, way) for (part, _), way in self.ways.items())
        return max(number.values(), default=0) >= BLUNT

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


def way_arrays(scene: Scene, twists: np.ndarray, rows: np.ndarray, way: Way):
    """Readings, twists and signs of the joints of a way."""
    joints = np.array([joint for joint, _ in way], dtype=int)
    signs = np.array([sign for _, sign in way], dtype=float)
    return scene.q[np.ix_(rows, joints)], twists[joints], signs


def way_places(
    scene: Scene, twists: np.ndarray, point: np.ndarray, rows: np.ndarray, way: Way
) -> np.ndarray:
    """`(n, 3)` places of a point, or of a point for each, at some touches, along a way."""
    q, twists, signs = way_arrays(scene, twists, rows, way)
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
            turn = turns(*way_arrays(scene, twists, rows, way))
            slopes = bulges(scene, sizes, (part, toucher), found[toucher, rows], turn)
            found[toucher, rows] += slopes @ sizes.shape[toucher]
    return found


def solution_places(scene: Scene, solution: Solution) -> np.ndarray:
    """`(U, R, 3)` as of `all_places`, at a solution of this scene or of other touches."""
    return all_places(scene, solution.twists, solution.points, solution.sizes)


def bulges(
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


def away_from_kernels(Y: np.ndarray, place: np.ndarray, target: np.ndarray) -> np.ndarray:
    """`(n,)` from each touch's kernel to the nearest of the `(U, n, 3)` places of touchers."""
    # The less of two is the one that is known.
    return np.fmin.reduce(np.linalg.norm(Y - place[target], axis=2))


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
