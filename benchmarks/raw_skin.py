"""What a real skin would read, imitated: eight bits, offsets, drift, noise, hysteresis and spikes.

Nothing here knows Drake. `recorded` is a small recording for tests; `benchmarks/imported.py` wears
out what a simulated robot feels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

#: Counts that a firm reading is above rest; one per mille of the readings above 0 is firmer.
FIRM = 120.0
#: Counts, standard deviation of the noise.
NOISE = 1.0
#: Counts that the resting level of a receptor goes up or down at most, in the whole recording.
DRIFT = 5.0
#: Of the way back that a receptor goes in one row after the pressure fell.
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
    """A finger wanders over a sphere, presses it and lifts off again.

    The first three joints place the finger; the others sway, and change nothing that is felt.
    """
    rng = np.random.default_rng(seed)
    receptors = _fibonacci(num_receptors)
    place = _wandering(rng, num_rows, 3, 0.95)
    place /= np.linalg.norm(place, axis=1, keepdims=True)
    depth = _wandering(rng, num_rows, 1, 0.95)[:, 0]
    width = 7.0 / np.sqrt(num_receptors)
    force = np.empty((num_rows, num_receptors), dtype=np.float32)
    for first in range(0, num_rows, 5000):
        rows = slice(first, first + 5000)
        near = (1.0 - np.sqrt(np.maximum(2.0 - 2.0 * place[rows] @ receptors.T, 0.0)) / width)
        force[rows] = 2.0 * near.clip(0.0) * depth[rows].clip(0.0)[:, None]
    q = np.hstack([(1.0 - 0.02 * depth[:, None]) * place, 0.1 * _wandering(rng, num_rows, 4, 0.95)])
    return Recorded(
        q=q,
        force=force,
        raw=raw_readings(force, seed=seed),
        place=place,
        time_s=np.arange(num_rows) / rate_hz,
    )


def raw_readings(force: np.ndarray, *, seed: int = 0, spikes: float = SPIKES) -> np.ndarray:
    """What a real skin reads.

    Args:
        force: `(n, S)` N, what a perfect one feels, row by row in time.
        seed: of all that is random.
        spikes: share of the readings that are spikes.

    Returns:
        `(n, S)` uint8.
    """
    rng = np.random.default_rng(seed)
    num_rows, num_receptors = force.shape
    offset = rng.uniform(20.0, 60.0, num_receptors)
    drift = rng.uniform(-DRIFT, DRIFT, num_receptors)
    gain = rng.uniform(0.8, 1.2, num_receptors) * FIRM / np.quantile(force[force > 0], 0.999)
    raw, held = np.empty(force.shape, dtype=np.uint8), np.zeros(num_receptors)
    for row, pressed in enumerate(force):
        # Pressure is read at once; when it falls, the foam comes back slowly.
        held = np.maximum(pressed, held + RECOVERY * (pressed - held))
        level = offset + drift * row / num_rows + rng.normal(0.0, NOISE, num_receptors)
        reading = np.rint(level + gain * held).clip(0, 255)
        wild = rng.random(num_receptors) < spikes
        raw[row] = np.where(wild, rng.integers(0, 256, num_receptors), reading)
    return raw


def _wandering(rng: np.random.Generator, num_rows: int, width: int, persistence: float):
    """`(num_rows, width)` numbers of about one that change smoothly, as joints do."""
    poles = np.poly([persistence] * 2)
    walk = lfilter([1.0], poles, rng.normal(size=(num_rows + 500, width)), axis=0)[500:]
    return walk / walk.std(axis=0)


def _fibonacci(num_points: int) -> np.ndarray:
    i = np.arange(num_points) + 0.5
    z = 1 - 2 * i / num_points
    turn = i * np.pi * (1 + np.sqrt(5))
    flat = np.sqrt(1 - z**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
