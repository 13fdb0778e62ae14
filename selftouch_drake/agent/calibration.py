"""Calibrates the receptors of a real skin: turns raw readings into sensations (naive).

Raw readings are not pressures: each receptor has its own resting level, which drifts, and there is
noise. On some skins there are spikes, and on some readings decay slowly after a touch. All this is
estimated from the readings themselves, because few receptors feel each touch, and each receptor is
at rest in most rows.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

#: Threshold in standard deviations of the noise at rest. With 300 receptors and normal noise, six
#: gives one false reading in three million rows, five gives one in six thousand.
_SILENCE = 6.0

#: Share of a normal distribution that is more than one standard deviation below the mean.
_BELOW = 0.159

#: Flicker in a smaller share of the rows than this is chance. With spikes in 1 % of eight-bit
#: readings, 0.004 % are one step below rest.
_SELDOM = 5e-4

#: Rows over which the resting level counts as constant: at 50 Hz less than two minutes.
_WINDOW = 5000

#: Most rows from which noise is estimated.
_SAMPLE = 20_000

#: Rows are successive in time if the joints move between them by less than this share of the
#: distance between random rows. A robot that crosses its range in a second has 0.04 at 50 Hz.
_SUCCESSIVE = 0.05

#: A reading counts as a touch if at least this many neighbouring receptors feel it too, where
#: fields overlap. With spikes in 1 % of all readings, 1 spike in 60 has two among 18 neighbours.
_COMPANY = 2

#: Receptors are neighbours if they feel together this many times more often than by chance.
_LIFT = 3.0

#: There are spikes if in more than this share of the rows nothing is felt but firm readings that no
#: neighbour shares. One receptor alone may feel a touch, but then it is a light one.
_FEW_ALONE = 0.03

#: Readings decay slowly if pressure falls in this many times more rows than it rises in. Without
#: hysteresis the ratio is 1, since random motion looks the same forwards and backwards.
_SLOW = 1.2

#: Pressure that is at least this share of the previous row is not falling, but noisy.
_STEADY = 0.95

#: Rows per block; bounds the memory for readings as floats.
_BLOCK = 8192


class RestlessWarning(UserWarning):
    """Receptors seem to feel something most of the time: their resting level is doubtful."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """Resting levels, noise and thresholds of S receptors.

    Attributes:
        rising: whether readings rise with pressure; on some skins they fall.
        row: `(W,)` rows at which the resting level was estimated, ascending.
        level: `(W, S)` resting level there, in raw units; interpolated linearly in between.
        noise: `(S,)` standard deviation at rest, in raw units.
        threshold: `(S,)` above rest, in raw units; smaller readings count as 0.
        smoothed: whether a median filter over three rows was applied first, because there are
            spikes and the rows are successive in time.
    """

    rising: bool
    row: np.ndarray
    level: np.ndarray
    noise: np.ndarray
    threshold: np.ndarray
    smoothed: bool

    @property
    def offset(self) -> np.ndarray:
        """`(S,)` typical resting level."""
        return np.median(self.level, axis=0)

    @property
    def drift(self) -> np.ndarray:
        """`(S,)` range of the resting level over the recording."""
        return np.ptp(self.level, axis=0)

    def pressure(self, readings: np.ndarray, first_row: int = 0) -> np.ndarray:
        """`(n, S)` float32, pressures: readings above rest, in raw units; 0 below the threshold.

        Args:
            readings: `(n, S)` raw, rows of the calibrated recording from `first_row` on.
            first_row: number of the first row.
        """
        resting = _between(self.row, self.level, first_row + np.arange(len(readings)))
        above = readings - resting if self.rising else resting - readings
        return np.where(above > self.threshold, above, 0.0).astype(np.float32)

    def to_arrays(self) -> dict[str, np.ndarray]:
        """All fields by name, for a file."""
        return {name: np.asarray(getattr(self, name)) for name in self.__slots__}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Felt:
    """The touches of a recording.

    Attributes:
        rows: `(n,)` rows of the recording in which something is felt.
        q: `(n, J)` motor configurations, in the robot's units.
        sensation: `(n, S)` float32, pressures in raw units; no row null.
        calibration: of the receptors.
        num_lone: number of spikes: readings above the threshold that no neighbouring receptors
            shared. They are 0 in `sensation`.
        num_fading: number of rows excluded because pressure fell, if readings decay slowly.
    """

    rows: np.ndarray
    q: np.ndarray
    sensation: np.ndarray
    calibration: Calibration
    num_lone: int
    num_fading: int

    @property
    def silent(self) -> np.ndarray:
        """Indices of the receptors that never feel anything."""
        return np.flatnonzero(~self.sensation.any(axis=0))


def felt_touches(
    q: np.ndarray,
    readings: np.ndarray,
    *,
    offset: float | np.ndarray | None = None,
    threshold: float | np.ndarray | None = None,
    rising: bool | None = None,
) -> Felt:
    """Finds the touches in a recording of raw readings.

    Args:
        q: `(n, J)` motor configurations, in the robot's units; if they change little from row to
            row, rows count as successive in time, else as unordered.
        readings: `(n, S)` raw, any real type, all finite; rows that touch and rows that do not, as
            recorded. Pressures with an offset of 0 are returned unchanged.
        offset: resting level in raw units, one or `(S,)`; estimated by default, with its drift.
        threshold: above rest, in raw units, one or `(S,)`; by default six standard deviations of
            the noise.
        rising: whether readings rise with pressure; estimated by default.

    Raises:
        ValueError: shapes disagree, a number is not finite, or nothing is felt.

    Warns:
        RestlessWarning: most receptors feel something in most rows.
    """
    q, readings = _checked(q, readings)
    calibration = _calibrated(readings, offset, threshold, rising)
    rows, pressure = _pressed(readings, calibration)
    shared = _shared_unless_all(pressure, len(readings))
    successive = _are_successive(q)
    if successive and shared is not None:
        readings = _median_of_three(readings)
        calibration = _calibrated(readings, offset, threshold, rising, smoothed=True)
        rows, pressure = _pressed(readings, calibration)
        shared = _shared_unless_all(pressure, len(readings))
    num_lone = 0
    if shared is not None:
        num_lone = int(np.count_nonzero(pressure) - np.count_nonzero(shared))
        rows, pressure = _touching(rows, np.where(shared, pressure, np.float32(0.0)))
    if len(pressure) and 2 * np.median(np.count_nonzero(pressure, axis=0)) > len(readings):
        warnings.warn(
            "half of the receptors feel something in more than half of the rows: record more rows "
            "without a touch, or give the correct offset",
            RestlessWarning,
            stacklevel=2,
        )
    num_fading = 0
    if successive and (fading := _fading(rows, pressure.sum(axis=1, dtype=float))).any():
        num_fading = int(fading.sum())
        rows, pressure = rows[~fading], pressure[~fading]
    if not len(rows):
        raise ValueError(
            f"nothing is felt in {len(readings)} rows: the readings of all receptors stay within "
            "their thresholds; lower the threshold, or record touches"
        )
    return Felt(
        rows=rows,
        q=q[rows],
        sensation=pressure,
        calibration=calibration,
        num_lone=num_lone,
        num_fading=num_fading,
    )


def _pressed(readings: np.ndarray, calibration: Calibration) -> tuple[np.ndarray, np.ndarray]:
    """Rows in which any receptor is above its threshold, and `(n, S)` float32 pressures."""
    found = []
    for block in _blocks(len(readings)):
        pressure = calibration.pressure(readings[block], block.start)
        found.append(_touching(np.arange(block.start, block.stop), pressure))
    rows, pressures = zip(*found, strict=True)
    return np.concatenate(rows), np.concatenate(pressures)


def _touching(rows: np.ndarray, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    touching = pressure.any(axis=1)
    return rows[touching], pressure[touching]


def _fading(rows: np.ndarray, total: np.ndarray) -> np.ndarray:
    """`(n,)` bool, rows in which pressure falls, if readings decay slowly; else none.

    After a touch ends, a slow receptor still reads it for a while. Pressure then falls in many more
    rows than it rises in, and falling readings show past touches.

    Args:
        rows: `(n,)` of the recording, ascending.
        total: `(n,)` sum of the pressures.
    """
    follows = np.diff(rows) == 1
    falls, rises = follows & (total[1:] < total[:-1]), follows & (total[1:] > total[:-1])
    if falls.sum() < _SLOW * rises.sum():
        return np.zeros(len(rows), dtype=bool)
    return np.append(False, follows & (total[1:] < _STEADY * total[:-1]))


def _calibrated(
    readings: np.ndarray,
    offset: float | np.ndarray | None,
    threshold: float | np.ndarray | None,
    rising: bool | None,
    *,
    smoothed: bool = False,
) -> Calibration:
    num_receptors = readings.shape[1]
    if offset is None:
        row, level = _resting_levels(readings)
    else:
        row, level = np.zeros(1), _one_each("offset", offset, num_receptors)[None]
    sample = np.arange(0, len(readings), -(-len(readings) // _SAMPLE))
    apart = readings[sample] - _between(row, level, sample)
    if rising is None:
        rising = np.square(apart.clip(0.0)).sum() >= np.square(apart.clip(None, 0.0)).sum()
    noise = _noise(apart if rising else -apart, readings[sample])
    limit = _SILENCE * noise
    if threshold is not None:
        limit = _one_each("threshold", threshold, num_receptors)
    return Calibration(
        rising=bool(rising), row=row, level=level, noise=noise, threshold=limit, smoothed=smoothed
    )


def _resting_levels(readings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The middle row of each window, and `(W, S)` the median readings in it."""
    cuts = np.linspace(0, len(readings), max(len(readings) // _WINDOW, 1) + 1).astype(int)
    windows = [slice(*ends) for ends in pairwise(cuts)]
    level = np.stack([np.median(readings[window], axis=0) for window in windows])
    return (cuts[:-1] + cuts[1:] - 1) / 2, level.astype(float)


def _between(row: np.ndarray, level: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """`(n, S)` levels interpolated at `rows`; constant before the first and after the last."""
    if len(row) == 1:
        return level
    place = np.interp(rows, row, np.arange(len(row)))
    before = np.minimum(place.astype(int), len(row) - 2)
    share = (place - before)[:, None]
    # This form is exact for a constant level, so a receptor at rest reads exactly 0.
    return level[before] + share * (level[before + 1] - level[before])


def _noise(apart: np.ndarray, readings: np.ndarray) -> np.ndarray:
    """`(S,)` standard deviation at rest, from the side of rest without touches.

    If readings flicker by one quantisation step, half a step is added, because the level may lie
    anywhere between two steps.
    """
    noise = np.maximum(-np.quantile(apart, _BELOW, axis=0), 0.0)
    for receptor, values in enumerate(readings.T):
        known = np.unique(values)
        if len(known) > 1:
            step, down = float(np.diff(known.astype(float)).min()), -apart[:, receptor]
            flickers = np.mean((down > 0) & (down <= 1.5 * step)) > _SELDOM
            noise[receptor] += 0.5 * step * flickers
    return noise


def _are_successive(q: np.ndarray) -> bool:
    """Whether the joints move little from row to row, compared with random rows."""
    if len(q) < 100:
        return False
    spread = np.where((deviation := q.std(axis=0)) > 0, deviation, np.inf)
    other = q[np.random.default_rng(0).permutation(len(q))]
    near, far = (
        np.median(np.abs(steps / spread).sum(axis=1)) for steps in (np.diff(q, axis=0), q - other)
    )
    return bool(near < _SUCCESSIVE * far)


def _median_of_three(readings: np.ndarray) -> np.ndarray:
    """`(n, S)` of the same type: median filter over each row, the previous and the next."""
    found, before, after = readings.copy(), readings[:-2], readings[2:]
    for rows in _blocks(len(before)):
        ends = np.sort([before[rows], after[rows]], axis=0)
        found[1:-1][rows] = readings[1:-1][rows].clip(*ends)
    return found


def _blocks(num_rows: int) -> Iterator[slice]:
    return (slice(start, min(start + _BLOCK, num_rows)) for start in range(0, num_rows, _BLOCK))


def _shared_unless_all(pressure: np.ndarray, num_rows: int) -> np.ndarray | None:
    """`(n, S)` bool, readings that enough neighbouring receptors share; None without spikes.

    Neighbours are receptors that feel together more often than by chance. If fields do not overlap,
    spikes cannot be distinguished from touches.

    Args:
        pressure: `(n, S)` in rows with at least one touched receptor.
        num_rows: of the recording.
    """
    num_receptors = pressure.shape[1]
    felt = pressure > 0
    together, counts = np.zeros((num_receptors, num_receptors)), felt.sum(axis=0, dtype=float)
    for rows in _blocks(len(felt)):
        some = felt[rows].astype(np.float32)
        together += some.T @ some
    chance = np.outer(counts, counts) / num_rows
    neighbours = (together > _LIFT * chance) & (together > chance + 3.0 * np.sqrt(chance) + 2.0)
    np.fill_diagonal(neighbours, False)
    if np.median(neighbours.sum(axis=1)) < _COMPANY:
        return None
    shared = np.zeros(felt.shape, dtype=bool)
    for rows in _blocks(len(felt)):
        others = felt[rows].astype(np.float32) @ neighbours.T.astype(np.float32)
        shared[rows] = felt[rows] & (others >= _COMPANY)
    if not shared.any():
        return None
    firm = pressure.max(axis=1) > np.median(pressure[shared])
    return shared if np.mean(firm & ~shared.any(axis=1)) > _FEW_ALONE else None


def _one_each(name: str, value: float | np.ndarray, num_receptors: int) -> np.ndarray:
    """`(S,)` floats, one per receptor."""
    array = np.asarray(value, dtype=float)
    if array.shape not in ((), (num_receptors,)) or not np.isfinite(array).all():
        raise ValueError(
            f"{name} has shape {array.shape}: give one finite number, or one for each of "
            f"{num_receptors} receptors"
        )
    return np.broadcast_to(array, (num_receptors,)).astype(float)


def _checked(q: np.ndarray, readings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    q, readings = np.asarray(q), np.asarray(readings)
    for name, rows, columns in (("q", q, "joints"), ("readings", readings, "receptors")):
        if rows.ndim != 2 or 0 in rows.shape:
            raise ValueError(f"{name} has shape {rows.shape}: give it as (rows, {columns})")
        if rows.dtype.kind not in "fiub":
            raise ValueError(f"{name} holds {rows.dtype}: give real numbers")
        if rows.dtype.kind == "f" and not np.isfinite(rows).all():
            bad = int(np.flatnonzero(~np.isfinite(rows).all(axis=1))[0])
            raise ValueError(f"{name} row {bad} holds NaN or infinity: drop such rows")
    if len(q) != len(readings):
        raise ValueError(
            f"q has {len(q)} rows and readings {len(readings)}: give one configuration for each row"
        )
    return q.astype(float), readings.astype(np.uint8) if readings.dtype.kind == "b" else readings
