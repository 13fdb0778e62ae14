"""Places of receptors and offsets of joints from touches, by robust least squares.

The root of a reading falls with the square of the distance along the skin, as in fields of the form
`(1 - (d / R)^2)^2`. Receptors lie on the skin through the touched places: a chord of a smooth
surface is at right angles to the mean of the normals at its ends. Arcs follow from chords and
normals. Unknown are the offsets, how far the ball sinks in, R, the receptors' places, and how firm
each touch is.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import coo_array, csr_array, hstack

from selftouch_drake.calibration.contacts import ModelledTouches

#: Readings below this share of a touch's strongest lie where a skin has turned away.
_LEAST_READING = 0.06

#: rad or m, an offset is expected within; directions that touches leave wider than the second
#: number cannot be observed.
_EXPECTED, _UNOBSERVABLE = 0.3, 0.05

#: Weight by which unobservable offsets are held.
_HELD = 1e8

#: Residuals are scaled, and neighbours are looked for, so many times; each time steps are taken.
_NUM_ROUNDS, _NUM_STEPS = 8, 12

#: A receptor is suspected whose residuals are so many times the usual ones.
_SUSPECT = 4.0

#: By how much errors exceed what residuals tell, since the model of fields is not exact: measured
#: on a torus and a turning torus, three sets of 300 touches each.
_MODEL_ERROR = 2.4

#: 95 % of a normal distribution is within so many standard deviations.
_QUANTILE = 1.96


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibrated:
    """What least squares found, for J joints and S receptors.

    Attributes:
        offsets: `(J,)` rad or m, to add to joints as they were read.
        offset_interval: `(J,)` half the width of the 95 % interval.
        unobservable: `(g, J)` unit directions of offsets that no touch shows; along them they
            are 0, and all intervals hold as if that were true.
        places: `(S, 3)` m, receptors in the frame of their link.
        place_interval: `(S, 3)` m, half the widths of the 95 % intervals.
        suspect: `(S,)` bool, receptors whose readings do not fit their place.
    """

    offsets: np.ndarray
    offset_interval: np.ndarray
    unobservable: np.ndarray
    places: np.ndarray
    place_interval: np.ndarray
    suspect: np.ndarray


@dataclass(slots=True)
class _Problem:
    """Residuals of pairs of a touch and a receptor that feels it: readings, then heights."""

    contacts: ModelledTouches
    touch: np.ndarray
    receptor: np.ndarray
    reading: np.ndarray
    num_receptors: int
    scales: tuple[float, float] = (0.02, 0.003)

    def parted(self, v: np.ndarray) -> tuple[np.ndarray, ...]:
        """Offsets, softness, log R, places and firmnesses."""
        num = self.contacts.q.shape[1]
        offsets, softness, size, places, firm = np.split(
            v, np.cumsum([num, 1, 1, 3 * self.num_receptors])
        )
        return offsets, softness[0], size[0], places.reshape(-1, 3), firm

    def start(self) -> np.ndarray:
        """Joints as they were read, receptors at the mean of what they feel."""
        num = self.contacts.q.shape[1]
        touched, _ = self.contacts.on_skin(np.zeros(num), 0.0)
        weight = csr_array((self.reading**2, (self.receptor, self.touch)))
        places = (weight @ touched) / weight.sum(axis=1)[:, None]
        apart = np.linalg.norm(touched[self.touch] - places[self.receptor], axis=1)
        size = np.log(1.3 * np.quantile(apart, 0.95))
        return np.r_[np.zeros(num + 1), size, places.ravel(), np.full(len(self.contacts.q), 1.1)]

    def _parts(self, v: np.ndarray) -> tuple[np.ndarray, ...]:
        offsets, softness, size, places, firm = self.parted(v)
        touched, normals = self.contacts.on_skin(offsets, float(softness))
        weight = csr_array((self.reading**4, (self.receptor, self.touch)))
        of_receptor = _unit(weight @ normals)
        chord = touched[self.touch] - places[self.receptor]
        ends = normals[self.touch], of_receptor[self.receptor]
        mean = _unit(ends[0] + ends[1])
        half = np.arccos(np.clip(np.einsum("mx,mx->m", *ends), -1.0, 1.0)) / 2.0
        arc = 1.0 / np.sinc(half / np.pi)
        squared = np.square(chord).sum(axis=1) * arc**2 * np.exp(-2.0 * size)
        return chord, mean, arc, squared, firm[self.touch]

    def residuals(self, v: np.ndarray) -> np.ndarray:
        """`(2 m,)` in units of the usual ones."""
        chord, mean, _, squared, firm = self._parts(v)
        # Weak readings are the less certain: they lie far away.
        first = (self.reading - firm * (1.0 - squared)) * self._certain / self.scales[0]
        second = np.einsum("mx,mx->m", mean, chord) * self.reading**2 / self.scales[1]
        return np.r_[first, second]

    @property
    def _certain(self) -> np.ndarray:
        return 0.3 / (1.3 - self.reading)

    def jacobian(self, v: np.ndarray, now: np.ndarray) -> csr_array:
        """`(2 m, P)`: by differences for what all touches share, else exact."""
        num, m, step = self.contacts.q.shape[1] + 2, len(self.touch), 1e-6
        shared = [
            (self.residuals(v + step * np.eye(1, len(v), k)[0]) - now) / step for k in range(num)
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
            shape=(2 * m, len(self.contacts.q)),
        )
        return hstack([csr_array(np.stack(shared, axis=1)), places, firmness]).tocsr()


def calibrate(contacts: ModelledTouches, sensation: np.ndarray) -> Calibrated:
    """Finds places of receptors in metres, and offsets of joints.

    Args:
        contacts: n touches.
        sensation: `(n, S)` readings; each row and each column has one above 0.
    """
    root = np.sqrt(sensation / sensation.max(axis=1, keepdims=True))
    touch, receptor = np.nonzero(root > np.sqrt(_LEAST_READING))
    problem = _Problem(contacts, touch, receptor, root[touch, receptor], sensation.shape[1])
    num, m = contacts.q.shape[1], len(touch)
    v = problem.start()
    prior = np.zeros(len(v))
    prior[:num] = _EXPECTED**-2
    # Receptors that hardly any touch felt are within a metre of where they are looked for.
    prior[num + 2 :][: 3 * problem.num_receptors] = 1.0
    middle = np.where(np.arange(len(v)) < num, 0.0, v)
    for _ in range(_NUM_ROUNDS):
        v = _minimised(problem, v, np.diag(prior), middle)
        off = np.abs(problem.residuals(v))
        usual = 1.4826 * np.array([np.median(off[:m]), np.median(off[m:])])
        problem.scales = (problem.scales[0] * usual[0], problem.scales[1] * usual[1])
        problem.contacts = replace(contacts, near=problem.parted(v)[0])
    normal = _normal(problem, v, problem.residuals(v), np.diag(prior))[1]
    spread, directions = np.linalg.eigh(np.linalg.inv(normal)[:num, :num])
    unobservable = directions[:, np.sqrt(spread) > _UNOBSERVABLE].T
    # What is unobservable is held at 0.
    held = np.diag(prior)
    held[:num, :num] += _HELD * unobservable.T @ unobservable
    v = _minimised(problem, v, held, middle)
    # Intervals from the residuals that are left, and the usual error of the model: it errs alike in
    # readings of neighbours, so residuals alone make intervals too narrow.
    now = problem.residuals(v)
    _, normal, weight = _normal(problem, v, now, held)
    error = np.square(now) @ weight / max(2 * m - len(v), 1) * _MODEL_ERROR**2
    half = _QUANTILE * np.sqrt(error * np.maximum(np.diag(np.linalg.inv(normal)), 0.0))
    off = np.bincount(receptor, np.square(now[:m])) / np.bincount(receptor)
    offsets, _, _, places, _ = problem.parted(v)
    return Calibrated(
        offsets=offsets,
        offset_interval=half[:num],
        unobservable=unobservable,
        places=places,
        place_interval=half[num + 2 :][: 3 * problem.num_receptors].reshape(-1, 3),
        suspect=np.sqrt(off) > _SUSPECT * np.sqrt(np.median(off)),
    )


def _normal(
    problem: _Problem, v: np.ndarray, now: np.ndarray, prior: np.ndarray
) -> tuple[csr_array, np.ndarray, np.ndarray]:
    """The Jacobian, the `(P, P)` normal matrix with the prior's, and weights of the residuals."""
    slope, weight = problem.jacobian(v, now), 1.0 / np.hypot(1.0, now)
    return slope, (slope.T @ (slope * weight[:, None])).toarray() + prior, weight


def _minimised(
    problem: _Problem, v: np.ndarray, prior: np.ndarray, middle: np.ndarray
) -> np.ndarray:
    """Levenberg and Marquardt's steps on the robust loss `2 (sqrt(1 + r^2) - 1)`."""

    def loss(v: np.ndarray, residuals: np.ndarray) -> float:
        off = v - middle
        return float(2.0 * (np.hypot(1.0, residuals) - 1.0).sum() + off @ prior @ off)

    now, damping = problem.residuals(v), 1e-3
    before = loss(v, now)
    for _ in range(_NUM_STEPS):
        slope, normal, weight = _normal(problem, v, now, prior)
        toward = slope.T @ (weight * now) + prior @ (v - middle)
        for _ in range(6):
            damped = normal + damping * np.diag(np.diag(normal) + 1e-12)
            step = v - cho_solve(cho_factor(damped), toward)
            residuals = problem.residuals(step)
            if (after := loss(step, residuals)) < before:
                break
            damping *= 10.0
        else:
            return v
        v, now, gained, before = step, residuals, before - after, after
        damping /= 5.0
        if gained < 1e-4 * before:
            break
    return v


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
