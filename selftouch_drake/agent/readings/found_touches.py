"""Touches are found in a recording of raw readings (naive).

Of a whole recording it is known what comes before and after a row: so spikes can be filtered, and
rows left out that only show a touch that has ended, on skins whose readings decay slowly.
"""

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from selftouch_drake.agent.readings.baseline import (
    Baseline,
    are_successive,
    checked_recording,
    estimate_baseline,
)
from selftouch_drake.agent.readings.faults import loose_contacts, lost_rows

#: Readings decay slowly if pressure falls in this many times more rows than it rises in. Without
#: hysteresis the ratio is 1, since random motion looks the same forwards and backwards.
_SLOW = 1.2

#: Pressure that is at least this share of the previous row is not falling, but noisy.
_STEADY = 0.95


class RestlessWarning(UserWarning):
    """Receptors seem to feel something most of the time: their resting level is doubtful."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundTouches:
    """The touches of a recording.

    Attributes:
        rows: `(n,)` rows of the recording in which something is felt.
        q: `(n, J)` motor configurations, in the robot's units.
        sensation: `(n, S)` float32, pressures in raw units; no row null.
        baseline: of the receptors.
        null: `(m,)` rows of the recording in which nothing is felt.
        successive: whether rows are successive in time.
        num_lone: number of spikes: readings above the threshold that no neighbouring receptors
            shared. They are 0 in `sensation`.
        num_fading: number of rows excluded because pressure fell, if readings decay slowly.
        lost: `(l,)` rows of lost packets: nearly all receptors are far from rest at once. They are
            neither in `rows` nor in `null`.
        loose: `(S,)` bool, receptors set aside as loose contacts. They feel nothing in `sensation`,
            and their threshold in `baseline` is infinite.
    """

    rows: np.ndarray
    q: np.ndarray
    sensation: np.ndarray
    baseline: Baseline
    null: np.ndarray
    successive: bool
    num_lone: int
    num_fading: int
    lost: np.ndarray
    loose: np.ndarray

    @property
    def silent(self) -> np.ndarray:
        """Indices of the receptors that never feel anything."""
        return np.flatnonzero(~self.sensation.any(axis=0))


def find_touches(
    q: np.ndarray,
    readings: np.ndarray,
    *,
    filtering: str | None = None,
    **known: Any,
) -> FoundTouches:
    """Finds the touches in a recording of raw readings.

    Args:
        q: as in `estimate_baseline`.
        readings: `(n, S)` raw, rows that touch and rows that do not, as recorded. Pressures with an
            offset of 0 are returned unchanged.
        filtering: "median" if each reading becomes the median of three rows; "none" if it stays as
            it is, even if it looks like a spike; by default a median where there are spikes and
            rows are successive in time.
        known: `offset`, `threshold` and `rising`, as in `estimate_baseline`.

    Raises:
        ValueError: shapes disagree, a number is not finite, nothing is felt, or rows without order
            in time cannot be filtered.

    Warns:
        RestlessWarning: most receptors feel something in most rows.
    """
    q, readings = checked_recording(q, readings)
    successive = are_successive(q)
    if filtering == "median" and not successive:
        raise ValueError(
            "filter is median, but the joints jump from row to row: give the rows in the order of "
            "time, or leave the filter out"
        )
    spikes = False if filtering == "none" else None
    rough = estimate_baseline(q, readings, spikes=False, **known)
    if "offset" in known and known["offset"] is not None:
        rest = estimate_baseline(q, readings, spikes=False)
    else:
        rest = rough
    is_lost = lost_rows(readings, rest.row, rest.level)
    kept = np.flatnonzero(~is_lost)
    if is_lost.any():
        readings = readings[kept]
        rough = estimate_baseline(q[kept], readings, spikes=False, **known)
    loose = loose_contacts(rough.touching(readings)[1] > 0, len(readings))
    if loose.any():
        readings = readings.copy()
        readings[:, loose] = np.median(rough.level[:, loose], axis=0).astype(readings.dtype)
    found = _find(q[kept], readings, successive, filtering, spikes, known)
    baseline = found.baseline
    if loose.any():
        limits = np.where(loose, np.inf, baseline.threshold)
        baseline = replace(baseline, threshold=limits)
    return replace(
        found,
        rows=kept[found.rows],
        null=kept[found.null],
        lost=np.flatnonzero(is_lost),
        loose=loose,
        baseline=baseline,
    )


def _find(
    q: np.ndarray,
    readings: np.ndarray,
    successive: bool,
    filtering: str | None,
    spikes: bool | None,
    known: dict[str, Any],
) -> FoundTouches:
    """As `find_touches`, from rows and receptors without faults."""
    baseline = estimate_baseline(q, readings, spikes=spikes, **known)
    if successive and (baseline.spikes or filtering == "median"):
        readings = _median_of_three(readings)
        again = estimate_baseline(q, readings, spikes=baseline.spikes, **known)
        baseline = replace(again, smoothed=True)
    rows, pressure = baseline.touching(readings)
    shared = baseline.shared(pressure > 0)
    num_lone = int(np.count_nonzero(pressure) - np.count_nonzero(shared))
    if num_lone:
        touching = shared.any(axis=1)
        rows, pressure = rows[touching], np.where(shared, pressure, np.float32(0.0))[touching]
    if not len(rows):
        raise ValueError(
            f"nothing is felt in {len(readings)} rows: the readings of all receptors stay within "
            "their thresholds; lower the threshold, or record touches"
        )
    _warn_of_restless_receptors(pressure, len(readings))
    null = np.setdiff1d(np.arange(len(readings)), rows, assume_unique=True)
    fading = _fading(rows, pressure.sum(axis=1, dtype=float)) & successive
    rows, pressure = rows[~fading], pressure[~fading]
    return FoundTouches(
        rows=rows,
        q=q[rows],
        sensation=pressure,
        baseline=baseline,
        null=null,
        successive=successive,
        num_lone=num_lone,
        num_fading=int(fading.sum()),
        lost=np.zeros(0, dtype=int),
        loose=np.zeros(readings.shape[1], dtype=bool),
    )


def _median_of_three(readings: np.ndarray) -> np.ndarray:
    """Each reading `(n, S)` becomes the median of three rows, which leaves out a spike."""
    from scipy.ndimage import median_filter  # no other run needs it

    return median_filter(readings, size=(3, 1), mode="nearest")


def _warn_of_restless_receptors(pressure: np.ndarray, num_rows: int) -> None:
    """Warns if half of the receptors of `(n, S)` pressures feel something in most of the rows."""
    if 2 * np.median(np.count_nonzero(pressure, axis=0)) > num_rows:
        warnings.warn(
            "half of the receptors feel something in more than half of the rows: record more rows "
            "without a touch, or give the correct offset",
            RestlessWarning,
            stacklevel=4,
        )


def _fading(rows: np.ndarray, total: np.ndarray) -> np.ndarray:
    """`(n,)` bool, rows in which pressure falls, if readings decay slowly; else none.

    After a touch ends, a slow receptor still reads it for a while. Pressure then falls in many more
    rows than it rises in, and falling readings show past touches. `rows` of the recording ascend;
    `total` is the sum of the pressures in each.
    """
    follows = np.diff(rows) == 1
    falls, rises = follows & (total[1:] < total[:-1]), follows & (total[1:] > total[:-1])
    if falls.sum() < _SLOW * rises.sum():
        return np.zeros(len(rows), dtype=bool)
    return np.append(False, follows & (total[1:] < _STEADY * total[:-1]))
