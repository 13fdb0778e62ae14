"""Recordings of touches that are felt on both sides, and how a body hangs together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """Touches of two ends: skins, or single points such as fingertips.

    Attributes:
        name: of the recording.
        above: name of the end that touches.
        below: name of the end that is touched.
        q: `(t, J)` rad readings of all joints.
        felt_above: `(t, S)` whether a receptor felt the touch; None if the end is a point.
        felt_below: `(t, S)` likewise.
    """

    name: str
    above: str
    below: str
    q: np.ndarray
    felt_above: np.ndarray | None
    felt_below: np.ndarray | None

    def some(self, rows: np.ndarray) -> "Recording":
        """Some of the touches."""
        return Recording(
            name=self.name, above=self.above, below=self.below, q=self.q[rows],
            felt_above=None if self.felt_above is None else self.felt_above[rows],
            felt_below=None if self.felt_below is None else self.felt_below[rows],
        )  # fmt: skip

    def felt(self, end: str) -> np.ndarray | None:
        """`(t, S)` whether a receptor of an end felt the touch; None if it is not a skin of it."""
        if end == self.above:
            return self.felt_above
        return self.felt_below if end == self.below else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Which joints carry what: chains that begin at one trunk.

    Attributes:
        limbs: joints of each limb, from the trunk outwards.
        holder: the limb at whose end a skin or a point is; an empty name for the trunk.
        mirrored: pairs of limbs that may be mirror images, the joints in the same order.
    """

    limbs: Mapping[str, Sequence[int]]
    holder: Mapping[str, str]
    mirrored: tuple[tuple[str, str], ...] = ()

    def joints(self, end: str) -> list[int]:
        """Joints on the way from the trunk to an end."""
        return list(self.limbs[self.holder[end]]) if self.holder[end] else []

    def between(self, recording: Recording) -> list[int]:
        """Joints between the two ends of a recording, sorted."""
        return sorted({*self.joints(recording.above), *self.joints(recording.below)})


def same_posture(q: np.ndarray, reach: float) -> np.ndarray:
    """`(t,)` label of each touch: touches that a chain of steps below `reach`, in rad, connects."""
    pairs = cKDTree(q).query_pairs(reach, output_type="ndarray")
    links = csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(q), len(q)))
    return connected_components(links, directed=False)[1]


def folds_of_postures(
    q: np.ndarray, *, folds: int = 5, reach: float = 0.05, seed: int = 0
) -> np.ndarray:
    """`(t,)` fold of each touch: no posture, repeated as it may be, is in two folds.

    Args:
        q: `(t, J)` rad readings of the joints that matter.
        folds: number of folds, of nearly equal numbers of touches.
        reach: rad within which touches have one posture.
        seed: of the draw.
    """
    label = same_posture(q, reach)
    size = np.bincount(label)
    random = np.random.default_rng(seed)
    fold, load = np.zeros(len(size), dtype=int), np.zeros(folds)
    # Large groups first, each to the emptiest fold; groups of nearly one size change places.
    for group in np.argsort(-size + 2 * random.random(len(size))):
        fold[group] = np.argmin(load)
        load[fold[group]] += size[group]
    return fold[label]
