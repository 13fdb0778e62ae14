"""Few touches: a place on the skin is a smooth function of what is felt there.

A label throws away most of what a sensation says. With few touches, places are taken for draws of
a Gaussian process over sensations: receptors that share in a touch pull its place towards their own
(the linear part), receptors that share touches lie beside each other, and so do touches that feel
alike (the rest). Joints are right if they make the places as smooth as that. The criterion is that
of kernels with the process's precision in place of the scatter within kernels: it has no scale, no
place and no handedness.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.sparse import csr_array
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.body_model.chain import derivatives, places
from selftouch_drake.agent.body_model.standard_errors import gauge

# Shares of receptors are those of readings to this power: less lets weak ones speak too.
_POWER = 0.7
# Weight of the part that is not linear, and variance of noise, relative to the linear part.
_ROUND, _NOISE = 0.1, 0.01
# How far a receptor's place is its own, and not that of receptors that share its touches. From 0.02
# to 0.3 it hardly matters; without this part the same joints had 1.4 times the error from 50
# touches of three cubes, 1.1 times from 100, and as much from 300.
_OWN = 0.1
# A touch far weaker than the median has so many times more noise; at this share of it, a third.
_WEAK_NOISE, _WEAK = 5.0, 0.3
# Added to both scatters, relative to the total variance.
_FLOOR = 1e-9
# Damping of the finish at first, and how often a step is tried.
_DAMPING, _MOST_TRIES = 1e-3, 8
# The finish ends after two steps that gain less.
_CONVERGED = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class Sensed:
    """Sensations of some touches, as the process compares them.

    Attributes:
        share: `(n, S)` share of each receptor.
        noise: `(n,)` variance.
        receptors: `(S, S)` covariance of their places; that of a touch's is 1 in the mean.
        typical: the median of their greatest readings.
    """

    share: np.ndarray
    noise: np.ndarray
    receptors: np.ndarray
    typical: float

    @staticmethod
    def of(sensation: csr_array) -> "Sensed":
        """From `(n, S)` readings."""
        dense = np.maximum(np.asarray(sensation.toarray(), dtype=float), 0)
        typical = max(float(np.median(dense.max(axis=1))), 1e-30)
        share = _shares(dense)
        return Sensed(share, _noise(dense, typical), _beside_each_other(share), typical)

    def some(self, rows: np.ndarray) -> "Sensed":
        """Some of the touches, on the same scale."""
        return Sensed(self.share[rows], self.noise[rows], self.receptors, self.typical)

    def like(self, sensation: csr_array) -> "Sensed":
        """Other touches, `(m, S)` readings, on the scale of these."""
        dense = np.maximum(np.asarray(sensation.toarray(), dtype=float), 0)
        return Sensed(_shares(dense), _noise(dense, self.typical), self.receptors, self.typical)

    def neighbourhoods(self, number: int, random: np.random.Generator) -> np.ndarray:
        """`(n,)` labels of touches that feel alike: at most so many labels."""
        from sklearn.cluster import KMeans  # takes a second, which plans need not wait for

        means = KMeans(min(number, len(self.share)), random_state=int(random.integers(2**31)))
        # Threads add up in any order.
        with threadpool_limits(1):
            return means.fit_predict(np.sqrt(self.share))

    def covariance(self, other: "Sensed") -> np.ndarray:
        """`(n, m)` covariance of places, without noise."""
        linear = self.share @ self.receptors @ other.share.T
        one, two = np.sqrt(self.share), np.sqrt(other.share)
        # Roots of shares are unit vectors: their distance is the angle between sensations.
        squares = 2 * np.maximum(1 - one @ two.T, 0)
        return linear + _ROUND * np.exp(-squares / 2)

    def precision(self, noisier: float = 1.0) -> np.ndarray:
        """`(n, n)` precision of places with their mean taken out, with so many times more noise."""
        noisy = self.covariance(self) + np.diag(noisier * self.noise)
        inverse = scipy.linalg.inv(noisy, check_finite=False)
        inverse = (inverse + inverse.T) / 2
        ones = inverse.sum(axis=1)
        return inverse - np.outer(ones, ones) / ones.sum()

    def predicted(self, place: np.ndarray, other: "Sensed") -> np.ndarray:
        """`(m, 3)` places of other touches, from the `(n, 3)` places of these."""
        noisy = self.covariance(self) + np.diag(self.noise)
        factor = scipy.linalg.cho_factor(noisy, check_finite=False)
        ones = scipy.linalg.cho_solve(factor, np.ones(len(place)))
        middle = ones @ place / ones.sum()
        weight = scipy.linalg.cho_solve(factor, place - middle)
        return middle + other.covariance(self) @ weight

    def unsure(self, other: "Sensed") -> np.ndarray:
        """`(m,)` variance of the places of other touches, noise included, by those of these.

        Relative to the linear part of the process.
        """
        noisy = self.covariance(self) + np.diag(self.noise)
        factor = scipy.linalg.cholesky(noisy, lower=True, check_finite=False)
        across = scipy.linalg.solve_triangular(factor, self.covariance(other), lower=True)
        alone = ((other.share @ self.receptors) * other.share).sum(axis=1) + _ROUND
        return np.maximum(alone - (across**2).sum(axis=0), 0) + other.noise


def _shares(readings: np.ndarray) -> np.ndarray:
    """`(n, S)` shares of receptors in readings, none of which is negative."""
    power = readings**_POWER
    return power / np.maximum(power.sum(axis=1, keepdims=True), 1e-30)


def _beside_each_other(share: np.ndarray) -> np.ndarray:
    """`(S, S)` covariance of receptors' places: those that share in touches lie near each other.

    The inverse of a graph's Laplacian, in which touches join receptors (Smola and Kondor 2003).
    """
    often = np.maximum(share.sum(axis=0), 1e-30)
    joined = share / np.sqrt(often)
    precision = (1 + _OWN) * np.eye(len(often)) - joined.T @ joined
    covariance = scipy.linalg.inv(precision, check_finite=False)
    covariance = (covariance + covariance.T) / 2
    of_touch = ((share @ covariance) * share).sum(axis=1)
    return covariance / max(float(of_touch.mean()), 1e-30)


def _noise(readings: np.ndarray, typical: float) -> np.ndarray:
    """`(n,)` variance: weak touches have more."""
    weak = np.exp(-readings.max(axis=1) / (_WEAK * typical))
    return _NOISE * (1 + _WEAK_NOISE * weak)


@dataclass(frozen=True, slots=True, eq=False)
class SmoothChain:
    """A chain that makes places smooth.

    Attributes:
        twists: `(L, 6)` of its joints, for standardised readings.
        point: `(3,)` of the toucher.
        criterion: lower is better.
    """

    twists: np.ndarray
    point: np.ndarray
    criterion: float


def criterion(place: np.ndarray, precision: np.ndarray) -> float:
    """Log-determinant of the scatter that is not smooth, less that of the total scatter."""
    within, total = _scatters(place, precision @ place)
    return float(np.linalg.slogdet(within)[1] - np.linalg.slogdet(total)[1])


def _scatters(place: np.ndarray, applied: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    away = place - place.mean(axis=0)
    total = away.T @ away / len(place)
    floor = _FLOOR * np.trace(total) * np.eye(3)
    within = place.T @ applied / len(place)
    return (within + within.T) / 2 + floor, total + floor


def finished(
    q: np.ndarray,
    precision: np.ndarray,
    chain: SmoothChain,
    steps: int = 100,
    *,
    slides: np.ndarray | None = None,
    unit: np.ndarray | None = None,
) -> SmoothChain:
    """The chain after a descent with second derivatives (Levenberg and Marquardt).

    Its joints turn or slide: none does both, as a screw would.

    Args:
        q: `(n, L)` standardised readings of the joints of the chain, in its order.
        precision: `(n, n)` of the places.
        chain: where to begin.
        steps: at most.
        slides: `(L,)` bool, joints that do not turn; none by default.
        unit: `(L,)` how far the joints turn by q, all alike but for one factor that is not known;
            NaN for joints that read something else. By default each turns as far as it may.
    """
    turns = np.ones(len(chain.twists), dtype=bool) if slides is None else ~slides
    twists, point = _held(chain.twists, turns, unit), chain.point.copy()
    value = criterion(places(q, twists, point), precision)
    damping, small = _DAMPING, 0
    for _ in range(steps):
        gradient, hessian = _equations(q, precision, twists, point)
        free = _free(twists, turns, unit)
        gradient, hessian = free.T @ gradient, free.T @ hessian @ free
        diagonal = np.diag(hessian) + 1e-12 * np.trace(hessian)
        for _ in range(_MOST_TRIES):
            step = free @ -np.linalg.solve(hessian + damping * np.diag(diagonal), gradient)
            trial_twists = _held(twists + step[:-3].reshape(twists.shape), turns, unit)
            trial_point = point + step[-3:]
            trial = criterion(places(q, trial_twists, trial_point), precision)
            if trial < value:
                break
            damping *= 5
        else:
            break
        gained, value = value - trial, trial
        twists, point = trial_twists, trial_point
        damping = max(damping / 4, 1e-9)
        small = small + 1 if gained < _CONVERGED else 0
        if small >= 2:
            break
    return SmoothChain(twists, point, value)


def spread(
    q: np.ndarray,
    precision: np.ndarray,
    chain: SmoothChain,
    *,
    slides: np.ndarray,
    unit: np.ndarray | None = None,
) -> np.ndarray:
    """`(6 L + 3, 6 L + 3)` covariance of twists and point, without the directions of the gauge.

    That of least squares weighted by the process, which is right as far as the process is.
    """
    _, hessian = _equations(q, precision, chain.twists, chain.point)
    rest = tangent(chain, slides, unit)
    return rest @ np.linalg.inv(rest.T @ hessian @ rest) @ rest.T * (2 / len(q))


def tangent(chain: SmoothChain, slides: np.ndarray, unit: np.ndarray | None = None) -> np.ndarray:
    """`(6 L + 3, p)` orthonormal directions of twists and point that touch can tell.

    Joints turn or, where `(L,)` `slides`, slide; a similarity of all of space changes nothing. With
    a `unit` those that turn do so alike, as in `finished`.
    """
    free = _free(chain.twists, ~slides, unit)
    of_gauge = free.T @ gauge(chain.twists, chain.point[None])
    return free @ scipy.linalg.null_space(of_gauge.T)


def without_pitch(twists: np.ndarray) -> np.ndarray:
    """`(L, 6)` twists that turn without sliding along their axes; those that slide stay."""
    w, v = twists[:, :3], twists[:, 3:]
    square = (w**2).sum(axis=1, keepdims=True)
    pitch = (w * v).sum(axis=1, keepdims=True) / np.maximum(square, 1e-12)
    return np.concatenate([w, v - pitch * w], axis=1)


def _held(twists: np.ndarray, turns: np.ndarray, unit: np.ndarray | None) -> np.ndarray:
    """`(L, 6)` twists without pitch; with a unit, joints that turn do so alike."""
    twists = without_pitch(twists)
    alike = _alike(turns, unit)
    if unit is None or not alike.any():
        return twists
    far = np.linalg.norm(twists[alike, :3], axis=1) / unit[alike]
    # The whole twist: so the axis stays where it is.
    twists[alike] *= (np.exp(np.log(far).mean()) / far)[:, None]
    return twists


def _alike(turns: np.ndarray, unit: np.ndarray | None) -> np.ndarray:
    """`(L,)` bool, joints that turn alike by what they read."""
    return np.zeros_like(turns) if unit is None else turns & np.isfinite(unit)


def _free(twists: np.ndarray, turns: np.ndarray, unit: np.ndarray | None) -> np.ndarray:
    """`(6 L + 3, k)` orthonormal directions in which twists have no pitch, and of the point.

    With a unit, those in which joints that turn do so alike.
    """
    length, alike = len(twists), _alike(turns, unit)
    directions = []
    for joint, twist in enumerate(twists):
        if turns[joint]:
            held = [np.r_[twist[3:], twist[:3]]]
            held += [np.r_[twist[:3], np.zeros(3)]] if alike[joint] else []
        else:
            held = list(np.eye(3, 6))
        own = np.zeros((6 - len(held), 6 * length + 3))
        own[:, 6 * joint : 6 * joint + 6] = np.linalg.svd(held)[2][len(held) :]
        directions.append(own)
    if alike.any():
        farther = np.zeros((1, 6 * length + 3))
        farther[0, :-3].reshape(-1, 6)[alike, :3] = twists[alike, :3]
        directions.append(farther / np.linalg.norm(farther))
    directions.append(np.eye(3, 6 * length + 3, 6 * length))
    return np.concatenate(directions).T


def _equations(
    q: np.ndarray, precision: np.ndarray, twists: np.ndarray, point: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Gradient of the criterion by twists and point, and its Gauss-Newton approximation."""
    place, by_twist, by_point, _ = derivatives(q, twists, point)
    slope = np.concatenate([by_twist.reshape(len(q), 3, -1), by_point], axis=2)
    width = slope.shape[2]
    applied = precision @ place
    within, total = _scatters(place, applied)
    inner, outer = np.linalg.inv(within), np.linalg.inv(total)
    pull = (applied @ inner - (place - place.mean(axis=0)) @ outer) * (2 / len(q))
    gradient = np.einsum("na,nak->k", pull, slope, optimize=True)
    smooth = (precision @ slope.reshape(len(q), -1)).reshape(slope.shape)
    carried = np.einsum("ab,nbk->nak", inner, smooth, optimize=True)
    hessian = slope.reshape(-1, width).T @ carried.reshape(-1, width) * (2 / len(q))
    return gradient, (hessian + hessian.T) / 2
