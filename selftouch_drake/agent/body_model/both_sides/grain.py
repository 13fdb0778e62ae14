"""The grain of a skin: how far apart its receptors are, as told by the touches that they share.

A contact is a patch. Two receptors at the distance d feel the same patch of the diameter D in a
share of touches that falls from 1 to 0 as d grows from 0 to D. The cosine of their touches over two
discs is nearly straight in d / D; measured on four skins of a robot it is straight within the
scatter of single pairs, a factor of 1.7. Since a contact is as wide on one skin as on the other, D
is one unit for all skins that touch each other: it is the unit of length of the whole body.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import shortest_path

# Receptors felt less often than this are left out; pairs of those felt less often say nothing.
_FEWEST_FELT, _FEWEST_OF_PAIR, _FEWEST_OF_FAR = 3, 5, 8
# Above this cosine two receptors are near, below that one they are apart by a contact or more.
_NEAR, _FAR = 0.15, 0.02
# What receptors of one place still disagree by, in diameters: no two are felt always together.
_FLOOR = 0.1
# Neighbours of a receptor along which distances of the first map are added up.
_NEIGHBOURS = 8
# How much less a finer pattern of places is expected to vary.
_SMOOTHING = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Skin:
    """What touches alone say of one skin. Lengths are in diameters of a contact.

    Attributes:
        receptor: `(n,)` index of the receptors that were felt often enough.
        felt: `(n,)` how often.
        basis: `(n, K)` places are `basis @ coefficients`: a constant, then the smoothest patterns
            of shared touches, each as large as it is expected to vary.
        near: `(m, 2)` pairs of receptors with shared touches.
        spacing: `(m,)` their distance, as shared touches tell it.
        trust: `(m,)` how often they were felt, relative to all pairs: sums up to 1.
        far: `(k, 2)` pairs without shared touches.
        first: `(n, 3)` a first map of the skin; NaN for receptors that it leaves out.
    """

    receptor: np.ndarray
    felt: np.ndarray
    basis: np.ndarray
    near: np.ndarray
    spacing: np.ndarray
    trust: np.ndarray
    far: np.ndarray
    first: np.ndarray

    def shares(self, active: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`(t, K)` mean basis of the receptors felt by each touch, and `(t,)` whether any was.

        Args:
            active: `(t, S)` whether a receptor felt the touch.
        """
        own = active[:, self.receptor].astype(float)
        number = own.sum(axis=1)
        return own @ self.basis / np.maximum(number, 1)[:, None], number > 0


def distance_of_shared(cosine: np.ndarray) -> np.ndarray:
    """Distance of two receptors in diameters of a contact, from the cosine of their touches."""
    return 1 + _FLOOR - cosine


def learned_skin(active: np.ndarray, size: int = 20) -> Skin:
    """What touches say of a skin.

    Args:
        active: `(t, S)` whether a receptor felt the touch.
        size: patterns of which places are made, the constant included.

    Raises:
        ValueError: fewer than five receptors were felt three times.
    """
    felt = active.sum(axis=0)
    receptor = np.flatnonzero(felt >= _FEWEST_FELT)
    if len(receptor) < 5:
        raise ValueError(
            f"only {len(receptor)} receptors were felt {_FEWEST_FELT} times or more: "
            "5 are needed; record more touches"
        )
    own, felt = active[:, receptor].astype(float), felt[receptor]
    cosine = own.T @ own / np.sqrt(np.outer(felt, felt))
    first, second = np.triu_indices(len(receptor), 1)
    shared = cosine[first, second]
    seldom = np.minimum(felt[first], felt[second])
    is_near = (shared > _NEAR) & (seldom >= _FEWEST_OF_PAIR)
    is_far = (shared < _FAR) & (seldom >= _FEWEST_OF_FAR)
    near = np.column_stack([first, second])[is_near]
    spacing = distance_of_shared(shared[is_near])
    trust = np.sqrt(felt[near].prod(axis=1))
    return Skin(
        receptor=receptor, felt=felt, basis=_basis(cosine, size), near=near, spacing=spacing,
        trust=trust / trust.sum(), far=np.column_stack([first, second])[is_far],
        first=_first_map(cosine, felt, near, spacing),
    )  # fmt: skip


def map_of_readings(felt: np.ndarray) -> np.ndarray:
    """`(S, 3)` a map of a skin in diameters of a contact; NaN for receptors hardly felt.

    Readings that fall with the distance tell more than which receptors were on: of hands made by
    hand maps are 5 % off in place of 13 to 20.

    Args:
        felt: `(n, S)` readings.
    """
    known = np.flatnonzero(np.count_nonzero(felt > 0, axis=0) >= _FEWEST_OF_PAIR)
    own = felt[:, known].astype(float)
    norm = np.linalg.norm(own, axis=0)
    place = np.full((felt.shape[1], 3), np.nan)
    place[known] = _isomap(distance_of_shared(own.T @ own / np.outer(norm, norm)))
    return place


def _basis(cosine: np.ndarray, size: int) -> np.ndarray:
    """Smoothest patterns over receptors that share touches: those of a graph's Laplacian."""
    weight = cosine**2
    np.fill_diagonal(weight, 0)
    degree = weight.sum(axis=1) + 1e-6
    laplacian = np.eye(len(weight)) - weight / np.sqrt(np.outer(degree, degree))
    value, pattern = np.linalg.eigh(laplacian)
    last = min(size, len(weight))
    value, pattern = np.maximum(value[1:last], 1e-3), pattern[:, 1:last]
    pattern = pattern / np.sqrt(degree)[:, None]
    pattern -= pattern.mean(axis=0)
    pattern /= np.sqrt((pattern**2).mean(axis=0))
    pattern *= np.sqrt(value[0] * (1 + _SMOOTHING) / (value + _SMOOTHING * value[0]))
    return np.column_stack([np.ones(len(weight)), pattern])


def _first_map(
    cosine: np.ndarray, felt: np.ndarray, near: np.ndarray, spacing: np.ndarray
) -> np.ndarray:
    """Classical scaling of distances along the skin (Isomap, Tenenbaum et al. 2000)."""
    known = np.flatnonzero(felt >= _FEWEST_OF_PAIR)
    apart = np.sqrt(np.maximum(2 - 2 * cosine[np.ix_(known, known)], 0))
    place = np.full((len(cosine), 3), np.nan)
    place[known] = _isomap(apart)
    laid = np.linalg.norm(place[near[:, 0]] - place[near[:, 1]], axis=1)
    usable = np.isfinite(laid) & (laid > 0)
    place *= np.exp(np.median(np.log(spacing[usable] / laid[usable])))
    return place - np.nanmean(place, axis=0)


def _isomap(apart: np.ndarray) -> np.ndarray:
    """`(n, 3)` places, of distances `(n, n)` of which only short ones are true."""
    apart = apart * (1 - np.eye(len(apart)))
    rank = np.argsort(np.argsort(apart, axis=1), axis=1)
    is_edge = (rank <= _NEIGHBOURS) | (rank <= _NEIGHBOURS).T
    along = shortest_path(np.where(is_edge, np.maximum(apart, 1e-6), 0), directed=False)
    # Pieces that share no touch lie as far apart as the most distant receptors of one piece.
    along[~np.isfinite(along)] = along[np.isfinite(along)].max()
    middle = along**2
    middle = middle - middle.mean(axis=0) - middle.mean(axis=1)[:, None] + middle.mean()
    value, vector = np.linalg.eigh(-middle / 2)
    return vector[:, -3:] * np.sqrt(np.maximum(value[-3:], 0))
