"""Touches in order: where the joints were, and what was felt there (naive)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.representation.quantise import unit


@dataclass(frozen=True, slots=True, eq=False)
class TouchSet:
    """Touches in order; those of no touches have no joints and no receptors.

    Attributes:
        q: `(n, J)` motor configurations, in the robot's units.
        sensation: `(n, S)` N, what was felt there.
    """

    q: np.ndarray
    sensation: np.ndarray

    @classmethod
    def none(cls) -> TouchSet:
        """No touches."""
        return cls(np.empty((0, 0)), np.empty((0, 0)))

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, rows: slice | np.ndarray) -> TouchSet:
        return TouchSet(self.q[rows], self.sensation[rows])

    def and_then(self, others: TouchSet) -> TouchSet:
        """These touches and others after them."""
        if not len(self) or not len(others):
            return self if len(self) else others
        return TouchSet(
            np.concatenate([self.q, others.q]), np.concatenate([self.sensation, others.sensation])
        )

    @property
    def direction(self) -> np.ndarray:
        """`(n, S)` sensations of unit L2 norm."""
        return unit(self.sensation)
