"""What changed in a skin between two recordings (naive): receptors, gain, and where it sits."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.readings.receptor_faults import (
    Fault,
    SkinFaults,
    find_faults,
    neighbours_by_touch,
    surely_due,
)

# A gain changed if it did so by this factor and by so many standard errors; receptors that felt
# fewer touches have none.
_FACTOR, _ERRORS, _LEAST = 1.3, 4.0, 20
# One of so many receptors may change its gain, at most.
_MOST_CHANGED = 5
# Weight of the squares in the regression on shares of neighbours.
_RIDGE = 0.3
# Receptors that show how a skin moved, at least.
_FEWEST = 6
# Rounds in which outliers lose their weight when a skin is laid on itself.
_ROUNDS = 20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkinDrift:
    """Two recordings of one skin of S receptors.

    Attributes:
        before: what was wrong in the first one.
        after: what is wrong in the second one; without a file, places are those of the first.
        gain: `(S,)` factor by which readings grew beside those of neighbours; NaN where unknown.
        gain_sigma: `(S,)` standard error of its logarithm.
        changes: a line for each receptor that changed: its number, what, and the evidence.
    """

    before: SkinFaults
    after: SkinFaults
    gain: np.ndarray
    gain_sigma: np.ndarray
    changes: Sequence[tuple[int, str, str]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkinMove:
    """How a skin as a whole moved against the joints.

    Attributes:
        shift: how far its middle moved, as a share of the skin's extent.
        shift_sigma: standard error of each of its three parts.
        turn: rad, by which it turned.
        turn_sigma: rad, standard error likewise.
        surely: whether it is more than chance and than touches at other places explain.
    """

    shift: float
    shift_sigma: float
    turn: float
    turn_sigma: float
    surely: bool


def compare_skins(
    before: np.ndarray,
    after: np.ndarray,
    names: Sequence[str],
    neighbours: np.ndarray | None = None,
) -> SkinDrift:
    """Compares two recordings of one skin.

    Args:
        before: `(n, S)` touches of the first, in the order of time.
        after: `(m, S)` touches of the second.
        names: S, for the evidence.
        neighbours: `(S, S)` weights of a file; by default receptors that feel the same touches of
            the first recording.
    """
    first = find_faults(before, names, neighbours)
    if neighbours is None:
        usable = before.copy()
        usable[:, first.faulty] = 0.0
        neighbours = neighbours_by_touch(usable)
    second = find_faults(after, names, neighbours)
    well = (first.fault == Fault.NONE) & (second.fault == Fault.NONE)
    gain, sigma = _gains(before, after, neighbours, well)
    changed = _changed(gain, sigma)
    changes = []
    for receptor in range(len(names)):
        was, now = first.fault[receptor], second.fault[receptor]
        if was != now and Fault.UNKNOWN not in (was, now):
            evidence = second.evidence[receptor] or f"was: {first.evidence[receptor]}"
            changes.append((receptor, f"{was} -> {now}", evidence))
        elif was == now == Fault.EXCHANGED and first.read_as[receptor] != second.read_as[receptor]:
            changes.append((receptor, f"{was} anew", second.evidence[receptor]))
        elif changed[receptor]:
            what = "weaker" if gain[receptor] < 1 else "stronger"
            changes.append(
                (
                    receptor,
                    what,
                    f"reads {gain[receptor]:.2f} times as much beside its neighbours as before "
                    f"(± {1.96 * sigma[receptor] * gain[receptor]:.2f})",
                )
            )
    return SkinDrift(
        before=first, after=second, gain=gain, gain_sigma=sigma, changes=tuple(changes)
    )


def _gains(
    before: np.ndarray, after: np.ndarray, neighbours: np.ndarray, well: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`(S,)` factors of the readings of receptors that are well, and errors of their logarithms.

    A receptor that changed shifts its neighbours too: the surest change is taken first, and its
    readings no longer count for the others.
    """
    gain, sigma = np.full((2, len(well)), np.nan)
    judges = well.copy()
    for _ in range(len(well) // _MOST_CHANGED + 1):
        gains, sigmas = _gains_beside(before, after, neighbours, judges)
        gain[judges], sigma[judges] = gains[judges], sigmas[judges]
        sure = np.where(judges & _changed(gains, sigmas), np.abs(np.log(gains)) / sigmas, 0.0)
        if not sure.any():
            break
        judges[int(sure.argmax())] = False
    return gain, sigma


def _changed(gain: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Whether gains are surely not 1."""
    return np.abs(np.log(gain)) > np.maximum(np.log(_FACTOR), _ERRORS * sigma)


def _gains_beside(
    before: np.ndarray, after: np.ndarray, neighbours: np.ndarray, well: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Gains and their errors, beside neighbours that are well."""
    change, sigma = np.full((2, len(well)), np.nan)
    near = [surely_due(some, neighbours * well) for some in (before, after)]
    for receptor in np.flatnonzero(well).tolist():
        beside = np.flatnonzero((neighbours[receptor] > 0) & well)
        if len(beside):
            change[receptor], sigma[receptor] = _gain(
                *(
                    _log_ratios(some, rows[:, receptor], receptor, beside)
                    for some, rows in zip((before, after), near, strict=True)
                )
            )
    # Both recordings may press more firmly, or less.
    if np.isfinite(change).any():
        change -= np.nanmedian(change)
    return np.exp(change), sigma


def _log_ratios(
    sensation: np.ndarray, near: np.ndarray, receptor: int, beside: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Of the touches of a receptor: readings beside those of neighbours, and how these share them.

    Returns:
        `(n,)` logarithms, and `(n, f)` shares, their squares and products.
    """
    others = np.maximum(sensation[:, beside], 0.0)
    total = others.sum(axis=1)
    rows = near & (sensation[:, receptor] > 0) & (total > 0)
    share = others[rows] / total[rows, None]
    i, j = np.triu_indices(len(beside))
    features = np.concatenate([share, share[:, i] * share[:, j]], axis=1)
    return np.log(sensation[rows, receptor] / total[rows]), features


def _gain(
    before: tuple[np.ndarray, np.ndarray], after: tuple[np.ndarray, np.ndarray]
) -> tuple[float, float]:
    """Logarithm of a gain and its standard error: what the shares of neighbours do not explain."""
    if min(len(before[0]), len(after[0])) < _LEAST:
        return np.nan, np.nan
    middle, features = np.median(before[0]), before[1] - before[1].mean(axis=0)
    # Where the touch lies among the neighbours explains most; a few touches must not be learned.
    normal = features.T @ features + _RIDGE * np.eye(features.shape[1])
    slope = np.linalg.solve(normal, features.T @ (before[0] - middle))
    left = [ratio - (some - before[1].mean(axis=0)) @ slope for ratio, some in (before, after)]
    medians = [float(np.median(one)) for one in left]
    spreads = [
        1.4826 * float(np.median(np.abs(one - median)))
        for one, median in zip(left, medians, strict=True)
    ]
    errors = [
        1.2533 * spread / np.sqrt(len(one)) for spread, one in zip(spreads, left, strict=True)
    ]
    return medians[1] - medians[0], float(np.hypot(*errors))


def field_centres(place: np.ndarray, sensation: np.ndarray) -> np.ndarray:
    """`(S, 3)` where each receptor feels: the mean of `(n, 3)` places, by readings; NaN if few."""
    known = np.isfinite(place).all(axis=1)
    reading = np.maximum(sensation[known], 0.0)
    total = reading.sum(axis=0)
    with np.errstate(invalid="ignore"):
        centre = (reading.T @ place[known]) / total[:, None]
    centre[np.count_nonzero(reading, axis=0) < _LEAST] = np.nan
    return centre


def skin_move(before: np.ndarray, after: np.ndarray, least: float = 0.005) -> SkinMove | None:
    """How `(S, 3)` places of receptors moved as a whole; None if fewer than six are known.

    Args:
        before: places in the first recording, by one body model; NaN where unknown.
        after: likewise in the second, by the same model.
        least: share of the extent that touches at other places may explain.
    """
    known = np.isfinite(before).all(axis=1) & np.isfinite(after).all(axis=1)
    if known.sum() < _FEWEST:
        return None
    start, end = before[known], after[known]
    weight = np.ones(len(start))
    for _ in range(_ROUNDS):
        share = weight / weight.sum()
        middles = share @ start, share @ end
        a, b = start - middles[0], end - middles[1]
        U, _, Vt = np.linalg.svd((share[:, None] * b).T @ a)
        turn = (U * [1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
        off = np.linalg.norm(b - a @ turn.T, axis=1)
        weight = 1.0 / (1.0 + np.square(off / max(2.0 * np.median(off), 1e-12))) ** 2
    extent = float(np.linalg.norm(np.ptp(start, axis=0)))
    number = share.sum() ** 2 / np.square(share).sum()
    scatter = np.sqrt((share @ np.square(off)) / 3 / max(number - 2, 1))
    arm = np.sqrt(share @ np.square(a).sum(axis=1) * 2 / 3)
    shift = float(np.linalg.norm(middles[1] - middles[0]) / extent)
    shift_sigma, turn_sigma = float(scatter / extent), float(scatter / arm)
    angle = float(np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0)))
    moved = shift > max(least, _ERRORS * shift_sigma)
    turned = angle > max(4 * least, _ERRORS * turn_sigma)
    return SkinMove(
        shift=shift,
        shift_sigma=shift_sigma,
        turn=angle,
        turn_sigma=turn_sigma,
        surely=moved or turned,
    )
