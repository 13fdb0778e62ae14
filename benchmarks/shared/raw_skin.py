"""Imitates the readings of a real skin: eight bits, offsets, drift, noise, hysteresis and spikes.

Nothing here knows Drake. `recorded` is a small recording for tests;
`benchmarks/accuracy/imported.py` wears out what a simulated robot feels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

#: Counts that a firm reading is above rest.
FIRM = 120.0
#: Counts, standard deviation of the noise.
NOISE = 1.0
#: Counts, largest drift of the resting level of a receptor in the whole recording.
DRIFT = 5.0
#: Share of the way back to rest that a receptor covers in one row after the pressure fell.
RECOVERY = 0.5
#: Share of all readings that are spikes: any number of eight bits.
SPIKES = 0.01


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """n rows of 7 joints and S receptors.

    Attributes:
        q: `(n, 7)`.
        force: `(n, S)` N, what a perfect skin feels; null in many rows.
        raw: `(n, S)` uint8, what the real one reads.
        place: `(n, 3)` where the unit sphere is touched; without meaning in rows that do not touch.
        time_s: `(n,)` s.
    """

    q: np.ndarray
    force: np.ndarray
    raw: np.ndarray
    place: np.ndarray
    time_s: np.ndarray


def recorded(
    num_rows: int, num_receptors: int = 300, *, rate_hz: float = 50.0, seed: int = 0
) -> Recorded:
    """A finger that moves over a sphere, presses it and lifts off again.

    The first three joints place the finger; the others sway, and change nothing that is felt.
    """
    rng = np.random.default_rng(seed)
    receptors = fibonacci(num_receptors)
    place = _wandering(rng, num_rows, 3, 0.95)
    place /= np.linalg.norm(place, axis=1, keepdims=True)
    depth = _wandering(rng, num_rows, 1, 0.95)[:, 0]
    width = 7.0 / np.sqrt(num_receptors)
    force = np.empty((num_rows, num_receptors), dtype=np.float32)
    for first in range(0, num_rows, 5000):
        rows = slice(first, first + 5000)
        near = 1.0 - np.sqrt(np.maximum(2.0 - 2.0 * place[rows] @ receptors.T, 0.0)) / width
        force[rows] = 2.0 * near.clip(0.0) * depth[rows].clip(0.0)[:, None]
    q = np.hstack([(1.0 - 0.02 * depth[:, None]) * place, 0.1 * _wandering(rng, num_rows, 4, 0.95)])
    return Recorded(
        q=q,
        force=force,
        raw=RawSkin(num_receptors, float(force.max()), num_rows, seed=seed).read(force),
        place=place,
        time_s=np.arange(num_rows) / rate_hz,
    )


class RawSkin:
    """A skin with S receptors of eight bits.

    Args:
        num_receptors: S.
        firm: N, a firm reading of one receptor; it is `FIRM` counts above rest.
        num_rows: of the whole recording, in which the resting levels drift.
        spikes: share of the readings that are spikes.
        seed: of all that is random.
    """

    def __init__(
        self,
        num_receptors: int,
        firm: float,
        num_rows: int,
        *,
        spikes: float = SPIKES,
        seed: int = 0,
    ):
        self._rng = rng = np.random.default_rng(seed)
        self._offset = rng.uniform(20.0, 60.0, num_receptors)
        self._drift = rng.uniform(-DRIFT, DRIFT, num_receptors) / num_rows
        self._gain = rng.uniform(0.8, 1.2, num_receptors) * FIRM / firm
        self._held = np.zeros(num_receptors)
        self._row = 0
        self._spikes = spikes

    def read(self, force: np.ndarray) -> np.ndarray:
        """`(n, S)` uint8 readings of the next n rows, if a perfect skin feels `force` N."""
        rng, shape = self._rng, force.shape
        held = np.empty(shape, dtype=np.float32)
        for row, pressed in enumerate(force):
            # Pressure is read at once; when it falls, the foam comes back slowly.
            self._held = np.maximum(pressed, self._held + RECOVERY * (pressed - self._held))
            held[row] = self._held
        rows = (self._row + np.arange(len(force)))[:, None]
        self._row += len(force)
        noise = NOISE * rng.standard_normal(shape, dtype=np.float32)
        reading = self._offset + self._drift * rows + self._gain * held + noise
        wild = rng.random(shape, dtype=np.float32) < self._spikes
        spikes = rng.integers(0, 256, shape, dtype=np.uint8)
        return np.where(wild, spikes, np.rint(reading).clip(0, 255)).astype(np.uint8)


def _wandering(rng: np.random.Generator, num_rows: int, width: int, persistence: float):
    """`(num_rows, width)` numbers of magnitude one that change smoothly, like joints."""
    poles = np.poly([persistence] * 2)
    walk = lfilter([1.0], poles, rng.normal(size=(num_rows + 500, width)), axis=0)[500:]
    return walk / walk.std(axis=0)


def fibonacci(num_points: int) -> np.ndarray:
    """`(num_points, 3)` places spread evenly over the unit sphere."""
    i = np.arange(num_points) + 0.5
    z = 1 - 2 * i / num_points
    turn = i * np.pi * (1 + np.sqrt(5))
    flat = np.sqrt(1 - z**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
