"""Touches that both skins feel: where on its own skin a hand was met reads like further joints.

A hand with skin is no point. Where it was met moves along its skin, as a point would that slides on
further joints at the end of the chain; and the hand's own receptors read these joints. So what a
hand feels takes its place among the readings, and a body is looked for as ever. Of that body only
the middle of the hand's skin is kept, where these joints read 0.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from selftouch_drake.agent.body_model.both_sides.grain import map_of_readings
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.representation.touches import receptors_together

# Hands made all touches of two sides, but for this share: hands touch each other, too.
_APART = 0.1
# Directions along a hand's skin count if it extends so far in them, relative to the longest.
_EXTENT = 0.2
# Receptors by which a hand tells where it is met.
_FEWEST = 5


@dataclass(frozen=True, slots=True, eq=False)
class FeltTwice:
    """Touches by hands with skin, seen from the side that they touch.

    Attributes:
        left_out: `(R,)` bool, stored touches that are not fitted: those that only one side felt,
            three felt, or two hands, and the hand's side of all others.
        along: `(R, E)` where on its skin a hand was met, in diameters of a contact from the middle;
            0 for other hands.
    """

    left_out: np.ndarray
    along: np.ndarray


def felt_twice(
    representation: QuotientRepresentation, kernel: np.ndarray, sensation: csr_array
) -> FeltTwice | None:
    """Touches of two sides, if there are more of these than of one, and hands made them.

    Args:
        representation: what was learned.
        kernel: `(R,)` the target sensation of each stored touch.
        sensation: `(R, S)` what all receptors felt then.
    """
    part = representation.part[kernel]
    _, number, count = np.unique(representation.kernel_row, return_inverse=True, return_counts=True)
    row = np.argsort(number, kind="stable")
    pair = row[count[number[row]] == 2].reshape(-1, 2)
    if 2 * len(pair) <= len(part) - 2 * len(pair):
        return None
    size = np.bincount(representation.part)
    hands = _hands(part[pair], size)
    if not hands:
        return None
    is_hand = np.isin(part[pair], hands)
    one = is_hand.sum(axis=1) == 1
    of_hand, touched = (pair[one][is_hand[one] == side] for side in (True, False))
    left_out = np.ones(len(part), dtype=bool)
    left_out[touched] = False
    skin = connected_components(representation.overlap, directed=False)[1]
    strongest = skin[representation.target_sensations.argmax(axis=1)]
    along = []
    for hand in hands:
        rows = touched[part[of_hand] == hand]
        own = np.isin(skin, strongest[representation.part == hand])
        felt = csr_array(sensation)[rows][:, np.flatnonzero(own)].toarray()
        place = _along(felt)
        column = np.zeros((len(part), place.shape[1]))
        column[rows] = place
        along.append(column)
    return FeltTwice(left_out, np.hstack(along))


@dataclass(frozen=True, slots=True, eq=False)
class OneSide:
    """Touches by hands with skin, seen from the side that they touch, before any is learned.

    Attributes:
        row: `(n,)` the touches that one hand made.
        sensation: `(n, S)` what was felt, without what hands felt.
        along: `(n, E)` as in `FeltTwice`.
    """

    row: np.ndarray
    sensation: np.ndarray
    along: np.ndarray


def from_one_side(sensation: np.ndarray) -> OneSide | None:
    """`(n, S)` touches of two sides, if most are and hands made them."""
    together = receptors_together(sensation)
    if not together.double:
        return None
    number, skin = connected_components(together.overlap, directed=False)
    on = (sensation > 0) @ np.eye(number, dtype=np.float32)[skin] > 0
    count = on.sum(axis=1)
    if 2 * np.count_nonzero(count == 2) <= np.count_nonzero(count == 1):
        return None
    pair = np.nonzero(on[count == 2])[1].reshape(-1, 2)
    hands = _hands(pair, np.bincount(skin))
    by = on[:, hands]
    row = np.flatnonzero((by.sum(axis=1) == 1) & (count > 1))
    if not len(row):
        return None
    along = []
    for column, hand in enumerate(hands):
        mine = by[row, column]
        place = _along(sensation[row[mine]][:, skin == hand])
        along.append(np.zeros((len(row), place.shape[1])))
        along[-1][mine] = place
    touched = np.where(np.isin(skin, hands), 0, sensation[row])
    return OneSide(row, touched, np.hstack(along))


def _hands(parts: np.ndarray, size: np.ndarray) -> list[int]:
    """The fewest parts of which just one takes part in nearly each touch of two sides.

    Args:
        parts: `(n, 2)` that felt each touch.
        size: `(P,)` kernels of each part: of two answers the smaller parts are hands.
    """
    met = sorted(set(parts.ravel().tolist()))
    for number in range(1, len(met)):
        fits = [
            (int(size[list(hands)].sum()), hands)
            for hands in itertools.combinations(met, number)
            if (np.isin(parts, hands).sum(axis=1) == 1).mean() >= 1 - _APART
        ]
        if fits:
            return list(min(fits)[1])
    return []


def _along(felt: np.ndarray) -> np.ndarray:
    """`(n, 0 to 3)` where on the skin of a hand `(n, S)` touches are."""
    if (felt > 0).sum() == 0 or ((felt > 0).sum(axis=0) >= _FEWEST).sum() < _FEWEST:
        return np.zeros((len(felt), 0))
    first = map_of_readings(felt)
    known = np.isfinite(first[:, 0])
    weight = felt[:, known].astype(float)
    place = weight @ first[known] / np.maximum(weight.sum(axis=1), 1e-12)[:, None]
    met = weight.any(axis=1)
    # A touch of receptors without a place is taken for one of the middle.
    place[met] -= place[met].mean(axis=0)
    _, extent, axes = np.linalg.svd(place, full_matrices=False)
    return place @ axes[extent > _EXTENT * extent[0]].T


def without_last(model: BodyModel, number: int) -> BodyModel:
    """The model without its last joints, as where these read 0.

    Args:
        model: whose last joints are no joints of the body.
        number: of these.
    """
    num_joints = len(model.joint_names)
    kept = num_joints - number

    def above(link: int) -> int:
        while link >= kept:
            link = int(model.joint_parent[link])
        return link

    def carried(links: Sequence[int] | np.ndarray) -> np.ndarray:
        return np.array([above(int(link)) for link in links], dtype=int)

    errors = np.r_[0 : 6 * kept, 6 * num_joints : len(model.covariance)]
    return replace(
        model,
        joint_names=model.joint_names[:kept],
        joint_parent=carried(model.joint_parent[:kept]),
        twists=model.twists[:kept],
        twist_sigma=model.twist_sigma[:kept],
        covariance=model.covariance[np.ix_(errors, errors)],
        joint_kind=model.joint_kind[:kept],
        order_group=model.order_group[:kept],
        part_link=carried(model.part_link),
        toucher_link=carried(model.toucher_link),
    )
