"""Joints that purely turn or purely slide: what files of robots can say.

A fit leaves each joint a general twist: a turn that also slides a little along its axis. No file of
a robot has that joint. So twists become pure, and what that does to places is taken back, as far as
possible, by least squares over all axes and touchers together.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from selftouch_drake.agent.body_model.chain import derivatives
from selftouch_drake.agent.body_model.model import UNUSED, BodyModel, JointKind

# Touches that the places are compared at; more change the axes by less than their errors.
_MOST_TOUCHES = 2000
# Steps of least squares: the change is small, and the third step is below rounding.
_STEPS = 3
# Relative to the largest singular value: directions that places do not see stay as they are.
_UNSEEN = 1e-7
# Part of a slide's speed, or of a turn's, that is rounding.
_PURE = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PureModel:
    """A model whose joints purely turn or slide.

    Attributes:
        model: its twists have w and v at right angles, or no w.
        slides: `(J,)` bool, whether the joint slides.
        shift: root mean square of how far the touchers' places move by this, over the touches, in
            the unit of the model.
    """

    model: BodyModel
    slides: np.ndarray
    shift: float


@dataclass(frozen=True, slots=True, eq=False)
class _Way:
    """Touches along one way from a part of the skin to a toucher.

    Attributes:
        joints: L joints that are passed.
        signs: `(L,)` 1, or -1 where the joint is passed backwards.
        toucher: at the end.
        q: `(n, L)` readings.
        place: `(n, 3)` of the toucher in the frame of the part's link, by the model as it is.
    """

    joints: list[int]
    signs: np.ndarray
    toucher: int
    q: np.ndarray
    place: np.ndarray

    def found(self, twists: np.ndarray, touchers: np.ndarray) -> tuple[np.ndarray, ...]:
        """Places by other twists, and their derivatives by twists and by the toucher."""
        return derivatives(self.q, twists[self.joints], touchers[self.toucher], self.signs)[:3]


def with_pure_joints(model: BodyModel, q: np.ndarray, target: np.ndarray) -> PureModel:
    """A model whose joints are pure, with places as near as possible to those of the given one.

    A joint that is open is taken for what moves places less, a turn or a slide.

    Args:
        model: with joints in use.
        q: `(R, J)` readings at the touches that the model was made from.
        target: `(R,)` target sensation of each.
    """
    ways = _ways(model, q, target)
    slides = model.joint_kind == JointKind.SLIDES
    slides |= model.used & ~model.twists[:, :3].any(axis=1)
    for joint in np.flatnonzero((model.joint_kind == JointKind.OPEN) & ~slides):
        slid = slides.copy()
        slid[joint] = True
        as_turn, as_slide = (
            _apart(ways, _pure(model, taken), model.toucher_place) for taken in (slides, slid)
        )
        slides = slid if as_slide < as_turn else slides
    twists, touchers = _pure(model, slides), model.toucher_place.copy()
    apart = _apart(ways, twists, touchers)
    for _ in range(_STEPS):
        if apart < _PURE:
            break
        moved, moved_touchers = _stepped(ways, twists, touchers, slides)
        moved = _pure(replace(model, twists=moved), slides)
        fresh = _apart(ways, moved, moved_touchers)
        if fresh >= apart:
            break
        twists, touchers, apart = moved, moved_touchers, fresh
    pure = replace(model, twists=twists, toucher_place=touchers)
    return PureModel(model=pure, slides=slides, shift=apart)


def _ways(model: BodyModel, q: np.ndarray, target: np.ndarray) -> list[_Way]:
    """The touches that the model explains, by the way that they pass."""
    explained = np.flatnonzero(model.kernel_toucher >= 0)
    rows = explained[:: max(1, len(explained) // _MOST_TOUCHES)]
    part, toucher = model.kernel_part[target[rows]], model.kernel_toucher[rows]
    found = []
    for pair in sorted(set(zip(part.tolist(), toucher.tolist(), strict=True))):
        start, end = int(model.part_link[pair[0]]), int(model.toucher_link[pair[1]])
        if start == UNUSED:
            continue
        up, down = model.between(start, end)
        here = rows[(part == pair[0]) & (toucher == pair[1])]
        joints, signs = up + down, np.array([-1.0] * len(up) + [1.0] * len(down))
        if not joints:
            continue
        own = np.ascontiguousarray(q[np.ix_(here, joints)])
        place = derivatives(own, model.twists[joints], model.toucher_place[pair[1]], signs)[0]
        found.append(_Way(joints, signs, pair[1], own, place))
    return found


def _pure(model: BodyModel, slides: np.ndarray) -> np.ndarray:
    """`(J, 6)` twists without the slide of a turn and without the turn of a slide.

    A slide goes where its twist moves the middle of the touchers.
    """
    twists = model.twists.copy()
    middle = model.toucher_place.mean(axis=0)
    w, v = twists[:, :3], twists[:, 3:]
    v[slides] += np.cross(w[slides], middle)
    w[slides] = 0.0
    square = np.square(w).sum(axis=1, keepdims=True)
    along = (w * v).sum(axis=1, keepdims=True)
    v -= np.where(square > 0, along / np.where(square > 0, square, 1.0), 0.0) * w
    return twists


def _apart(ways: Sequence[_Way], twists: np.ndarray, touchers: np.ndarray) -> float:
    """Root mean square of the change of places."""
    apart = [way.found(twists, touchers)[0] - way.place for way in ways]
    if not apart:
        return 0.0
    return float(np.sqrt(np.square(np.concatenate(apart)).sum(axis=1).mean()))


def _stepped(
    ways: Sequence[_Way], twists: np.ndarray, touchers: np.ndarray, slides: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Twists and touchers after a step of Gauss and Newton that keeps joints pure."""
    num_twists, rows, rest = twists.size, [], []
    for way in ways:
        place, by_twist, by_point = way.found(twists, touchers)
        slope = np.zeros((len(place), 3, num_twists + touchers.size))
        for index, joint in enumerate(way.joints):
            slope[:, :, 6 * joint : 6 * joint + 6] = by_twist[:, :, index]
        first = num_twists + 3 * way.toucher
        slope[:, :, first : first + 3] = by_point
        rows.append(slope.reshape(-1, slope.shape[2]))
        rest.append((way.place - place).ravel())
    free = _free(twists, touchers.size, slides)
    step = np.linalg.lstsq(np.concatenate(rows) @ free, np.concatenate(rest), rcond=_UNSEEN)[0]
    step = free @ step
    moved = twists + step[:num_twists].reshape(twists.shape)
    return moved, touchers + step[num_twists:].reshape(touchers.shape)


def _free(twists: np.ndarray, num_more: int, slides: np.ndarray) -> np.ndarray:
    """Directions of all parameters in which joints stay pure, in columns."""
    blocks = []
    for twist, slide in zip(twists, slides, strict=True):
        if slide:
            blocks.append(np.eye(6)[:, 3:])
        elif not twist.any():
            blocks.append(np.zeros((6, 0)))
        else:  # w . v = 0
            across = np.concatenate([twist[3:], twist[:3]])
            blocks.append(np.linalg.svd(across[None])[2][1:].T)
    blocks.append(np.eye(num_more))
    found = np.zeros((twists.size + num_more, sum(block.shape[1] for block in blocks)))
    row = column = 0
    for block in blocks:
        end = row + block.shape[0], column + block.shape[1]
        found[row : end[0], column : end[1]] = block
        row, column = end
    return found
