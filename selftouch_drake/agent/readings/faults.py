"""Faults of recordings that look like touches or movements (naive): found in the numbers alone.

Each function finds one fault. What a fault is depends on how the rest of the recording looks:
nothing is a fault that happens all the time.
"""

from itertools import pairwise

import numpy as np

#: Share of the receptors that a row of a lost packet presses, and that ordinary touches do not.
_NEARLY_ALL, _ORDINARY = 0.9, 0.5
#: Rows of lost packets are at most this share, else the skin is so.
_SELDOM = 0.2
#: Standard deviations of the noise, as in `baseline`.
_SILENCE = 6.0
#: A mark is rare, appears at least twice, and stands apart from all other values.
_MARK_SHARE, _MARK_TIMES, _MARK_VALUES = 0.2, 2, 8
#: Rows after which a joint that jumped away is back, if that was a fault.
_BRIEF = 3
#: A jump is this share of the range of a joint, and so many of its usual steps.
_JUMP_SHARE, _JUMP_STEPS = 0.25, 8.0
#: A row of zeros is no posture if the joints are so many usual steps away before and after it.
_ZERO_STEPS = 3.0
#: Share of the runs of equal rows that have the usual length, if values are held at a fixed rate.
_AT_A_RATE = 0.8
#: Correlation of a joint's steps with another column, if that is its velocity.
_VELOCITY = 0.9
#: Receptors feel in company if their fields overlap: share of the rows, of a typical receptor.
_COMPANY = 0.8
#: A loose contact has more touches than a typical receptor, in at least this share of the rows, and
#: lacks company so many times as often.
_LOOSE_SHARE, _LOOSE_ALONE = 0.01, 3.0
#: A board of the skin has so many receptors at least, and is lost so many times at least.
_BOARD, _BOARD_TIMES = 8, 3
#: Rows that a skin is frozen for at least, and the share of its readings that may stand still.
_FROZEN, _FREEZES = 8, 0.1
#: Rows from which values are sampled.
_SAMPLE = 20_000
_BLOCK = 8192


