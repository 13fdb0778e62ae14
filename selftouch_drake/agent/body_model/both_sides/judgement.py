"""Whether a body found from touches of both sides may be believed.

Held-out touches of the same recordings cannot tell: they accept wrong bodies and wrong orders. Two
things told right from wrong. A search that began anew, with nothing but the touches in common,
comes to the same axes; and the body of the next order is worse by far.
"""

from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.body_model.both_sides.orders import settled
from selftouch_drake.agent.body_model.both_sides.problem import Body, Population

#: Axes of two searches may differ by so many degrees, in the median and at worst.
AGREES, AGREES_AT_WORST = 10.0, 25.0
#: The next order must be worse by this much, in hundreds of the loss.
GAP = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Agreement:
    """What two independent searches and the next order say of a body.

    Attributes:
        accepted: whether the body may be believed.
        same_order: whether both searches found one order.
        angles: `(J,)` degrees between the axes of both.
        gap: by how much the next order is worse, in hundreds of the loss; infinite if the order
            was known.
        reason: a sentence with the figures.
    """

    accepted: bool
    same_order: bool
    angles: np.ndarray
    gap: float
    reason: str


def axes_apart(first: tuple[Body, np.ndarray], second: tuple[Body, np.ndarray]) -> np.ndarray:
    """`(J,)` degrees between the axes of two bodies, seen in the frame of the trunk's skins.

    The mirror image of a body feels the same, so the better of both hands counts.

    Args:
        first: a body and its `(P,)` row, joint and column in agreement.
        second: another one of the same joints; its skins may have other receptors.
    """
    here, there = shared_places(first, second)
    own, other = (_units(body.axes(row).astype(float)) for body, row in (first, second))
    u, _, vt = np.linalg.svd((here - here.mean(axis=0)).T @ (there - there.mean(axis=0)))
    angles = []
    for hand in (1, -1):
        turn = u * [1, 1, hand * np.sign(np.linalg.det(u @ vt))] @ vt
        cosine = hand * ((own @ turn) * other).sum(axis=1)
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return min(angles, key=np.mean)


def shared_places(
    first: tuple[Body, np.ndarray], second: tuple[Body, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Places of the trunk's receptors that both bodies know."""
    here, there = [], []
    for end in [end for end in first[0].skins if not first[0].layout.holder[end]]:
        own, known = first[0].skins[end].receptor, second[0].skins[end].receptor
        _, one, other = np.intersect1d(own, known, return_indices=True)
        here.append(first[0].places(first[1], end)[one])
        there.append(second[0].places(second[1], end)[other])
    return np.concatenate(here), np.concatenate(there)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """What a search found.

    Attributes:
        body: its skins and layout, joint and column in agreement.
        row: `(P,)` axes, centres and places.
        order: `(J,)` column of the readings at each place of the limbs.
    """

    body: Body
    row: np.ndarray
    order: np.ndarray

    @staticmethod
    def best(body: Body, some: Population) -> "Found":
        """The first of a population, with its limbs in the order that was found."""
        there, row = settled(body, some.rows[0], some.orders[0])
        return Found(body=there, row=row, order=some.orders[0])


def compared(found: Found, again: Found, gap: float) -> Agreement:
    """Judges a body by a search that began anew.

    Args:
        found: the body.
        again: what the other search found.
        gap: by how much the next order is worse, in hundreds of the loss.
    """
    angles = axes_apart((found.body, found.row), (again.body, again.row))
    same = bool((found.order == again.order).all())
    median, worst = float(np.median(angles)), float(angles.max())
    accepted = same and median < AGREES and worst < AGREES_AT_WORST and gap > GAP
    orders = "the same order" if same else "another order"
    reason = (
        f"a search begun anew found {orders}, axes {median:.1f} degrees apart in the median and "
        f"{worst:.1f} at worst ({AGREES:.0f} and {AGREES_AT_WORST:.0f} allowed); the next order is "
        f"worse by {gap:.2f} ({GAP:.1f} needed)"
    )
    return Agreement(accepted=accepted, same_order=same, angles=angles, gap=gap, reason=reason)


def gap_between(some: Population, joints: np.ndarray) -> float:
    """By how much the best other order of some joints is worse than the first of a population.

    Args:
        some: bodies of distinct orders, best first.
        joints: that count; other joints may differ.
    """
    other = (some.orders[:, joints] != some.orders[0, joints]).any(axis=1)
    return float((some.loss[other] - some.loss[0]).min()) if other.any() else np.inf


def _units(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
