"""A finish by least squares: damped Gauss-Newton steps on the loss of `descent.py`.

First-order steps creep along the valley in which a hand and the joints before it move together.
Robust costs are reweighted: of a cost rho of a squared residual, a step takes the slope of rho as
weight. All pairs of receptors are looked at, not some that are drawn.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from selftouch_drake.agent.body_model.both_sides import descent
from selftouch_drake.agent.body_model.both_sides.problem import Population, Problem

# Damping at first relative to the diagonal, by how much it changes, and where it ends.
_DAMPING, _LESS, _MORE, _MOST = 1e-2, 0.3, 5.0, 1e6
# The finish ends after a step that gains less than this share, so many times in a row.
_CONVERGED, _STALE = 1e-6, 3
# Below this residual a cost that is linear on one side is taken for square: at its many corners no
# step would go down.
_CORNER = 0.05


def finished(
    problem: Problem,
    one: Population,
    *,
    sigma: float,
    steps: int = 200,
    expected: np.ndarray | None = None,
) -> Population:
    """A body after damped Gauss-Newton steps; the lower of the two by the usual loss.

    Args:
        problem: the recordings.
        one: a population of one.
        sigma: scale of the residuals, in diameters of a contact.
        steps: at most.
        expected: `(P,)` by how much each number is expected to be off; unlimited by default. Axes
            are taken to be of unit length.
    """
    cost = Cost(problem, one.orders[0], sigma)
    row = cost.normed(one.rows[0].astype(float))
    if expected is not None:
        cost.hold(row, expected)
    value, gradient, normal = cost.expanded(row)
    damping, stale = _DAMPING, 0
    for _ in range(steps):
        scale = np.diag(normal) + 1e-6 * np.trace(normal) / len(normal)
        while damping < _MOST:
            step = scipy.linalg.solve(
                normal + damping * np.diag(scale), -gradient, assume_a="pos", check_finite=False
            )
            there = cost.normed(row + step)
            lower = cost.value(there)
            if lower < value:
                break
            damping *= _MORE
        else:
            break
        stale = stale + 1 if value - lower < _CONVERGED * value else 0
        damping = max(damping * _LESS, 1e-9)
        row = there
        if stale >= _STALE:
            break
        value, gradient, normal = cost.expanded(row)
    after = problem.evaluated(row.astype(np.float32)[None], one.orders, sigma)
    return one.together(after).best()


@dataclass(frozen=True, slots=True, eq=False)
class _Slopes:
    """What a part of the cost adds to the gradient and to the matrix of least squares.

    Attributes:
        columns: `(c,)` numbers of a hypothesis.
        gradient: `(c,)`.
        normal: `(c, c)`.
    """

    columns: np.ndarray
    gradient: np.ndarray
    normal: np.ndarray

    @staticmethod
    def of(push: np.ndarray, weight: np.ndarray, columns: np.ndarray, slope: np.ndarray):
        """Residuals: slope of the cost by each, how stiff a step takes it for, and its slopes."""
        normal = (slope * weight[:, None]).T @ slope
        return _Slopes(columns, push @ slope, normal)


@dataclass(frozen=True, slots=True, eq=False)
class _Skin:
    """A skin that is fitted.

    Attributes:
        end: its number.
        basis: `(n, K)`.
        near: `(m, 2)` pairs of receptors with shared touches.
        spacing: `(m,)` logarithm of their distance by the grain.
        trust: `(m,)` what each says of the unit of length.
        weight: `(m,)` of each.
        far: `(k, 2)` pairs that share no touch.
    """

    end: int
    basis: np.ndarray
    near: np.ndarray
    spacing: np.ndarray
    trust: np.ndarray
    weight: np.ndarray
    far: np.ndarray


class Cost:
    """The loss of one hypothesis in double precision, all pairs looked at."""

    def __init__(self, problem: Problem, order: np.ndarray, sigma: float):
        self._problem, self._order, self._sigma = problem, order, sigma
        self._held: tuple[np.ndarray, np.ndarray] | None = None
        data, body = problem.data, problem.body
        self._data, self._num_joints = data, body.num_joints
        self._share = data.share.astype(float)
        self._angle = np.arctan2(data.sin.astype(float), data.cos.astype(float))
        fitted = set(np.flatnonzero(data.number).tolist())
        near, far = 0, 0
        self._skins: list[_Skin] = []
        for end, name in enumerate(body.skins):
            skin = body.skins[name]
            if end in fitted:
                # Pairs by trust, and all pairs alike, as they are drawn.
                weight = (skin.trust + 1 / len(skin.near)) / 2
                own = data.near[near : near + len(skin.near)]
                spacing = data.spacing[near : near + len(skin.near)].astype(float)
                apart = data.far[far : far + len(skin.far)]
                self._skins.append(_Skin(end, skin.basis, own, spacing, skin.trust, weight, apart))
            near, far = near + len(skin.near), far + len(skin.far)

    def hold(self, row: np.ndarray, expected: np.ndarray) -> None:
        """Adds what it costs to leave a hypothesis, by how much each number may be off."""
        self._held = (row.copy(), np.where(np.isfinite(expected), 1 / expected**2, 0.0))

    def normed(self, row: np.ndarray) -> np.ndarray:
        """The same body, its axes of unit length, and as large as its grain says."""
        row = row.copy()
        axes = row[: 3 * self._num_joints].reshape(-1, 3)
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        # Distances are not quite proportional: a tiny one is added to each.
        for _ in range(2):
            row[3 * self._num_joints :] *= np.exp(-self._unit(row)[0])
        return row

    def value(self, row: np.ndarray) -> float:
        """The loss."""
        return sum(cost for cost, _ in self._terms(row, slopes=False))

    def expanded(self, row: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """The loss, its gradient, and the matrix of reweighted least squares, after `normed`.

        A step that makes all larger is undone by `normed`: lengths count relative to the unit.
        """
        total, gradient, normal = 0.0, np.zeros(len(row)), np.zeros((len(row), len(row)))
        for cost, own in self._terms(row, slopes=True):
            total += cost
            if own is not None:
                gradient[own.columns] += own.gradient
                normal[np.ix_(own.columns, own.columns)] += own.normal
        lengths = row.copy()
        lengths[: 3 * self._num_joints] = 0
        unit = self._unit(row)[1]
        moved = np.eye(len(row)) - np.outer(lengths, unit)
        gradient, normal = moved.T @ gradient, moved.T @ normal @ moved
        return total, gradient, normal + 2 * descent.UNIT * np.outer(unit, unit)

    def _unit(self, row: np.ndarray) -> tuple[float, np.ndarray]:
        """Mean logarithm by which skins are larger than their grain, and its slope."""
        mean, slope = 0.0, np.zeros(len(row))
        for skin in self._skins:
            begin, size = self._data.offset[skin.end], self._data.size[skin.end]
            own = slice(begin, begin + 3 * size)
            place = skin.basis @ row[own].reshape(-1, 3)
            off, by = _log_distances(place, skin.near)
            mean += float(skin.trust @ (off - skin.spacing)) / len(self._skins)
            by_place = _by_place(len(place), skin.near, skin.trust[:, None] * by)
            slope[own] += (skin.basis.T @ by_place).ravel() / len(self._skins)
        return mean, slope

    def _terms(self, row: np.ndarray, *, slopes: bool) -> Iterator[tuple[float, _Slopes | None]]:
        for recording in range(len(self._data.ends)):
            yield self._met(row, recording, slopes=slopes)
        for skin in self._skins:
            yield from self._grain(row, skin, slopes=slopes)
        yield self._small(row, slopes=slopes)
        if self._held is not None:
            there, weight = self._held
            columns = np.flatnonzero(weight)
            own, off = weight[columns], (row - there)[columns]
            cost = float((own * off**2).sum())
            yield cost, _Slopes(columns, 2 * own * off, np.diag(2 * own)) if slopes else None

    def _met(
        self, row: np.ndarray, recording: int, *, slopes: bool
    ) -> tuple[float, _Slopes | None]:
        """What touched from what was touched."""
        data = self._data
        some = slice(data.begin[recording], data.begin[recording + 1])
        sides = [
            self._carried(row, data.ends[recording, side], side, some, slopes=slopes)
            for side in range(2)
        ]
        away = sides[0][0] - sides[1][0]
        weight = 2 * data.weight[some].astype(float)
        scaled = (away**2).sum(axis=1) / self._sigma**2
        cost = float((weight * np.log1p(scaled)).sum())
        if not slopes:
            return cost, None
        columns = np.concatenate([sides[0][1], sides[1][1]])
        slope = np.concatenate([sides[0][2], -sides[1][2]], axis=2)
        columns, slope = _summed(columns, slope)
        own = np.repeat(2 * weight / (1 + scaled) / self._sigma**2, 3)
        flat = slope.reshape(-1, slope.shape[2])
        return cost, _Slopes.of(own * away.ravel(), own, columns, flat)

    def _carried(
        self, row: np.ndarray, end: int, side: int, some: slice, *, slopes: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """`(n, 3)` places of an end, the columns that move it, and `(n, 3, c)` slopes by these."""
        data, count = self._data, self._num_joints
        begin, size = int(data.offset[end]), int(data.size[end])
        share = self._share[side, :size, some].T
        point = share @ row[begin : begin + 3 * size].reshape(-1, 3)
        columns = [np.arange(begin, begin + 3 * size)]
        slope = [np.einsum("nk,ab->nakb", share, np.eye(3)).reshape(len(point), 3, -1)]
        for joint in data.way[end, : data.length[end]][::-1].tolist():
            axis = row[3 * joint : 3 * joint + 3]
            centre = row[3 * (count + joint) : 3 * (count + joint) + 3]
            size_of = np.linalg.norm(axis)
            n = axis / size_of
            angle = self._angle[self._order[joint], some]
            sin, rest = np.sin(angle), 1 - np.cos(angle)
            v = point - centre
            along = v @ n
            crossed = _cross_matrix(n)
            turn = (
                np.eye(3) + sin[:, None, None] * crossed + rest[:, None, None] * (crossed @ crossed)
            )
            point = centre + np.einsum("nab,nb->na", turn, v)
            if not slopes:
                continue
            slope = [np.einsum("nab,nbc->nac", turn, one) for one in slope]
            by_axis = -sin[:, None, None] * _cross_matrices(v) + rest[:, None, None] * (
                along[:, None, None] * np.eye(3) + n[:, None] * v[:, None, :]
            )
            # R v = v + sin n x v + (1 - cos) (n (n v) - v (n n)), of which the last is constant.
            by_axis = by_axis @ (np.eye(3) - np.outer(n, n)) / size_of
            columns += [np.arange(3 * joint, 3 * joint + 3)]
            slope.append(by_axis)
            columns += [np.arange(3 * (count + joint), 3 * (count + joint) + 3)]
            slope.append(np.eye(3) - turn)
        return point, np.concatenate(columns), np.concatenate(slope, axis=2)

    def _grain(
        self, row: np.ndarray, skin: _Skin, *, slopes: bool
    ) -> Iterator[tuple[float, _Slopes | None]]:
        """How far distances are off the grain, and how near those lie that share no touch."""
        end, basis = skin.end, skin.basis
        begin, size = int(self._data.offset[end]), int(self._data.size[end])
        columns = np.arange(begin, begin + 3 * size)
        place = basis @ row[columns].reshape(-1, 3)
        number = descent.GRAIN * len(basis)
        off, by = _log_distances(place, skin.near)
        off = off - skin.spacing
        scaled = off / descent.SCATTER
        root = np.sqrt(1 + scaled**2)
        cost = float(number * (skin.weight * (root - 1)).sum())
        weight = number * skin.weight / root / descent.SCATTER**2
        yield (
            cost,
            _of_pairs(basis, skin.near, weight * off, weight, columns, by) if slopes else None,
        )
        if len(skin.far):
            apart, by = _log_distances(place, skin.far)
            lacking = np.maximum(-apart, 0)
            each = descent.TOO_NEAR * number / descent.SCATTER / len(skin.far)
            some = np.flatnonzero(lacking > 0)
            own = lacking[some]
            weight = each / np.maximum(own, _CORNER)
            rows = None
            if slopes:
                pairs, push = skin.far[some], -weight * own
                rows = _of_pairs(basis, pairs, push, weight, columns, by[some])
            rounded = np.where(own < _CORNER, own**2 / (2 * _CORNER), own - _CORNER / 2)
            yield float(each * rounded.sum()), rows

    def _small(self, row: np.ndarray, *, slopes: bool) -> tuple[float, _Slopes | None]:
        """Costs of coefficients and of the points on axes."""
        data, count = self._data, self._num_joints
        weight = np.zeros(len(row))
        for end in np.flatnonzero(data.number):
            begin = int(data.offset[end])
            weight[begin + 3 : begin + 3 * int(data.size[end])] = descent.COEFFICIENT
        for joint in np.flatnonzero(data.used):
            weight[3 * (count + joint) : 3 * (count + joint) + 3] = descent.CENTRE
        columns = np.flatnonzero(weight)
        own, value = weight[columns], row[columns]
        cost = float((own * value**2).sum())
        return cost, _Slopes(columns, 2 * own * value, np.diag(2 * own)) if slopes else None


def _log_distances(place: np.ndarray, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`(m,)` logarithms of distances, and `(m, 3)` slopes by the first place of each pair."""
    away = place[pairs[:, 0]] - place[pairs[:, 1]]
    distance = np.sqrt((away**2).sum(axis=1) + 1e-12)
    return np.log(distance + 1e-3), away / (distance * (distance + 1e-3))[:, None]