def marks_of_nothing(values: np.ndarray) -> list[float]:
    """Numbers that stand for a missing value, such as -1, 65535 or -999, among `(n, k)` values.

    A mark is the least or the greatest value, comes back exactly, is rare, no column's usual value
    and farther from all other values than these are from each other; or -1 among numbers that are
    never negative.
    """
    if not values.size:
        return []
    usual = np.median(values[:: -(-len(values) // _SAMPLE)], axis=0)
    found: list[float] = []
    left = np.ones(values.shape, dtype=bool)
    for lowest in (True, False, True):
        bounds = _bounds(values, left)
        if bounds is None:
            break
        mark = bounds[0] if lowest else bounds[1]
        at_mark = values == mark
        times = int(np.count_nonzero(at_mark))
        if not _MARK_TIMES <= times <= _MARK_SHARE * values.size:
            continue
        bounds = _bounds(values, left & ~at_mark)
        if bounds is None:
            break
        least, most = bounds
        gap = least - mark if lowest else mark - most
        sample = values[:: -(-len(values) // _SAMPLE)]
        several = len(np.unique(sample)) > _MARK_VALUES
        stands_apart = gap > most - least and several
        minus_one = lowest and mark == -1 and least >= 0
        if (stands_apart or minus_one) and np.mean(usual == mark) < 0.5:
            found.append(mark)
            left &= ~at_mark
    return found


def _bounds(values: np.ndarray, where: np.ndarray) -> tuple[float, float] | None:
    """The least and the greatest of some values; None if there are none."""
    if not where.any():
        return None
    return float(values[where].min()), float(values[where].max())


def lost_rows(readings: np.ndarray, row: np.ndarray, level: np.ndarray) -> np.ndarray:
    """`(n,)` bool, rows of a lost packet: nearly all receptors are far from rest at once.

    Args:
        readings: `(n, S)` raw.
        row: `(W,)` rows at which the resting level is known.
        level: `(W, S)` resting level there.
    """
    sample = np.arange(0, len(readings), -(-len(readings) // _SAMPLE))
    apart = readings[sample] - _between(row, level, sample)
    low, high = np.quantile(apart, [0.159, 0.841], axis=0)
    noise = np.minimum(np.maximum(-low, 0.0), np.maximum(high, 0.0))
    moves = np.ptp(readings, axis=0) > 0
    step = np.array([_quantisation(values) for values in readings[sample].T])
    limit = _SILENCE * noise + 1.5 * step * (noise > 0)
    share, constant = np.zeros(len(readings)), np.zeros(len(readings), dtype=bool)
    if moves.sum() < 4:
        return constant
    for start in range(0, len(readings), _BLOCK):
        block = readings[start : start + _BLOCK]
        rows = start + np.arange(len(block))
        far = np.abs(block - _between(row, level, rows)) > limit
        share[rows] = far[:, moves].mean(axis=1)
        constant[rows] = np.ptp(block[:, moves], axis=1) == 0
    full = share >= _NEARLY_ALL
    others = share[~full & (share > 0)]
    if not full.any() or full.mean() > _SELDOM or not len(others):
        return np.zeros(len(readings), dtype=bool)
    if np.quantile(others, 0.99) < _ORDINARY:
        return full
    # Touches press most of this skin. What comes at once, in one value everywhere or in the same
    # values as before, and goes at once, is still no touch.
    rows = np.flatnonzero(full)
    _, which = np.unique(readings[rows], axis=0, return_inverse=True)
    starts = np.insert(np.diff(rows) > 1, 0, True)
    again = np.bincount(which.ravel(), weights=starts)[which.ravel()] > 1
    same = np.zeros(len(readings), dtype=bool)
    same[rows] = constant[rows] | again
    beside = (np.append(full[1:] & ~same[1:], False)) | np.append(False, full[:-1] & ~same[:-1])
    several = len(np.unique(readings[sample])) > _MARK_VALUES
    return same & ~beside & (moves.sum() >= 6) & several


def lost_boards(readings: np.ndarray) -> np.ndarray:
    """`(n,)` bool, rows in which one board of the skin is lost: its receptors read one end at once.

    The same receptors, and no others, come to the least or greatest reading and go from it
    together, again and again. Touches never repeat so exactly.

    Args:
        readings: `(n, S)` raw.
    """
    lost = np.zeros(len(readings), dtype=bool)
    if readings.shape[1] < _BOARD or not len(readings):
        return lost
    usual = np.median(readings[:: -(-len(readings) // _SAMPLE)], axis=0)
    for end in (readings.min(), readings.max()):
        # Receptors that rest at the end are not lost there.
        away = usual != end
        at_end = (readings == end) & away
        num_at_end = at_end.sum(axis=1)
        # The whole skin is no board: that is a lost packet.
        board = (num_at_end >= _BOARD) & (num_at_end < _NEARLY_ALL * away.sum())
        rows = np.flatnonzero(board)
        if not 0 < len(rows) <= _SELDOM * len(readings):
            continue
        sets, which = np.unique(np.packbits(at_end[rows], axis=1), axis=0, return_inverse=True)
        which = which.ravel()
        before, after = rows - 1, rows + 1
        before[0], after[-1] = max(before[0], 0), min(after[-1], len(readings) - 1)
        size = at_end[rows].sum(axis=1)
        # Beside a lost row, the board is either lost as well or not at its end at all.
        for beside in (before, after):
            shared = (at_end[beside] & at_end[rows]).sum(axis=1)
            sharp = (shared == size) | (shared <= 0.2 * size)
            which = np.where(sharp, which, len(sets))
        times = np.bincount(which, minlength=len(sets) + 1)
        times[len(sets)] = 0
        lost[rows[times[which] >= _BOARD_TIMES]] = True
    return lost


def frozen_rows(values: np.ndarray, others: np.ndarray, follows: np.ndarray) -> np.ndarray:
    """`(n,)` bool, rows that repeat stale readings, of a skin whose readings always change.

    Args:
        values: `(n, S)` readings of the skin.
        others: `(n, J)` joints, which go on.
        follows: `(n - 1,)` bool, whether the next row follows in time.
    """
    frozen = np.zeros(len(values), dtype=bool)
    if len(values) < 100:
        return frozen
    same = follows & (values[1:] == values[:-1]).all(axis=1)
    fresh = np.flatnonzero(np.insert(~same, 0, True))
    ends = np.append(fresh[1:], len(values))
    resting = np.median(values[:: -(-len(values) // _SAMPLE)], axis=0)
    felt = (values[fresh] != resting).any(axis=1)
    lengths = ends - fresh
    if felt.sum() < 20 or np.mean(lengths[felt] == 1) < 1 - _FREEZES:
        return frozen
    for run in np.flatnonzero(felt & (lengths >= _FROZEN)):
        moved = np.abs(np.diff(others[fresh[run] : ends[run]], axis=0)).any(axis=1)
        if moved.mean() > 0.5:
            frozen[fresh[run] + 1 : ends[run]] = True
    return frozen


def jumping_rows(q: np.ndarray, follows: np.ndarray, period: np.ndarray) -> np.ndarray:
    """`(n,)` bool, rows in which a joint jumps away and is back after at most three rows.

    Args:
        q: `(n, J)` in the order of time.
        follows: `(n - 1,)` bool, whether the next row follows in time.
        period: `(J,)` turn after which a joint's reading begins again; 0 if it does not.
    """
    wrong = np.zeros(len(q), dtype=bool)
    if len(q) < 100:
        return wrong
    steps = turned_steps(q, period)
    usual = np.array([np.median(s[s > 0]) if (s > 0).any() else 0.0 for s in steps.T])
    low, high = np.quantile(q, [0.02, 0.98], axis=0)
    zeros = (q == 0).all(axis=1)
    if 0 < zeros.sum() < _SELDOM * len(q) and q.shape[1] > 1:
        far = (steps > _ZERO_STEPS * usual).any(axis=1) & (zeros[1:] != zeros[:-1])
        edges = np.flatnonzero(np.diff(zeros.astype(int), prepend=0, append=0))
        for start, end in zip(edges[::2], edges[1::2], strict=True):
            before, after = start == 0 or far[start - 1], end == len(q) or far[end - 1]
            wrong[start:end] = before and after and end - start <= _BRIEF
    limit = np.maximum(_JUMP_SHARE * (high - low), _JUMP_STEPS * usual)
    for joint in np.flatnonzero(high > low):
        jumps = np.flatnonzero((steps[:, joint] > limit[joint]) & follows)
        for away, back in pairwise(jumps.tolist()):
            if back - away > _BRIEF or wrong[away] or wrong[back + 1]:
                continue
            apart = np.abs(q[away, joint] - q[back + 1, joint])
            if period[joint]:
                apart = min(apart, period[joint] - apart)
            if apart < 0.5 * min(steps[away, joint], steps[back, joint]):
                wrong[away + 1 : back + 1] = True
    return wrong


def turned_steps(q: np.ndarray, period: np.ndarray) -> np.ndarray:
    """`(n - 1, J)` size of the steps of `(n, J)` joints, the short way round where they turn."""
    steps = np.abs(np.diff(q.astype(float), axis=0))
    turns = period > 0
    steps[:, turns] %= period[turns]
    steps[:, turns] = np.minimum(steps[:, turns], period[turns] - steps[:, turns])
    return steps


def held_every(values: np.ndarray, others: np.ndarray, follows: np.ndarray) -> np.ndarray | None:
    """Rows that repeat the values before them, if values are read less often than rows are written.

    Args:
        values: `(n, k)`, of the joints or of the skin.
        others: `(n, l)`, of the other; they go on while the values are held.
        follows: `(n - 1,)` bool, whether the next row follows in time.

    Returns:
        `(n,)` bool, the repeated rows; None if values are not held, or not at a fixed rate.
    """
    same = follows & (values[1:] == values[:-1]).all(axis=1)
    goes_on = (others[1:] != others[:-1]).any(axis=1)
    fresh = np.flatnonzero(np.insert(~same, 0, True))
    lengths = np.diff(np.append(fresh, len(values)))
    # Where nothing is felt, nothing changes, however often it is read; so where nothing moves.
    resting = np.median(values[:: -(-len(values) // _SAMPLE)], axis=0)
    counts = lengths[(values[fresh] != resting).any(axis=1)]
    if len(counts) < 20 or np.mean(counts == 1) > 1 - _AT_A_RATE:
        return None
    usual = int(np.median(counts))
    regular = np.mean((counts >= usual - 1) & (counts <= usual + 1) & (counts > 1))
    if usual < 2 or regular < _AT_A_RATE or goes_on[same].sum() <= 0.5 * same.sum():
        return None
    return np.insert(same, 0, False)


def velocities(q: np.ndarray, follows: np.ndarray, time_s: np.ndarray | None) -> np.ndarray:
    """`(J,)` bool, columns that are velocities of others, or come after them, as efforts do.

    Velocities are the second half or third, or every second or third column, from the second on.
    All of them must fit with one ratio, and a single one in the unit of the time.
    """
    num_columns = q.shape[1]
    found = np.zeros(num_columns, dtype=bool)
    if follows.sum() < 100:
        return found
    orders = []
    for groups in (2, 3):
        num, rest = divmod(num_columns, groups)
        if rest or not num:
            continue
        number = np.arange(num_columns)
        # Columns of positions and of velocities, and those that are not of positions.
        orders.append((slice(0, num), slice(num, 2 * num), number >= num))
        orders.append((slice(0, None, groups), slice(1, None, groups), number % groups > 0))
    steps, middle = np.diff(q, axis=0)[follows], 0.5 * (q[1:] + q[:-1])[follows]
    if time_s is not None:
        dt = np.diff(time_s)[follows]
        steps = steps[dt > 0] / dt[dt > 0, None]
        middle = middle[dt > 0]
    if len(steps) < 100:
        return found
    for places, speeds, others in orders:
        a, b = steps[:, places], middle[:, speeds]
        # Rounding gives the standard deviation of a joint that stands still another value than 0.
        alive = (np.ptp(a, axis=0) > 0) & (np.ptp(b, axis=0) > 0)
        if not alive.any():
            continue
        a, b = a[:, alive], b[:, alive]
        scale = a.std(axis=0) * b.std(axis=0)
        alike = ((a - a.mean(axis=0)) * (b - b.mean(axis=0))).mean(axis=0) / scale
        ratio = a.std(axis=0) / b.std(axis=0)
        one_ratio = ratio.max() < 1.25 * ratio.min() and alive.sum() > 1
        in_time = time_s is not None and bool((np.abs(ratio - 1.0) < 0.1).all())
        if (alike > _VELOCITY).all() and (one_ratio or in_time):
            return others
    return found


def loose_contacts(felt: np.ndarray, num_rows: int) -> np.ndarray:
    """`(S,)` bool, receptors that are pressed much longer than others, whatever these feel.

    A pressed skin presses neighbours too, where fields overlap. A loose contact is on alone, or at
    times with a touch elsewhere, by chance. A receptor with no neighbours that is touched is never
    on while there is a touch elsewhere.

    Args:
        felt: `(n, S)` bool, the rows in which something is felt.
        num_rows: of the whole recording.
    """
    counts = felt.sum(axis=0).astype(float)
    num_felt = felt.sum(axis=1)
    alive = counts > 0
    found = np.zeros(felt.shape[1], dtype=bool)
    if alive.sum() < 4:
        return found
    in_company = (felt & (num_felt > 1)[:, None]).sum(axis=0)
    company = in_company / np.maximum(counts, 1.0)
    typical = np.median(counts[alive])
    if np.median(company[alive]) < _COMPANY:
        return found
    # How often something is felt elsewhere, whatever a receptor itself feels.
    elsewhere = ((num_felt[:, None] - felt) > 0).sum(axis=0) / num_rows
    by_chance = (company > 0.5 * elsewhere) & (company < 0.75 * elsewhere + 0.25)
    by_chance &= 1.0 - company > _LOOSE_ALONE * (1.0 - np.median(company[alive]))
    often = (counts > typical) & (counts > _LOOSE_SHARE * num_rows)
    found = alive & often & by_chance
    return found if found.sum() < 0.2 * alive.sum() else np.zeros_like(found)


def _quantisation(values: np.ndarray) -> float:
    """The smallest difference of `(n,)` values; 0 if they are all equal."""
    known = np.unique(values)
    return float(np.diff(known.astype(float)).min()) if len(known) > 1 else 0.0


def _between(row: np.ndarray, level: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """`(n, S)` levels interpolated at `rows`; constant before the first and after the last."""
    return np.stack([np.interp(rows, row, of_receptor) for of_receptor in level.T], axis=1)
