"""Readings of joints in standard deviations, in which chains are looked for."""

from typing import NamedTuple

import numpy as np


class StandardReadings(NamedTuple):
    """Readings less their means, in standard deviations.

    Attributes:
        q: `(n, J)`; 0 for joints that never move.
        center: `(J,)` the means of the readings.
        scale: `(J,)` their standard deviations; 1 for joints that never move.
        moving: joints that move.
    """

    q: np.ndarray
    center: np.ndarray
    scale: np.ndarray
    moving: list[int]

    @classmethod
    def of(cls, q: np.ndarray) -> "StandardReadings":
        """Those of `(n, J)` readings, n > 0."""
        center, scale = q.mean(axis=0), q.std(axis=0)
        still = scale <= 1e-9 * np.maximum(np.abs(center), 1e-3)
        scale = np.where(still, 1.0, scale)
        standard = np.where(still, 0.0, (q - center) / scale)
        return cls(standard, center, scale, np.flatnonzero(~still).tolist())

    def single(self) -> np.ndarray:
        """`(J, n)` float32, as a search wants them."""
        return np.ascontiguousarray(self.q.T.astype(np.float32))
