"""Senses of a body that is touched at several places, on several parts, by several hands."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.representation.pools import pooled
from selftouch_drake.agent.representation.touches import (
    Together,
    expected_readings,
    kernel_parts,
    receptors_together,
)
from selftouch_drake.quotient.sensations import assign, target_sensations, unit

#: Most rounds in which targets are chosen, each without the touches of rare targets of the last.
_MOST_ROUNDS = 6

#: Cells with less than this share of the touches of a typical one are chance. On a sphere that two
#: arms touch, 30 of 182 cells held one touch in 100,000 each, and no other less than 349.
_RARE = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class SeveralPlaces:
    """How a learner takes the sensations of n rows apart into m touches, and compares them.

    Attributes:
        together: which receptors feel the same touch.
        expected: `(P, P)` as in `expected_readings`; None if touches are compared as they are felt.
    """

    together: Together
    expected: np.ndarray | None

    @classmethod
    def of(cls, sensation: np.ndarray) -> "SeveralPlaces":
        """Finds out how to from `(n, S)` N sensations, unselected."""
        together = receptors_together(sensation)
        return cls(together, expected_readings(pooled(sensation, together.pool), together))

    def places(self, sensation: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The row of each touch, what pools feel of it, what is set aside: `Together.places`."""
        return self.together.places(sensation)

    def whole(self, sensation: np.ndarray) -> np.ndarray:
        """`(n, P)` N, what pools of receptors feel."""
        return pooled(sensation, self.together.pool)

    def compared(self, felt: np.ndarray) -> np.ndarray:
        """What is expected to be felt where that is felt."""
        return felt if self.expected is None else felt.astype(np.float32) @ self.expected

    def by_receptor(self, sensation: np.ndarray, row: np.ndarray, felt: np.ndarray) -> np.ndarray:
        """As in `Together.receptors`."""
        return self.together.receptors(sensation, row, felt)

    def targets(self, compared: np.ndarray, num_targets: int) -> np.ndarray:
        """Without those of touches at two places by chance."""
        return common_targets(compared, num_targets, self.together.near, self.together.chance)

    def total(
        self, label: np.ndarray, by_receptor: np.ndarray, num_targets: int
    ) -> np.ndarray | float:
        """`(K, S)` what is felt in each kernel in all if receptors are binary, else 0."""
        if not self.together.binary:
            return 0.0
        kept = np.flatnonzero(label >= 0)
        cells = csr_array((np.ones(len(kept)), (label[kept], kept)), (num_targets, len(label)))
        return cells @ unit(by_receptor)

    def as_kept(self, targets: np.ndarray, total: np.ndarray | float) -> np.ndarray:
        """`(K, S)` target sensations, unit L2 norm, of receptors, from those that are compared.

        Binary targets are kept as they are felt in all, pools as they are compared.
        """
        if self.expected is None:
            return targets
        pool = self.together.pool
        if self.together.binary:
            return unit(np.asarray(total))
        return unit(targets[:, pool] / np.bincount(pool)[pool])


def common_targets(
    sensation: np.ndarray,
    num_targets: int,
    near: np.ndarray,
    chance: bool,
    *,
    or_fewer: bool = False,
) -> np.ndarray:
    """`(K, S)` target sensations, without those of touches at two places by chance.

    If two places are touched at once by chance, some of these places are so close that the touches
    cannot be recognised. They are rare and unlike all others, so farthest points would choose them.
    So targets with hardly any touches, for their part, are dropped with their touches. If not
    `chance`, this does nothing. Parts follow from `(S, S)` `near`; it and `chance` are as in
    `Together`, all else is as in `target_sensations`.
    """
    for _ in range(_MOST_ROUNDS):
        targets = target_sensations(sensation, num_targets, or_fewer=or_fewer)
        if not chance:
            break
        label, _ = assign(sensation, targets)
        size = np.bincount(label, minlength=len(targets))
        part = kernel_parts(targets, near)
        typical = np.array([np.median(size[part == number]) for number in range(part.max() + 1)])
        rare = size < _RARE * typical[part]
        if not rare.any():
            break
        sensation = sensation[~rare[label]]
    return targets
