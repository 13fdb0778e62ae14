"""What a skin reads where it is touched: residuals of readings and of the receptors' heights.

The root of a reading falls with the square of the distance along the skin, as in fields of the form
`(1 - (d / R)^2)^2`. Receptors lie on the skin through the touched places: a chord of a smooth
surface is at right angles to the mean of the normals at its ends. Arcs follow from chords and
normals. Unknown are changes of the way, how far the ball sinks in, R, the receptors' places, and
how firm each touch is.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import coo_array, csr_array, hstack

from selftouch_drake.agent.given_model.skin import TouchedSkin
from selftouch_drake.agent.given_model.way import Change, GivenWay

# Readings below this share of a touch's strongest lie where a skin has turned away.
_LEAST_READING = 0.06
# For derivatives by differences, rad or m.
_STEP = 1e-6


@dataclass(slots=True)
class Fields:
    """Residuals of m pairs of a touch and a receptor that feels it: readings, then heights.

    The unknowns v are C changes of the way, softness, log R, 3 S places and n firmnesses.

    Attributes:
        way: as it is given.
        changes: C of it that are looked for.
        skin: the touches.
        touch: `(m,)`.
        receptor: `(m,)`.
        reading: `(m,)` root of the reading, 1 for the strongest of its touch.
        num_receptors: S.
        scales: of the usual residuals, of readings and of heights, m.
    """

    way: GivenWay
    changes: Sequence[Change]
    skin: TouchedSkin
    touch: np.ndarray
    receptor: np.ndarray
    reading: np.ndarray
    num_receptors: int
    scales: tuple[float, float]

    @staticmethod
    def of(
        way: GivenWay,
        changes: Sequence[Change],
        skin: TouchedSkin,
        sensation: np.ndarray,
        scales: tuple[float, float] = (0.02, 0.003),
    ) -> "Fields":
        """For `(n, S)` readings; each row and each column has one above 0."""
        root = np.sqrt(sensation / sensation.max(axis=1, keepdims=True))
        touch, receptor = np.nonzero(root > np.sqrt(_LEAST_READING))
        reading = root[touch, receptor]
        return Fields(way, changes, skin, touch, receptor, reading, root.shape[1], scales)

    def parted(self, v: np.ndarray) -> tuple[np.ndarray, ...]:
        """Amounts of changes, softness, log R, places and firmnesses."""
        amounts, softness, size, places, firm = np.split(
            v, np.cumsum([len(self.changes), 1, 1, 3 * self.num_receptors])
        )
        return amounts, softness[0], size[0], places.reshape(-1, 3), firm

    def start(self) -> np.ndarray:
        """No change, receptors at the mean of what they feel."""
        touched, _ = self.skin.touched(self.way, 0.0)
        weight = csr_array((self.reading**2, (self.receptor, self.touch)))
        places = (weight @ touched) / weight.sum(axis=1)[:, None]
        apart = np.linalg.norm(touched[self.touch] - places[self.receptor], axis=1)
        size = np.log(1.3 * np.quantile(apart, 0.95))
        none = np.zeros(len(self.changes) + 1)
        return np.r_[none, size, places.ravel(), np.full(len(self.skin.q), 1.1)]

    def with_changes(self, v: np.ndarray, changes: Sequence[Change]) -> tuple["Fields", np.ndarray]:
        """The same for other changes, and the unknowns; new ones are 0."""
        amounts = dict(zip(map(_key, self.changes), v, strict=False))
        first = [amounts.get(_key(change), 0.0) for change in changes]
        other = Fields(
            self.way, changes, self.skin, self.touch, self.receptor, self.reading,
            self.num_receptors, self.scales,
        )  # fmt: skip
        return other, np.r_[first, v[len(self.changes) :]]

    def changed(self, v: np.ndarray) -> GivenWay:
        """The way with the changes made."""
        return self.way.changed(self.changes, self.parted(v)[0])

    def residuals(self, v: np.ndarray) -> np.ndarray:
        """`(2 m,)` in units of the usual ones."""
        chord, mean, _, squared, firm = self._parts(v)
        # Weak readings are the less certain: they lie far away.
        first = (self.reading - firm * (1.0 - squared)) * self._certain / self.scales[0]
        second = np.einsum("mx,mx->m", mean, chord) * self.reading**2 / self.scales[1]
        return np.r_[first, second]

    def jacobian(self, v: np.ndarray, now: np.ndarray) -> csr_array:
        """`(2 m, P)`: by differences for what all touches share, else exact."""
        num, m = len(self.changes) + 2, len(self.touch)
        shared = [
            (self.residuals(v + _STEP * np.eye(1, len(v), k)[0]) - now) / _STEP for k in range(num)
        ]
        chord, mean, arc, squared, firm = self._parts(v)
        size, certain = self.parted(v)[2], (self._certain / self.scales[0])[:, None]
        pull = (-2.0 * firm * arc**2 * np.exp(-2.0 * size))[:, None] * certain * chord
        height = -mean * self.reading[:, None] ** 2 / self.scales[1]
        rows = np.repeat(np.arange(2 * m), 3)
        columns = (3 * np.tile(self.receptor, 2)[:, None] + np.arange(3)).ravel()
        places = coo_array(
            (np.concatenate([pull, height]).ravel(), (rows, columns)),
            shape=(2 * m, 3 * self.num_receptors),
        )
        firmness = coo_array(
            ((squared - 1.0) * certain[:, 0], (np.arange(m), self.touch)),
            shape=(2 * m, len(self.skin.q)),
        )
        return hstack([csr_array(np.stack(shared, axis=1)), places, firmness]).tocsr()

    def normal(self, v: np.ndarray, prior: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """The `(P, P)` normal matrix and `(P,)` gradient, with the prior's, and squared residuals.

        The prior is `(P,)` inverse variances of what is expected to be 0. All are of the robust
        loss `2 (sqrt(1 + r^2) - 1)`.
        """
        now = self.residuals(v)
        slope, weight = self.jacobian(v, now), 1.0 / np.hypot(1.0, now)
        matrix = (slope.T @ (slope * weight[:, None])).toarray() + np.diag(prior)
        toward = slope.T @ (weight * now) + prior * self._off(v, prior)
        return matrix, toward, float(np.square(now) @ weight)

    def minimised(self, v: np.ndarray, prior: np.ndarray, steps: int) -> np.ndarray:
        """Levenberg and Marquardt's steps on the robust loss."""

        def loss(v: np.ndarray) -> float:
            off = self._off(v, prior)
            far = np.hypot(1.0, self.residuals(v)) - 1.0
            return float(2.0 * far.sum() + prior @ off**2)

        damping, before = 1e-3, loss(v)
        for _ in range(steps):
            matrix, toward, _ = self.normal(v, prior)
            for _ in range(6):
                damped = matrix + damping * np.diag(np.diag(matrix) + 1e-12)
                step = v - cho_solve(cho_factor(damped), toward)
                if (after := loss(step)) < before:
                    break
                damping *= 10.0
            else:
                return v
            v, gained, before = step, before - after, after
            damping /= 5.0
            if gained < 1e-4 * before:
                break
        return v

    def rescaled(self, v: np.ndarray) -> None:
        """Takes the residuals of now as the usual ones, and looks for neighbours anew."""
        m = len(self.touch)
        off = np.abs(self.residuals(v))
        usual = 1.4826 * np.array([np.median(off[:m]), np.median(off[m:])])
        self.scales = (self.scales[0] * usual[0], self.scales[1] * usual[1])
        self.skin = TouchedSkin(self.skin.q, self.skin.radius, self.skin.force, self.changed(v))

    def _off(self, v: np.ndarray, prior: np.ndarray) -> np.ndarray:
        """How far the unknowns are from what is expected: only changes are expected to be 0."""
        return np.where(np.arange(len(v)) < len(self.changes), v, 0.0) * (prior > 0)

    @property
    def _certain(self) -> np.ndarray:
        return 0.3 / (1.3 - self.reading)

    def _parts(self, v: np.ndarray) -> tuple[np.ndarray, ...]:
        amounts, softness, size, places, firm = self.parted(v)
        way = self.way.changed(self.changes, amounts)
        touched, normals = self.skin.touched(way, float(softness))
        weight = csr_array((self.reading**4, (self.receptor, self.touch)))
        of_receptor = _unit(weight @ normals)
        chord = touched[self.touch] - places[self.receptor]
        ends = normals[self.touch], of_receptor[self.receptor]
        mean = _unit(ends[0] + ends[1])
        half = np.arccos(np.clip(np.einsum("mx,mx->m", *ends), -1.0, 1.0)) / 2.0
        arc = 1.0 / np.sinc(half / np.pi)
        squared = np.square(chord).sum(axis=1) * arc**2 * np.exp(-2.0 * size)
        return chord, mean, arc, squared, firm[self.touch]


def _key(change: Change) -> tuple[int, bool, str]:
    return change.number, change.turns, change.label


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
