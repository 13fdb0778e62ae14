"""Whether a given tree is wrong, not only inexact: an axis, a sign, or two joints exchanged.

Touches that feel alike put one place of the toucher on one place of the skin. A tree that is a
little inexact brings them near to each other; a wrong one does not, and the right one among many
wrong ones is told by how near.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from selftouch_drake.agent.given_model.way import GivenWay

# Touches that feel most like each one.
_ALIKE = 5
# Share of the extent that is not looked below, squared: how far a right tree brings touches.
_FLOOR = 1e-3
#: A tree is wrong if another brings touches that feel alike so many times nearer. On a torus, other
#: trees bring them at best 0.13 times as near as a right one with 20 numbers changed does.
_TIMES = 2.0
#: Nothing fits if such touches lie farther apart than this share of the extent. A right tree with
#: 20 numbers changed has 0.04; wrong ones have 0.26 and more.
_NOTHING = 0.15


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypothesis:
    """A hypothesis.

    Attributes:
        way: with other axes, maybe.
        columns: `(L,)` the reading of each joint, among those that it is given.
        text: what is wrong with the given tree, then; empty for that tree itself.
    """

    way: GivenWay
    columns: np.ndarray
    text: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Verdict:
    """What touches say of a given tree.

    Attributes:
        best: the tree that fits best: the given one, unless that is wrong.
        apart: share of the extent of all places by which touches that feel alike lie apart, for
            the given tree.
        best_apart: likewise for the best tree.
        fits: whether the best tree fits at all.
        new_axes: `(L,)` bool, joints whose axis is another one in the best tree.
    """

    best: Hypothesis
    apart: float
    best_apart: float
    fits: bool
    new_axes: np.ndarray


def judged_tree(way: GivenWay, q: np.ndarray, sensation: np.ndarray) -> Verdict:
    """Compares a given tree with trees that differ from it in one axis or one exchange.

    Args:
        way: as it is given.
        q: `(n, L)` rad or m.
        sensation: `(n, S)` readings; each row has one above 0.
    """
    first, second = _alike(sensation)
    trees = list(_trees(way))
    apart = [_apart(tree.way.places(q[:, tree.columns]), first, second) for tree in trees]
    best = int(np.argmin(apart))
    if apart[best] * _TIMES > apart[0]:
        best = 0
    return Verdict(
        best=trees[best],
        apart=apart[0],
        best_apart=apart[best],
        fits=apart[best] < _NOTHING,
        new_axes=(trees[best].way.axes != way.axes).any(axis=1),
    )


def _trees(way: GivenWay) -> Iterator[Hypothesis]:
    """The given tree, and then those that differ from it."""
    number = len(way.names)
    straight = np.arange(number)
    yield Hypothesis(way=way, columns=straight, text="")
    for joint, name in enumerate(way.names):
        moves = "slides" if way.slides[joint] else "turns"
        for shift, sign in ((0, -1), (1, 1), (1, -1), (2, 1), (2, -1)):
            axes = way.axes.copy()
            axes[joint] = sign * np.roll(axes[joint], shift)
            how = "the other way round" if shift == 0 else "about another axis"
            how = how.replace("about", "along") if way.slides[joint] else how
            written = " ".join(f"{part + 0.0:g}" for part in axes[joint])
            yield Hypothesis(
                way=replace(way, axes=axes),
                columns=straight,
                text=f"joint {name} {moves} {how}: its axis is {written}",
            )
    for one, other in combinations(range(number), 2):
        both = f"{way.names[one]} and {way.names[other]}"
        if not np.allclose(way.axes[one], way.axes[other]):
            axes = way.axes.copy()
            axes[[one, other]] = axes[[other, one]]
            yield Hypothesis(
                way=replace(way, axes=axes),
                columns=straight,
                text=f"the axes of joints {both} are exchanged",
            )
        columns = straight.copy()
        columns[[one, other]] = columns[[other, one]]
        yield Hypothesis(
            way=way, columns=columns, text=f"the readings of joints {both} are exchanged"
        )


def _alike(sensation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of touches that feel most alike."""
    root = np.sqrt(sensation)
    root /= np.linalg.norm(root, axis=1, keepdims=True)
    cosine = root @ root.T
    np.fill_diagonal(cosine, -1.0)
    number = min(_ALIKE, len(root) - 1)
    second = np.argsort(-cosine, axis=1, kind="stable")[:, :number]
    return np.repeat(np.arange(len(root)), number), second.ravel()


def _apart(places: np.ndarray, first: np.ndarray, second: np.ndarray) -> float:
    """Geometric mean of squared distances of pairs, relative to the scatter of all places."""
    total = np.square(places - places.mean(axis=0)).sum(axis=1).mean()
    squares = np.square(places[first] - places[second]).sum(axis=1) / max(total, 1e-30)
    return float(np.exp(np.log(squares + _FLOOR).mean()))
