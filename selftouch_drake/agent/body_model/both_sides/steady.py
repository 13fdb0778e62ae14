"""Joints of a body on which several drafts of it agree.

A fit follows chance: which postures there are, and of which patterns skins are made. The mean of
several drafts is nearer to the joints than a draft is, and their scatter says how well each joint
is known. Limbs of a pair are mirror images of each other as far as this scatter can tell.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.body_model.both_sides.judgement import Found, shared_places

# No joint is known better than this, in rad and in diameters of a contact.
_LEAST = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Joints:
    """Joints on which drafts agree.

    Attributes:
        axes: `(J, 3)` of unit length.
        centres: `(J, 3)` points on them, in diameters of a contact.
        axes_off: `(J,)` rad, scatter of the drafts in each direction.
        centres_off: `(J,)` diameters of a contact, likewise.
    """

    axes: np.ndarray
    centres: np.ndarray
    axes_off: np.ndarray
    centres_off: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pair:
    """Limbs that may be mirror images.

    Attributes:
        first: `(L,)` joints of one.
        second: `(L,)` their counterparts.
        sense: `(L,)` 1 if counterparts are read over one range, -1 over its mirror image.
    """

    first: Sequence[int]
    second: Sequence[int]
    sense: np.ndarray


def agreed(found: Found, drafts: Sequence[Found], pairs: Sequence[Pair] = ()) -> Joints:
    """The mean joints of drafts of a body, in the frame in which it was found.

    Args:
        found: the body.
        drafts: of it, each without one of as many parts of the touches.
        pairs: limbs that may be mirror images.
    """
    seen = [_in_frame(found, draft) for draft in drafts]
    axes, centres = (np.array(own) for own in zip(*seen, strict=True))
    mean, centre = _units(axes.mean(axis=0)), centres.mean(axis=0)
    turned = ((axes - mean) ** 2).sum(axis=2).mean(axis=0) / 2
    moved = ((centres - centre) ** 2).sum(axis=2).mean(axis=0) / 3
    # Drafts share most of their touches: the mean is less sure than they differ (the jackknife).
    variance = (len(drafts) - 1) * turned + _LEAST**2
    for pair in pairs:
        mean = _as_images(mean, variance, pair)
    return Joints(
        axes=mean, centres=centre, axes_off=np.maximum(np.sqrt(turned), _LEAST),
        centres_off=np.maximum(np.sqrt(moved), _LEAST),
    )  # fmt: skip


def _in_frame(found: Found, draft: Found) -> tuple[np.ndarray, np.ndarray]:
    """`(J, 3)` axes and `(J, 3)` centres of a draft, its trunk's skins laid over the found ones."""
    here, there = shared_places((draft.body, draft.row), (found.body, found.row))
    u, _, vt = np.linalg.svd((here - here.mean(axis=0)).T @ (there - there.mean(axis=0)))
    turn = u * [1, 1, np.sign(np.linalg.det(u @ vt))] @ vt
    axes = _units(draft.body.axes(draft.row).astype(float)) @ turn
    centres = draft.body.centres(draft.row).astype(float)
    return axes, (centres - here.mean(axis=0)) @ turn + there.mean(axis=0)


def _as_images(axes: np.ndarray, variance: np.ndarray, pair: Pair) -> np.ndarray:
    """Axes of a pair drawn to those of which both limbs are mirror images.

    How far limbs are from being images is told by what their errors do not explain (empirical
    Bayes): where errors explain all, they are images; where hardly any, nothing changes.

    Args:
        axes: `(J, 3)` of unit length.
        variance: `(J,)` rad^2 of each in each direction.
        pair: the limbs.
    """
    first, second = list(pair.first), list(pair.second)
    # What turns one way turns the other way in a mirror.
    sense = -np.asarray(pair.sense, dtype=float)[:, None]
    weight = 1 / (variance[first] + variance[second])
    across = np.einsum("j,ja,jb->ab", weight, sense * axes[first], axes[second])
    normal = np.linalg.eigh(across + across.T)[1][:, 0]
    mirror = np.eye(3) - 2 * np.outer(normal, normal)
    image = sense * axes[second] @ mirror
    apart = ((image - axes[first]) ** 2).sum(axis=1) / 2
    unlike = max(0.0, float((apart - variance[first] - variance[second]).mean()) / 2)
    weights = [1 / (variance[limb] + unlike)[:, None] for limb in (first, second)]
    common = _units(weights[0] * axes[first] + weights[1] * image)
    axes = axes.copy()
    for limb, there in ((first, common), (second, sense * common @ mirror)):
        drawn = (variance[limb] / (variance[limb] + unlike))[:, None]
        axes[limb] = _units(drawn * there + (1 - drawn) * axes[limb])
    return axes


def _units(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
