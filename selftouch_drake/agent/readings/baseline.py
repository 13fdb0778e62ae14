"""The baseline of raw readings: resting level, noise and threshold of each receptor (naive).

Raw readings are not pressures: each receptor has its own resting level, which drifts, and there is
noise. On some skins there are spikes. All this is estimated from the readings themselves, because
few receptors feel each touch, and each receptor is at rest in most rows.
"""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from selftouch_drake.agent.records import Record

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

#: There are spikes if in more than this share of the rows nothing stands out but firm readings that
#: no neighbour shares and, if rows are successive, that come and go within one row.
_FEW_ALONE = 0.03

#: Share of the readings that last whose neighbours must feel it too, for lone ones to be spikes.
_MOSTLY = 0.8

#: Readings fall with pressure if those below rest weigh this many times more than those above it.
_FALLS = 1.5

#: Rows per block; bounds the memory for readings as floats.
_BLOCK = 8192


#: If it is unknown who the neighbours are.
_NOBODY = np.zeros((0, 0), dtype=bool)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Baseline(Record):
    """How the raw readings of S receptors become sensations.

    Attributes:
        rising: whether readings rise with pressure; on some skins they fall.
        row: `(W,)` rows at which the resting level was estimated, ascending.
        level: `(W, S)` resting level there, in raw units; interpolated linearly in between.
        noise: `(S,)` standard deviation at rest, in raw units.
        threshold: `(S,)` above rest, in raw units; smaller readings count as 0. Infinite for
            receptors that are set aside.
        spikes: whether there are spikes.
        neighbours: `(S, S)` bool, receptors that feel together, if there are spikes: readings that
            fewer than two neighbours share count as 0. `(0, 0)` if it is unknown who they are.
        smoothed: whether the recording went through a median filter over three rows first.
    """

    rising: bool
    row: np.ndarray
    level: np.ndarray
    noise: np.ndarray
    threshold: np.ndarray
    spikes: bool = False
    neighbours: np.ndarray = field(default_factory=lambda: _NOBODY)
    smoothed: bool = False

    @property
    def offset(self) -> np.ndarray:
        """`(S,)` typical resting level."""
        return np.median(self.level, axis=0)

    @property
    def drift(self) -> np.ndarray:
        """`(S,)` range of the resting level over the rows that it was estimated from."""
        return np.ptp(self.level, axis=0)

    def sensation(self, readings: np.ndarray) -> np.ndarray:
        """`(n, S)` float32, pressures above rest, in raw units; 0 below the threshold.

        The raw `(n, S)` readings come later than those of the baseline, so the last resting level
        holds. Each row is turned by itself, without those before and after it.
        """
        pressure = self._pressure(readings - self.level[-1])
        return np.where(self.shared(pressure > 0), pressure, np.float32(0.0))

    def _pressure(self, apart: np.ndarray, either_way: bool = False) -> np.ndarray:
        """`(n, S)` float32, readings so far apart from rest that they pass the threshold, or 0."""
        above = np.abs(apart) if either_way else apart if self.rising else -apart
        return np.where(above > self.threshold, above, 0.0).astype(np.float32)

    def touching(
        self, readings: np.ndarray, *, either_way: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """The rows in which some pressure is not null, and `(n, S)` float32 pressures there."""
        found = []
        for start in range(0, len(readings), _BLOCK):
            block = readings[start : start + _BLOCK]
            rows = start + np.arange(len(block))
            pressure = self._pressure(block - _between(self.row, self.level, rows), either_way)
            touching = pressure.any(axis=1)
            found.append((rows[touching], pressure[touching]))
        rows, pressures = zip(*found, strict=True)
        return np.concatenate(rows), np.concatenate(pressures)

    def shared(self, felt: np.ndarray) -> np.ndarray:
        """`(n, S)` bool, what is felt and shared by enough neighbours, if they are known."""
        if not self.neighbours.size:
            return felt
        return felt & (felt.astype(np.float32) @ self.neighbours >= _COMPANY)


def estimate_baseline(
    q: np.ndarray,
    readings: np.ndarray,
    *,
    offset: float | None = None,
    threshold: float | None = None,
    rising: bool | None = None,
    spikes: bool | None = None,
) -> Baseline:
    """Estimates the baseline of receptors from a stretch of raw rows, touching or not.

    Args:
        q: `(n, J)` motor configurations, in the robot's units; if they change little from row to
            row, rows count as successive in time, else as unordered.
        readings: `(n, S)` raw, any real type, all finite; each receptor at rest in most rows.
        offset: resting level in raw units; by default that of each receptor, with its drift.
        threshold: above rest, in raw units; by default six standard deviations of the noise.
        rising: whether readings rise with pressure; estimated by default.
        spikes: whether there are spikes; estimated by default.

    Raises:
        ValueError: shapes disagree, or a number is not finite.
    """
    q, readings = checked_recording(q, readings)
    for name, given in (("offset", offset), ("threshold", threshold)):
        if given is not None and not np.isfinite(given):
            raise ValueError(f"{name} is {given}: give a finite number")
    row, level = np.zeros(1), np.full((1, readings.shape[1]), float(offset or 0.0))
    if offset is None:
        cuts = np.linspace(0, len(readings), max(len(readings) // _WINDOW, 1) + 1).astype(int)
        row = (cuts[:-1] + cuts[1:] - 1) / 2
        windows = (readings[slice(*ends)] for ends in pairwise(cuts))
        level = np.array([np.median(window, axis=0) for window in windows], dtype=float)
    sample = np.arange(0, len(readings), -(-len(readings) // _SAMPLE))
    apart = readings[sample] - _between(row, level, sample)
    if rising is None:
        above, below = (np.square(apart.clip(*side)).sum() for side in ((0, None), (None, 0)))
        rising = below <= _FALLS * above
    noise = _noise(apart if rising else -apart, readings[sample])
    limit = _SILENCE * noise if threshold is None else np.full(len(noise), float(threshold))
    found = Baseline(rising=bool(rising), row=row, level=level, noise=noise, threshold=limit)
    successive = are_successive(q)
    if spikes is None:
        spikes = _has_spikes(readings, found, successive)
    if not spikes:
        return found
    rows, pressure = found.touching(readings)
    neighbours = _neighbours(pressure > 0, len(readings))
    found = replace(found, spikes=True, neighbours=neighbours)
    if successive and neighbours.size:
        # What lasts is a touch. Where few receptors share it, a lone reading may be one too.
        felt = pressure > 0
        lasts = felt[1:-1] & felt[:-2] & felt[2:] & (rows[2:] - rows[:-2] == 2)[:, None]
        if np.mean(found.shared(felt)[1:-1][lasts]) < _MOSTLY:
            found = replace(found, neighbours=_NOBODY)
    return found


def _between(row: np.ndarray, level: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """`(n, S)` levels interpolated at `rows`; constant before the first and after the last."""
    return np.stack([np.interp(rows, row, of_receptor) for of_receptor in level.T], axis=1)


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


def are_successive(q: np.ndarray) -> bool:
    """Whether the joints move little from row to row, compared with random rows."""
    if len(q) < 100:
        return False
    spread = np.where((deviation := q.std(axis=0)) > 0, deviation, np.inf)
    other = q[np.random.default_rng(0).permutation(len(q))]
    near, far = (
        np.median(np.abs(steps / spread).sum(axis=1)) for steps in (np.diff(q, axis=0), q - other)
    )
    return bool(near < _SUCCESSIVE * far)


def _has_spikes(readings: np.ndarray, baseline: Baseline, successive: bool) -> bool:
    """Whether many firm readings stand alone: in no neighbour and, if rows are successive, in time.

    Readings count on both sides of rest: a spike may go either way. If fields do not overlap,
    spikes cannot be distinguished from touches.
    """
    rows, strong = baseline.touching(readings, either_way=True)
    felt = strong > 0
    neighbours = _neighbours(felt, len(readings))
    if not neighbours.size:
        return False
    num_near = felt.astype(np.float32) @ neighbours
    shared = felt & (num_near >= _COMPANY)
    if not shared.any():
        return False
    lone = felt & ~shared & (strong > np.median(strong[shared]))
    if successive:
        near = felt | (num_near > 0)
        follows = (np.diff(rows) == 1)[:, None]
        lone[1:] &= ~(follows & near[:-1])
        lone[:-1] &= ~(follows & near[1:])
    return bool(lone.sum() > _FEW_ALONE * len(rows))


def _neighbours(felt: np.ndarray, num_rows: int) -> np.ndarray:
    """`(S, S)` bool, receptors that feel together; `(0, 0)` if fields hardly overlap.

    From `(n, S)` bool, the rows of a recording of `num_rows` in which something is felt.
    """
    counts, some = felt.sum(axis=0, dtype=float), felt.astype(np.float32)
    together, chance = (some.T @ some).astype(float), np.outer(counts, counts) / num_rows
    neighbours = (together > _LIFT * chance) & (together > chance + 3.0 * np.sqrt(chance) + 2.0)
    np.fill_diagonal(neighbours, False)
    return neighbours if np.median(neighbours.sum(axis=1)) >= _COMPANY else _NOBODY


def checked_recording(q: np.ndarray, readings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Configurations and readings as arrays of real numbers; errors as in `estimate_baseline`."""
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
    least = np.float32 if readings.dtype.kind == "f" else np.uint8
    return q.astype(float), readings.astype(np.result_type(readings, least), copy=False)