def _by_place(number: int, pairs: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """`(n, 3)` sums of slopes `(m, 3)` by the first place of each pair; the second has minus it."""
    return np.stack(
        [
            np.bincount(pairs[:, 0], one, number) - np.bincount(pairs[:, 1], one, number)
            for one in slope.T
        ],
        axis=1,
    )


def _of_pairs(
    basis: np.ndarray,
    pairs: np.ndarray,
    push: np.ndarray,
    weight: np.ndarray,
    columns: np.ndarray,
    by: np.ndarray,
) -> _Slopes:
    """What pairs of places add: a Laplacian over places for each two directions.

    Args:
        basis: `(n, K)`.
        pairs: `(m, 2)`.
        push: `(m,)` slope of the cost by each residual.
        weight: `(m,)` how stiff a step takes it for.
        columns: `(3 K,)`.
        by: `(m, 3)` slope of each residual by its first place.
    """
    number, size = basis.shape
    gradient = basis.T @ _by_place(number, pairs, push[:, None] * by)
    normal = np.empty((size, 3, size, 3))
    flat = pairs[:, 0].astype(np.int64) * number + pairs[:, 1]
    for first in range(3):
        for second in range(first, 3):
            own = np.bincount(flat, weight * by[:, first] * by[:, second], number**2)
            own = own.reshape(number, number)
            own = own + own.T
            laplacian = np.diag(own.sum(axis=1)) - own
            normal[:, first, :, second] = normal[:, second, :, first] = basis.T @ laplacian @ basis
    return _Slopes(columns, gradient.ravel(), normal.reshape(3 * size, 3 * size))


def _summed(columns: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes `(n, 3, c)` by distinct columns."""
    own, where = np.unique(columns, return_inverse=True)
    if len(own) == len(columns):
        return columns, slope
    total = np.zeros((*slope.shape[:2], len(own)))
    for one, column in enumerate(where.ravel().tolist()):
        total[:, :, column] += slope[:, :, one]
    return own, total


def _cross_matrix(vector: np.ndarray) -> np.ndarray:
    return _cross_matrices(vector[None])[0]


def _cross_matrices(vectors: np.ndarray) -> np.ndarray:
    """`(n, 3, 3)`: times a vector, these are cross products with it."""
    x, y, z = vectors.T
    zero = np.zeros(len(vectors))
    return np.stack(
        [
            np.stack([zero, -z, y], axis=1),
            np.stack([z, zero, -x], axis=1),
            np.stack([-y, x, zero], axis=1),
        ],
        axis=1,
    )
