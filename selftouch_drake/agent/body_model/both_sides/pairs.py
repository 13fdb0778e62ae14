"""Limbs that come in pairs, told from their readings before any body is known.

Limbs of a pair are alike, and touch the body alike: each joint of one has a counterpart in the
other that is read over the same range, or over its mirror image. So which joints correspond, and
in which sense, is told by how the readings of touches are distributed.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from selftouch_drake.agent.body_model.both_sides.limbs import ends_of_limbs
from selftouch_drake.agent.body_model.both_sides.recordings import (
    Layout,
    Recording,
    same_posture,
)

# Touches within so many rad are one posture.
_ONE_POSTURE = 0.02
# Quantiles that are compared.
_QUANTILES = np.linspace(0.02, 0.98, 49)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Counterparts:
    """How the joints of two limbs correspond.

    Attributes:
        columns: `(L,)` joint of the second limb for each joint of the first.
        apart: rad, mean distance of the distributions of counterparts.
    """

    columns: list[int]
    apart: float


def counterparts(
    recordings: Sequence[Recording], layout: Layout, first: str, second: str
) -> Counterparts:
    """Joints of two limbs that are read alike.

    Args:
        recordings: of one body.
        layout: its limbs; these two have the same number of joints.
        first: name of the limb whose joints stay in their order.
        second: name of the other one.
    """
    apart = _apart(recordings, layout, first, second).min(axis=0)
    rows, columns = linear_sum_assignment(apart)
    there = list(layout.limbs[second])
    return Counterparts(
        columns=[there[column] for column in columns], apart=float(apart[rows, columns].mean())
    )


def senses(recordings: Sequence[Recording], layout: Layout, first: str, second: str) -> np.ndarray:
    """`(L,)` 1 if counterparts are read over one range, -1 over its mirror image.

    Args:
        recordings: of one body.
        layout: its limbs; the joints of these two are in the same order.
        first: name of a limb.
        second: name of the other one.
    """
    same, mirror = np.diagonal(_apart(recordings, layout, first, second), axis1=1, axis2=2)
    return np.where(same < mirror, 1, -1)


def paired(recordings: Sequence[Recording], layout: Layout) -> Layout:
    """The same layout with its most alike limbs as a pair, joints of the second in their order.

    Limbs that carry other kinds of ends are no pair; nor are those of which no recording has the
    first one alone.

    Args:
        recordings: of one body.
        layout: its limbs.
    """
    best, found = np.inf, layout
    ends = ends_of_limbs(recordings, layout.holder)
    kinds = {name: (ends[name], len(joints)) for name, joints in layout.limbs.items()}
    for pair in itertools.combinations(layout.limbs, 2):
        if kinds[pair[0]] != kinds[pair[1]]:
            continue
        touching = [_limbs(one, layout) for one in recordings]
        alone = [
            (first, second)
            for first, second in (pair, pair[::-1])
            if any(first in limbs and second not in limbs for limbs in touching)
        ]
        if not alone:
            continue
        first, second = alone[0]
        own = counterparts(recordings, layout, first, second)
        if own.apart < best:
            best = own.apart
            limbs = {**layout.limbs, second: own.columns}
            found = Layout(limbs=limbs, holder=layout.holder, mirrored=((first, second),))
    return found


def _apart(recordings: Sequence[Recording], layout: Layout, first: str, second: str) -> np.ndarray:
    """`(2, L, L)` rad between the distributions of joints, read in one sense and in the other."""
    here, there = list(layout.limbs[first]), list(layout.limbs[second])
    own, other = (_by_touch(recordings, layout, limb) for limb in (first, second))
    # What both limbs touched with the same kind of end; all touches, if there is nothing like it.
    both = [kind for kind in own if kind in other]
    pairs = [(own[kind], other[kind]) for kind in both] or [
        (np.concatenate([*own.values()]), np.concatenate([*other.values()]))
    ]
    apart = np.zeros((2, len(here), len(there)))
    for q_first, q_second in pairs:
        quantiles = np.quantile(q_first[:, here], _QUANTILES, axis=0).T[:, None]
        for at, sense in enumerate((1, -1)):
            mirror = np.quantile(sense * q_second[:, there], _QUANTILES, axis=0).T
            apart[at] += np.abs(quantiles - mirror).mean(axis=-1) / len(pairs)
    return apart


def _limbs(one: Recording, layout: Layout) -> set[str]:
    return {layout.holder[one.above], layout.holder[one.below]} - {""}


def _by_touch(
    recordings: Sequence[Recording], layout: Layout, limb: str
) -> dict[tuple[str, bool], np.ndarray]:
    """`(n, J)` readings of postures, by what a limb met and whether it did so with a skin."""
    postures: dict[tuple[str, bool], list[np.ndarray]] = {}
    for one in recordings:
        ends = (one.above, one.below)
        own = [end for end in ends if layout.holder[end] == limb]
        other = [end for end in ends if layout.holder[end] != limb]
        if own and other:
            label = same_posture(one.q[:, layout.between(one)], _ONE_POSTURE)
            kind = (other[0], one.felt(own[0]) is not None)
            postures.setdefault(kind, []).append(one.q[np.unique(label, return_index=True)[1]])
    return {kind: np.concatenate(some) for kind, some in postures.items()}
