"""The next touches that teach most: half for the joints, half for the skin.

The touches that tell most about the joints crowd where the arm is stretched, and teach nothing of
the skin; those that lie farthest from others on the skin tell less about the joints. So half of a
batch is taken by each rule. All lie on the skin as it is known, in postures near those lived.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.known_chain import KnownChain, spread_out

# Postures from which a batch is chosen.
_TRIED = 1500
# Touches beside one through which the skin is laid, of those that are not too light; and how far
# along it the next touch lies at most, in their distances.
_BESIDE, _LIGHT, _FARTHEST = 12, 0.5, 1.5
# How little the skin bends by itself.
_DAMPED = 0.1
# Touches beside a place, near one of whose postures the next posture lies.
_LIVED = 12
# How far a posture may be from the lived one, standard deviation in those of the joints.
_AWAY = 0.5
# A posture reaches a place if it comes nearer than this share of the skin's radius.
_REACHED = 0.02
# Variance of the mean of all places, and relative lengths that are tried for the process.
_MEAN, _LENGTHS = 100.0, 0.05 * 1.15 ** np.arange(20)
# Touches from which a length is chosen, and postures whose places are to be known.
_COMPARED, _TO_KNOW = 300, 500


@dataclass(frozen=True, slots=True, eq=False)
class Reachable:
    """Postures that touch, as far as a chain knows.

    Attributes:
        q: `(m, J)` readings.
        place: `(m, 3)` where the toucher is.
        inner: `(m, 3)` places beneath the skin: on the way there the toucher meets it for sure.
    """

    q: np.ndarray
    place: np.ndarray
    inner: np.ndarray

    def some(self, rows: np.ndarray) -> "Reachable":
        """Some of them."""
        return Reachable(self.q[rows], self.place[rows], self.inner[rows])


def next_touches(
    known: KnownChain,
    number: int,
    random: np.random.Generator,
    *,
    lower: np.ndarray,
    upper: np.ndarray,
    planned: np.ndarray | None = None,
) -> Reachable:
    """The postures that teach most.

    Args:
        known: the chain, with the touches so far.
        number: of postures.
        random: source of randomness.
        lower: `(J,)` lower limits of the joints.
        upper: `(J,)` upper limits.
        planned: `(n, 3)` places of touches that are on the way; none by default.
    """
    tried = reachable(known, _TRIED, random, lower, upper)
    for_joints = informative(known, tried.q, number // 2, random)
    there = [known.places(known.q), tried.place[for_joints]]
    if planned is not None:
        there.append(planned)
    far = spread_out(tried.place, number - len(for_joints), np.concatenate(there))
    return tried.some(np.concatenate([for_joints, far]))


def reachable(
    known: KnownChain,
    number: int,
    random: np.random.Generator,
    lower: np.ndarray,
    upper: np.ndarray,
) -> Reachable:
    """Postures that should touch: at places beside firm touches, near postures of others there.

    Args:
        known: the chain, with the touches so far.
        number: of postures, at most.
        random: source of randomness.
        lower: `(J,)` lower limits of the joints.
        upper: `(J,)` upper limits.
    """
    all_places = known.places(known.q)
    firm = np.flatnonzero(known.strength >= np.quantile(known.strength, _LIGHT))
    skin = _patches(all_places[firm])
    one = random.integers(len(firm), size=number)
    turn = random.uniform(0, 2 * np.pi, number)
    step = random.uniform(0, _FARTHEST, number) * skin.size[one]
    wanted = skin.beside(one, step[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1))
    # As far above the patch as some touch beside it: at an edge no paraboloid lies on the skin.
    like = skin.rough[one, random.integers(skin.rough.shape[1], size=number)]
    wanted = wanted + like[:, None] * skin.axes[one, 2]
    there = skin.holds(wanted)
    wanted, one = wanted[there], one[there]
    number = len(one)
    inner = skin.place[one] - skin.size[one, None] * skin.axes[one, 2]
    beside = cKDTree(all_places).query(wanted, k=min(_LIVED, len(all_places)))[1]
    lived = known.q[beside[np.arange(number), random.integers(beside.shape[1], size=number)]]
    away = _AWAY * known.scale * random.standard_normal(lived.shape)
    q = known.put((lived + away).clip(lower, upper), wanted, lower, upper)
    at = known.places(q)
    reached = np.linalg.norm(at - wanted, axis=1) < _REACHED * known.radius
    return Reachable(q[reached], at[reached], inner[reached])


@dataclass(frozen=True, slots=True, eq=False)
class _Patches:
    """The skin about each of n places: a paraboloid through its neighbours.

    Attributes:
        place: `(n, 3)`.
        axes: `(n, 3, 3)` two directions along the skin, and the one outwards, as rows.
        bend: `(n, 5)` of u, v, u u, u v and v v in the height above the place.
        size: `(n,)` median distance to the neighbours.
        rough: `(n, k)` how far the neighbours lie above the paraboloid.
    """

    place: np.ndarray
    axes: np.ndarray
    bend: np.ndarray
    size: np.ndarray
    rough: np.ndarray

    def beside(self, one: np.ndarray, along: np.ndarray) -> np.ndarray:
        """`(m, 3)` places `(m, 2)` along the skin from some."""
        height = np.einsum("ni,ni->n", _powers(along), self.bend[one])
        flat = np.concatenate([along, height[:, None]], axis=1)
        return self.place[one] + np.einsum("na,nab->nb", flat, self.axes[one])

    def holds(self, place: np.ndarray) -> np.ndarray:
        """`(m,)` whether the patch of the nearest place lies at `(m, 3)` places, as rough as it is.

        Far from its place a patch leaves the skin, and may meet that of another.
        """
        near = cKDTree(self.place).query(place)[1]
        local = np.einsum("ma,mba->mb", place - self.place[near], self.axes[near])
        height = np.einsum("mi,mi->m", _powers(local[:, :2]), self.bend[near])
        return np.abs(local[:, 2] - height) <= np.abs(self.rough[near]).max(axis=1)


def _patches(place: np.ndarray) -> _Patches:
    """Of `(n, 3)` places."""
    near = cKDTree(place).query(place, k=min(_BESIDE + 1, len(place)))[1][:, 1:]
    away = place[near] - place[:, None]
    about = away - away.mean(axis=1, keepdims=True)
    axes = np.linalg.eigh(np.einsum("nka,nkb->nab", about, about))[1].swapaxes(1, 2)[:, ::-1]
    side = np.einsum("na,na->n", axes[:, 2], place - place.mean(axis=0))
    axes = np.concatenate([axes[:, :2], axes[:, 2:] * np.where(side < 0, -1, 1)[:, None, None]], 1)
    local = np.einsum("nka,nba->nkb", away, axes)
    size = np.median(np.linalg.norm(away, axis=2), axis=1)
    A = _powers(local[:, :, :2])
    # Weakly bent, unless the neighbours say otherwise.
    scale = np.stack([size, size, size**2, size**2, size**2], axis=1)
    A = A / scale[:, None]
    square = np.einsum("nki,nkj->nij", A, A) + _DAMPED * np.eye(5)
    bend = np.linalg.solve(square, np.einsum("nki,nk->ni", A, local[:, :, 2])[:, :, None])[:, :, 0]
    rough = local[:, :, 2] - np.einsum("nki,ni->nk", A, bend)
    return _Patches(place, axes, bend / scale, size, rough)


def _powers(along: np.ndarray) -> np.ndarray:
    """`(..., 5)` u, v, u u, u v and v v."""
    u, v = along[..., 0], along[..., 1]
    return np.stack([u, v, u * u, u * v, v * v], axis=-1)


def informative(
    known: KnownChain, q: np.ndarray, number: int, random: np.random.Generator
) -> np.ndarray:
    """`(number,)` of `(m, J)` postures: touches there make the places of all postures surest.

    An optimal design, one touch after the other (Fedorov 1972, criterion I). Where a touch lies on
    the skin is a Gaussian process, as in the fit; so touches beside each other tell little.
    """
    place, slope = known.slopes(known.q)
    at, slope_at = known.slopes(q)
    root = _inverse_root(known, place)
    slope, slope_at = (np.einsum("ab,nbp->nap", root, some) for some in (slope, slope_at))
    length = _length(known, place)
    noise = known.sensed.noise
    factor = scipy.linalg.cholesky(
        _alike(place, place, length) + np.diag(noise), lower=True, check_finite=False
    )
    across = scipy.linalg.solve_triangular(factor, _alike(place, at, length), lower=True)
    width = slope.shape[2]
    flat = scipy.linalg.solve_triangular(factor, slope.reshape(len(slope), -1), lower=True)
    # What a touch says of the parameters beside those before it, and how unsure its place is.
    fresh = slope_at - (across.T @ flat).reshape(-1, 3, width)
    least = float(np.median(noise))
    variance = 1 + _MEAN + least - (across**2).sum(axis=0)
    rows = flat.reshape(-1, width)
    information = rows.T @ rows
    ridge = 1e-9 * np.trace(information) / width * np.eye(width)
    covariance = np.linalg.inv(information + ridge)
    matters = _what_matters(known, random)
    chosen: list[int] = []
    before = np.zeros((0, len(q)))
    for _ in range(min(number, len(q))):
        own = fresh / np.sqrt(variance)[:, None, None]
        carried = own @ covariance
        square = np.eye(3) + np.einsum("nap,nbp->nab", carried, own)
        gained = np.einsum("nap,nbp->nab", carried @ matters, carried)
        gain = np.trace(np.linalg.solve(square, gained), axis1=1, axis2=2)
        gain[chosen] = -np.inf
        best = int(gain.argmax())
        chosen.append(best)
        covariance -= carried[best].T @ np.linalg.solve(square[best], carried[best])
        beside = _alike(at, at[[best]], length)[:, 0]
        beside -= across.T @ across[:, best] + before.T @ before[:, best]
        beside /= np.sqrt(variance[best])
        fresh = fresh - beside[:, None, None] * own[best]
        variance = np.maximum(variance - beside**2, least)
        before = np.vstack([before, beside])
    return np.array(chosen, dtype=int)


def _inverse_root(known: KnownChain, place: np.ndarray) -> np.ndarray:
    """`(3, 3)` that makes errors of places alike in all directions."""
    rough = place.T @ known.sensed.precision() @ place / len(place)
    values, vectors = np.linalg.eigh((rough + rough.T) / 2)
    return vectors @ np.diag(np.maximum(values, 1e-12 * values.max()) ** -0.5) @ vectors.T


def _length(known: KnownChain, place: np.ndarray) -> float:
    """The distance at which places are as alike as their sensations are."""
    some = slice(_COMPARED)
    sensed = known.sensed.some(np.arange(len(place))[some])
    alike = sensed.covariance(sensed)
    alike /= np.diag(alike).mean()
    place = place[some]
    radius = np.sqrt(place.var(axis=0).sum())
    square = ((place[:, None] - place[None]) ** 2).sum(axis=2)
    lengths = radius * _LENGTHS
    off = [((np.exp(-square / (2 * one**2)) - alike) ** 2).sum() for one in lengths]
    return float(lengths[int(np.argmin(off))])


def _alike(one: np.ndarray, other: np.ndarray, length: float) -> np.ndarray:
    """`(n, m)` covariance of places, relative to that of a single one about the mean."""
    square = (one**2).sum(axis=1)[:, None] + (other**2).sum(axis=1) - 2 * one @ other.T
    return np.exp(-np.maximum(square, 0) / (2 * length**2)) + _MEAN


def _what_matters(known: KnownChain, random: np.random.Generator) -> np.ndarray:
    """`(p, p)` how parameters move the places of postures lived, but for similarities."""
    some = random.integers(len(known.q), size=_TO_KNOW)
    place, slope = known.slopes(known.q[some])
    alike = np.zeros((len(place), 3, 7))
    for axis in range(3):
        alike[:, :, axis] = np.cross(np.eye(3)[axis], place)
        alike[:, axis, 3 + axis] = 1.0
    alike[:, :, 6] = place
    of_space = alike.reshape(-1, 7)
    moved = slope.reshape(len(of_space), -1)
    moved = moved - of_space @ np.linalg.lstsq(of_space, moved, rcond=None)[0]
    return moved.T @ moved / len(place)
