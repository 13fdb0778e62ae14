"""Whether a body found from touches of both sides may be believed.

Held-out touches of the same recordings cannot tell: they accept wrong bodies and wrong orders. Two
things told right from wrong. A search that began anew, with nothing but the touches in common,
comes to the same axes; and the body of the next order is worse by far.
"""

from dataclasses import dataclass

import numpy as np

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
        same_order: whether both searches found one order, but for joints that may be exchanged.
        angles: `(J,)` degrees between the axes of both; NaN for joints that no recording needs.
        gap: by how much the next order is worse, in hundreds of the loss; infinite if the order
            was known.
        reason: a sentence with the figures.
    """

    accepted: bool
    same_order: bool
    angles: np.ndarray
    gap: float
    reason: str


def axes_apart(body: Body, row: np.ndarray, other: np.ndarray) -> np.ndarray:
    """`(J,)` degrees between the axes of two bodies, seen in the frame of the trunk's skins.

    The mirror image of a body feels the same, so the better of both hands counts.

    Args:
        body: skins and layout of both.
        row: `(P,)` one body, whose joint and column agree.
        other: `(P,)` the other one.
    """
    trunk = [end for end in body.skins if not body.layout.holder[end]]
    here, there = (np.concatenate([body.places(one, end) for end in trunk]) for one in (row, other))
    first, second = (_units(body.axes(one).astype(float)) for one in (row, other))
    u, _, vt = np.linalg.svd((here - here.mean(axis=0)).T @ (there - there.mean(axis=0)))
    best = np.full(len(first), np.inf)
    for hand in (1, -1):
        turn = u * [1, 1, hand * np.sign(np.linalg.det(u @ vt))] @ vt
        cosine = hand * ((first @ turn) * second).sum(axis=1)
        angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        best = min(best, angle, key=np.mean)
    return best


def compared(
    body: Body,
    found: tuple[np.ndarray, np.ndarray],
    again: tuple[np.ndarray, np.ndarray],
    gap: float,
) -> Agreement:
    """Judges a body by a search that began anew.

    Args:
        body: skins and layout of both, joint and column in agreement.
        found: `(P,)` the body, and the `(J,)` order of its joints.
        again: the same of the other search.
        gap: by how much the next order is worse, in hundreds of the loss.
    """
    angles = axes_apart(body, found[0], again[0])
    same = bool((found[1] == again[1]).all())
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
