"""Sensations of the paper's agent: each is one touch of one body.

"The fingers are the only parts that can apply a pressure on the tactile body", so that the
sensation S = phi(X) of a pose X is that of one place. A body of several parts, or one with several
hands, takes sensations apart before it compares them: it hands `learn` senses of its own.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from .sensations import target_sensations


class Senses(Protocol):
    """How the sensations of n rows of the experience become touches, and what they are compared by.

    S receptors. A row may hold several touches, or none that is learned from.
    """

    def places(self, sensation: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Takes `(n, S)` N sensations apart into m touches.

        Returns `(m,)` the row of each, ascending without a gap; `(m, P)` N what is felt of it; and
        `(m,)` bool, those that are set aside.
        """
        ...

    def whole(self, sensation: np.ndarray) -> np.ndarray:
        """`(n, P)` N, `(n, S)` N sensations in the form of touches, but not taken apart."""
        ...

    def compared(self, felt: np.ndarray) -> np.ndarray:
        """`(m, P)` touches `(m, P)` N, as they are compared with target sensations."""
        ...

    def by_receptor(self, sensation: np.ndarray, row: np.ndarray, felt: np.ndarray) -> np.ndarray:
        """`(m, S)` N, what receptors feel of touches that `places` found in `(n, S)` sensations."""
        ...

    def targets(self, compared: np.ndarray, num_targets: int) -> np.ndarray:
        """`(K, P)` target sensations, unit L2 norm, of touches as they are compared."""
        ...

    def total(
        self, label: np.ndarray, by_receptor: np.ndarray, num_targets: int
    ) -> np.ndarray | float:
        """`(K, S)` what is felt in each kernel in all, where it must be known; else 0.

        The kernel of each touch is `(m,)`, -1 if it is set aside; receptors feel `(m, S)` N.
        """
        ...


#: Makes senses from `(n, S)` N sensations, a fair sample of the experience.
MakeSenses = Callable[[np.ndarray], Senses]


class OnePlace:
    """The paper's senses: every row is one touch, and is compared as it is felt."""

    def __init__(self, sensation: np.ndarray) -> None:
        """Needs to know nothing of the sensations."""

    def places(self, sensation: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Each row is a touch."""
        return np.arange(len(sensation)), sensation, np.zeros(len(sensation), dtype=bool)

    def whole(self, sensation: np.ndarray) -> np.ndarray:
        """The sensations themselves."""
        return sensation

    def compared(self, felt: np.ndarray) -> np.ndarray:
        """The touches themselves."""
        return felt

    def by_receptor(self, sensation: np.ndarray, row: np.ndarray, felt: np.ndarray) -> np.ndarray:
        """The touches themselves."""
        return felt

    def targets(self, compared: np.ndarray, num_targets: int) -> np.ndarray:
        """By k-means alone."""
        return target_sensations(compared, num_targets)

    def total(
        self, label: np.ndarray, by_receptor: np.ndarray, num_targets: int
    ) -> np.ndarray | float:
        """Nobody needs to know."""
        return 0.0
