"""Faults of single receptors: dead, stuck, flickering, exchanged, or not where a file says (naive).

Fields of receptors overlap, so its neighbours tell when a receptor should feel something: what they
read, in the mean, is what is due there. A receptor that feels nothing of it is dead. One that feels
where nothing is due flickers. One that reads what is due at another place is in that place. Who is
a neighbour of whom, a file of places says, or touches that receptors share, or an earlier
recording.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.optimize import linear_sum_assignment

# Neighbours of a receptor, and how far they count, in distances to the third one.
_NEIGHBOURS, _REACH = 6, 1.2
# Receptors are neighbours by touches if these have at least this cosine.
_COMPANY = 0.05
# Readings count to this power: less lets weak ones speak too.
_POWER = 0.5
# Something is surely due above this share of what is due at the touched place; below it are the
# edges of a field.
_NEAR = 0.7
# Classes of what is due, for each of which the usual share of touches that are felt is learned, and
# the touches that a receptor must have in a class to count there.
_CLASSES = np.array([0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9])
_OF_CLASS = 10
# Touches that must be due before a receptor is blamed for missing them, those that must be due for
# sure if it never felt any, and those that it must have felt before it is unsteady, or moved.
_EXPECTED, _SURE, _FELT, _MOVED = 10.0, 5, 8, 20
# Fields overlap if receptors miss at most this share of what is surely due, and if readings are at
# least so much like what is due. On a ball whose receptors reach 1.1 times as far as the next one,
# of which a strip was touched, 0.23 are missed, and receptors beyond its rim would be called dead.
_SELDOM, _ALIKE = 0.1, 0.6
# A stuck receptor reads values within this share of its median in so many of the touches.
_SAME, _MOSTLY = 0.1, 0.8
# Parts of equal numbers of touches in which it is looked whether a receptor still feels.
_PARTS = 20
# Faults are looked for again without the readings of those that were found, at most so often.
_PASSES = 4
# A receptor that is stuck is so in so many of the last parts.
_SINCE = 3
# A receptor drops out if it misses so many of the touches that its neighbours make sure.
_MISSED = 0.35
# It flickers if it feels so many of its touches where nothing is due, and at least so
# many times the usual share.
_UNEXPECTED, _TIMES = 0.1, 4.0
# Its readings are those of another place if their cosine with what is due there is by this much
# greater, and at least this share of the usual cosine.
_BETTER, _AS_USUAL = 0.15, 0.5
# Or by this factor, if they are less like what is due at its own place than this share of the usual
# cosine: a receptor that moved by one and a half spacings. On a cube and a torus no other place was
# ever better than the own one, and 0.77 the least share.
_SLIGHTLY, _UNLIKE = 1.15, 0.6
# Whatever is better elsewhere: readings so much like those of the own place, as a share of the
# usual cosine, are not moved. On the rim of what was touched, where a receptor is felt on one side
# only, the share is smaller: receptors on an infant's torso that are well had 0.5.
_OWN, _ON_RIM = 0.75, 0.3


class Fault(StrEnum):
    """What may be wrong with a receptor, in the words of a table."""

    NONE = "well"
    DEAD = "dead"
    STUCK = "stuck"
    FLICKERS = "flickers"
    DROPS_OUT = "drops out"
    EXCHANGED = "exchanged"
    ELSEWHERE = "elsewhere"
    UNKNOWN = "never met"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkinFaults:
    """What is wrong with S receptors of one skin.

    Attributes:
        fault: `(S,)` values of `Fault`.
        evidence: S sentences; empty for receptors that are well.
        felt: `(S,)` touches that each felt.
        expected: `(S,)` touches that were due, by what its neighbours felt.
        missed: `(S,)` share of the touches right at its place that it did not feel; NaN without.
        unexpected: `(S,)` share of what it felt of which its neighbours felt nothing; NaN without.
        read_as: `(S,)` the receptor at whose place each one is found; itself, if all is well; -1
            where nobody knows.
        likeness: `(S,)` cosine of its readings with what is due there; NaN likewise.
        overlap: whether fields overlap so much that neighbours tell what a receptor should feel;
            else only stuck receptors are told, and those that died on the way.
    """

    fault: np.ndarray
    evidence: Sequence[str]
    felt: np.ndarray
    expected: np.ndarray
    missed: np.ndarray
    unexpected: np.ndarray
    read_as: np.ndarray
    likeness: np.ndarray
    overlap: bool

    @property
    def faulty(self) -> np.ndarray:
        """Numbers of the receptors with a fault; those that were never met have none."""
        well = np.isin(self.fault, [Fault.NONE, Fault.UNKNOWN])
        return np.flatnonzero(~well)


def neighbours_in_file(place: np.ndarray) -> np.ndarray:
    """`(S, S)` weights of the nearest receptors of each, by `(S, 3)` places; rows sum to 1."""
    apart = np.linalg.norm(place[:, None] - place, axis=2)
    np.fill_diagonal(apart, np.inf)
    number = min(_NEIGHBOURS, len(place) - 1)
    nearest = np.sort(apart, axis=1)[:, :number]
    near = apart <= nearest[:, -1:] * (1 + 1e-9)
    # Not by the nearest one: that may be the one whose place is wrong.
    reach = _REACH * nearest[:, min(2, number - 1)][:, None]
    return _rows_of_one(np.where(near, np.exp(-np.square(apart / reach)), 0.0))


def neighbours_by_touch(sensation: np.ndarray) -> np.ndarray:
    """`(S, S)` weights of receptors that feel the same of `(n, S)` touches; rows sum to 1 or 0."""
    share = _shares(sensation)
    norm = np.maximum(np.linalg.norm(share, axis=0), 1e-12)
    cosine = (share / norm).T @ (share / norm)
    np.fill_diagonal(cosine, 0.0)
    number = min(_NEIGHBOURS, len(cosine) - 1)
    least = np.sort(cosine, axis=1)[:, -number][:, None]
    return _rows_of_one(np.where((cosine >= least) & (cosine > _COMPANY), cosine, 0.0))


def surely_due(sensation: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """`(n, S)` bool, where something is surely due, in `(n, S)` touches, by `(S, S)` weights."""
    due = _shares(sensation) @ weight.T
    return due >= _NEAR * np.maximum(due.max(axis=1, keepdims=True), 1e-12)


def find_faults(
    sensation: np.ndarray,
    names: Sequence[str],
    neighbours: np.ndarray | None = None,
    on_place: np.ndarray | None = None,
) -> SkinFaults:
    """Finds what is wrong with receptors.

    Args:
        sensation: `(n, S)` touches in the order of time, 0 where nothing is felt.
        names: S, for the evidence.
        neighbours: `(S, S)` weights as in `neighbours_in_file`, or of an earlier recording. Without
            them, neighbours are those that feel the same touches, and nobody knows whether a
            receptor is in the wrong place, or whether one that never feels anything is dead.
        on_place: `(S,)` touches whose joints put what touches at the place of each receptor, if a
            body model says so.
    """
    number = sensation.shape[1]
    stuck = _stuck(sensation, names)
    working = np.maximum(sensation, 0.0)
    working[:, list(stuck)] = 0.0
    share = _shares(working)
    weight = neighbours_by_touch(working) if neighbours is None else neighbours
    healthy = np.ones(number, dtype=bool)
    healthy[list(stuck)] = False
    for _ in range(_PASSES):
        # What a faulty receptor reads must not be due beside it.
        counted = _Counted.of(share, weight, healthy)
        likeness = _likeness(share, weight * healthy)
        found = dict(stuck)
        moves: dict[int, int] = {}
        alike = _usual(likeness, counted) >= _ALIKE
        if neighbours is not None:
            found = _dead(counted, weight, on_place) | found
        if neighbours is not None and alike:
            beside = _likeness(share, (weight + np.eye(number)) * healthy)
            rim = (weight > 0) @ (counted.felt == 0)
            moved, moves = _misplaced(likeness, beside, counted, rim, names)
            found = moved | found
        found = _unsteady(counted, alike) | _dead_since(counted, len(sensation)) | found
        before, healthy = healthy, ~np.isin(np.arange(number), list(found))
        # Of mostly faulty receptors, the others tell nothing.
        if (before == healthy).all() or 2 * healthy.sum() < number:
            break
    read_as = np.where(counted.felt > 0, np.arange(number), -1)
    read_as[list(moves)] = list(moves.values())
    unmet = (counted.felt == 0) & ~np.isin(np.arange(number), list(found))
    found |= dict.fromkeys(
        np.flatnonzero(unmet).tolist(), (Fault.UNKNOWN, "felt nothing, and nothing was surely due")
    )
    verdicts = [found.get(n, (Fault.NONE, "")) for n in range(number)]
    return SkinFaults(
        fault=np.array([fault for fault, _ in verdicts], dtype=object),
        evidence=tuple(evidence for _, evidence in verdicts),
        felt=np.count_nonzero(sensation > 0, axis=0),
        expected=counted.expected.sum(axis=0),
        missed=counted.missed,
        unexpected=counted.unexpected,
        read_as=read_as,
        likeness=np.where(read_as >= 0, likeness[np.arange(number), read_as], np.nan),
        overlap=alike and counted.is_sure,
    )


#: What is wrong with receptors, by number: the fault and its evidence.
_Found = dict[int, tuple[Fault, str]]


@dataclass(frozen=True, slots=True, eq=False)
class _Counted:
    """What receptors felt beside what was expected of them; in `_PARTS` parts in order of time.

    Attributes:
        felt: `(S,)` touches.
        parts_felt: `(parts, S)` touches felt in each part.
        expected: `(parts, S)` touches that should have been felt in each part.
        sure: `(S,)` touches that a receptor should surely have felt.
        missed: `(S,)` share of these that it did not feel; NaN without.
        unexpected: `(S,)` share of what it felt where nothing was expected; NaN without.
    """

    felt: np.ndarray
    parts_felt: np.ndarray
    expected: np.ndarray
    sure: np.ndarray
    missed: np.ndarray
    unexpected: np.ndarray

    @property
    def usually_missed(self) -> float:
        """Share of what is surely due that receptors miss, in the median; 1 if nobody knows."""
        known = (self.felt >= _FELT) & (self.sure >= _EXPECTED)
        return float(np.median(self.missed[known])) if known.any() else 1.0

    @property
    def is_sure(self) -> bool:
        """Whether what is surely due is felt: fields overlap."""
        return self.usually_missed <= _SELDOM

    @staticmethod
    def of(share: np.ndarray, weight: np.ndarray, healthy: np.ndarray) -> "_Counted":
        """From `(n, S)` shares, `(S, S)` weights of neighbours, and `(S,)` who is listened to."""
        felt = share > 0
        due = share @ (weight * healthy).T
        due /= np.maximum(due.max(axis=1, keepdims=True), 1e-12)
        usual = _usual_rates(felt, due)
        rate = usual[np.digitize(due, _CLASSES) - 1]
        parts = np.array_split(np.arange(len(share)), min(_PARTS, max(len(share) // 10, 1)))
        sure = due >= _NEAR
        num_felt, num_sure = felt.sum(axis=0), sure.sum(axis=0)
        with np.errstate(invalid="ignore"):
            return _Counted(
                felt=num_felt,
                parts_felt=np.array([felt[rows].sum(axis=0) for rows in parts]),
                expected=np.array([rate[rows].sum(axis=0) for rows in parts]),
                sure=num_sure,
                missed=(sure & ~felt).sum(axis=0) / num_sure,
                unexpected=(felt & _elsewhere(felt, weight, healthy)).sum(axis=0) / num_felt,
            )


def _elsewhere(felt: np.ndarray, weight: np.ndarray, healthy: np.ndarray) -> np.ndarray:
    """`(n, S)` bool, touches of which nobody within two steps feels anything.

    Beside a hole of dead receptors, one may well feel a touch alone.
    """
    near = (weight > 0).astype(np.float32)
    near = np.minimum(near + near.T + near @ near, 1.0)
    np.fill_diagonal(near, 0.0)
    heard = felt & healthy
    nobody = heard.astype(np.float32) @ near == 0
    others = heard.sum(axis=1, keepdims=True) - heard > 0
    hole = (weight > 0) @ ~healthy
    return nobody & (others | ~hole)


def _shares(sensation: np.ndarray) -> np.ndarray:
    """Readings of each touch relative to its strongest, weak ones raised."""
    strongest = np.maximum(sensation.max(axis=1, keepdims=True, initial=0.0), 1e-30)
    return np.maximum(sensation / strongest, 0.0) ** _POWER


def _rows_of_one(weight: np.ndarray) -> np.ndarray:
    return weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-30)


def _usual_rates(felt: np.ndarray, due: np.ndarray) -> np.ndarray:
    """The share of touches that receptors feel, by how much is due: the median of receptors.

    Args:
        felt: `(n, S)` bool.
        due: `(n, S)` 0 to 1.
    """
    which = np.digitize(due, _CLASSES) - 1
    rates = np.zeros(len(_CLASSES))
    for number in range(len(_CLASSES)):
        there = which == number
        touches = there.sum(axis=0)
        known = (touches >= _OF_CLASS) & felt.any(axis=0)
        if known.any():
            rates[number] = np.median((there & felt).sum(axis=0)[known] / touches[known])
    # What is due more is not felt less.
    return np.maximum.accumulate(rates)


def _likeness(share: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """`(S, S)` cosine of the readings of each receptor with what is due at the place of each.

    A receptor's own readings do not count in what is due beside it.
    """
    gram = share.T @ share
    own = np.diag(gram)
    with_due = gram @ weight.T
    due_squared = np.einsum("ki,ij,kj->k", weight, gram, weight, optimize=True)
    without = with_due - own[:, None] * weight.T
    squared = due_squared[None] - 2 * weight.T * with_due + np.square(weight.T) * own[:, None]
    size = np.sqrt(np.maximum(squared * own[:, None], 0.0))
    return np.where(size > 1e-12, without / np.maximum(size, 1e-12), 0.0)


def _stuck(sensation: np.ndarray, names: Sequence[str]) -> _Found:
    """Receptors that read one value, whatever is touched, from some touch on."""
    parts = np.array_split(sensation, min(_PARTS, max(len(sensation) // 10, 1)))
    constant = []
    for part in parts:
        value = np.median(part, axis=0)
        same = np.abs(part - value) <= _SAME * value
        constant.append((value > 0) & (same.mean(axis=0) >= _MOSTLY))
    found: _Found = {}
    stands = np.array(constant)
    # All parts from the first to the last that differs are not stuck.
    since = len(parts) - np.cumprod(stands[::-1], axis=0).sum(axis=0)
    for receptor in np.flatnonzero(since <= len(parts) - min(_SINCE, len(parts))).tolist():
        value = float(np.median(parts[-1][:, receptor]))
        first = sum(len(part) for part in parts[: since[receptor]])
        when = f" from touch {first:,} on" if first else ""
        found[receptor] = Fault.STUCK, f"reads {value:.3g}{when}, whatever is touched"
    return found


def _dead(counted: _Counted, weight: np.ndarray, on_place: np.ndarray | None) -> _Found:
    """Receptors that feel nothing, though touches press their neighbours on all sides."""
    silent = counted.felt == 0
    found: _Found = {}
    for receptor in np.flatnonzero(silent).tolist():
        if counted.is_sure and counted.sure[receptor] >= _SURE:
            found[receptor] = (
                Fault.DEAD,
                f"felt none of {counted.sure[receptor]:,} touches that its neighbours felt",
            )
        elif on_place is not None and on_place[receptor] >= _SURE:
            found[receptor] = (
                Fault.DEAD,
                f"felt none of {on_place[receptor]:,} touches that the joints put on it",
            )
    # Where a board is dead, touches in its middle are felt by nobody.
    near = (weight > 0).astype(int)
    while True:
        dead = np.isin(np.arange(len(silent)), list(found))
        inside = silent & ~dead & (near @ dead > near.sum(axis=1) / 2)
        if not inside.any():
            return found
        for receptor in np.flatnonzero(inside).tolist():
            found[receptor] = Fault.DEAD, "felt nothing, and most of its neighbours are dead"


def _dead_since(counted: _Counted, num_touches: int) -> _Found:
    """Receptors that feel nothing from some touch on, though touches are due."""
    found: _Found = {}
    parts = len(counted.expected)
    last = parts - 1 - np.argmax((counted.parts_felt > 0)[::-1], axis=0)
    for receptor in np.flatnonzero(counted.felt > 0).tolist():
        after = slice(last[receptor] + 1, parts)
        due, before = counted.expected[after, receptor].sum(), slice(0, last[receptor] + 1)
        usual = counted.parts_felt[before, receptor].sum() / max(
            counted.expected[before, receptor].sum(), 1e-9
        )
        if min(usual, 1.0) * due >= _EXPECTED:
            first = num_touches * (last[receptor] + 1) // parts
            found[receptor] = (
                Fault.DEAD,
                f"felt none of some {due:.0f} touches due after touch {first:,}",
            )
    return found


def _usual(likeness: np.ndarray, counted: _Counted) -> float:
    """Median cosine of readings with what is due at their own place; 0 if nobody knows."""
    known = counted.felt >= _FELT
    return float(np.median(np.diag(likeness)[known])) if known.any() else 0.0


def _misplaced(
    likeness: np.ndarray,
    beside: np.ndarray,
    counted: _Counted,
    rim: np.ndarray,
    names: Sequence[str],
) -> tuple[_Found, dict[int, int]]:
    """Receptors that read what is due at the place of another, and which one that is.

    Args:
        likeness: `(S, S)` with what is due at each place.
        beside: `(S, S)` with that and what the receptor there reads itself, if it is another one.
        counted: what was felt.
        rim: `(S,)` bool, receptors of which a neighbour never felt anything.
        names: S.
    """
    own = np.diag(likeness)
    usual = _usual(likeness, counted)
    best = likeness.argmax(axis=1)
    most = likeness.max(axis=1)
    far = (most - own > _BETTER) & (most >= _AS_USUAL * usual)
    # Between the places of others, it reads what these do.
    between = (own < _UNLIKE * usual) & (beside.max(axis=1) > _SLIGHTLY * own)
    between &= beside.max(axis=1) >= _AS_USUAL * usual
    best = np.where(between & ~far, beside.argmax(axis=1), best)
    unlike = own < np.where(rim, _ON_RIM, _OWN) * usual
    moved = (far | between) & (counted.felt >= _MOVED) & unlike
    at = dict(zip(np.flatnonzero(moved).tolist(), best[moved].tolist(), strict=True))
    # Receptors that change places explain each other, also those that moved little.
    rows = np.union1d(np.flatnonzero(moved), best[moved])
    one, other = linear_sum_assignment(-likeness[np.ix_(rows, rows)])
    for row, place in zip(rows[one].tolist(), rows[other].tolist(), strict=True):
        least = most[row] - _BETTER if moved[row] else own[row]
        if row != place and likeness[row, place] > least:
            at[row] = place
    there = np.where(between[:, None], beside, likeness)
    found: _Found = {}
    ringed = {receptor for ring in rings(at) for receptor in ring}
    for receptor, place in at.items():
        fault = Fault.EXCHANGED if receptor in ringed else Fault.ELSEWHERE
        where = "reads" if receptor in ringed else "reads about"
        found[receptor] = (
            fault,
            f"{where} what {names[place]} should: likeness {there[receptor, place]:.2f} there, "
            f"{own[receptor]:.2f} at its own place",
        )
    return found, at


def rings(at: dict[int, int]) -> list[list[int]]:
    """Receptors that read in each other's place, in rounds: two are exchanged."""
    found: list[list[int]] = []
    seen: set[int] = set()
    for start in at:
        ring = [start]
        while (following := at.get(ring[-1], -1)) not in (-1, *ring):
            ring.append(following)
        if following == start and start not in seen and len(ring) > 1:
            found.append(ring)
            seen |= set(ring)
    return found


def _unsteady(counted: _Counted, alike: bool) -> _Found:
    """Receptors that feel where nothing is due, or often do not feel where it is.

    Args:
        counted: what was felt.
        alike: whether receptors read what is due.
    """
    found: _Found = {}
    known = counted.felt >= _FELT
    if not known.any():
        return found
    usual = float(np.median(counted.unexpected[known]))
    usually_missed = counted.usually_missed
    for receptor in np.flatnonzero(known).tolist():
        alone = counted.unexpected[receptor]
        if alike and alone > max(_UNEXPECTED, _TIMES * usual):
            found[receptor] = (
                Fault.FLICKERS,
                f"its neighbours felt nothing in {alone:.0%} of the {counted.felt[receptor]:,} "
                f"touches that it felt ({usual:.0%} is usual)",
            )
        elif (counted.is_sure and counted.sure[receptor] >= _EXPECTED) and (
            counted.missed[receptor] > usually_missed + _MISSED
        ):
            found[receptor] = (
                Fault.DROPS_OUT,
                f"missed {counted.missed[receptor]:.0%} of the {counted.sure[receptor]:,} touches "
                f"that its neighbours felt ({usually_missed:.0%} is usual)",
            )
    return found
