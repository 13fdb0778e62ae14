"""The order of the joints of each limb, found together with the body.

All orders of the first limb begin at once; those that few recordings rank best are carried on to
all recordings. Then orders change by swaps of neighbours and cycles of three, which take the axes
along, leave them where they are, or draw them anew. The two limbs of a pair have one order.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.body_model.both_sides.problem import Body, Population
from selftouch_drake.agent.body_model.both_sides.recordings import Layout
from selftouch_drake.agent.body_model.both_sides.search import (
    SIGMA,
    Effort,
    Problems,
    redrawn,
    refined,
    with_second_limb,
)
from selftouch_drake.agent.body_model.both_sides.start import at_random

#: What a change of order does with the axes of the joints that it moves.
CARRIED, LEFT, ANEW = "carried", "left", "anew"
# Of more orders than this, so many are drawn.
_MOST_ORDERS = 120


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderEffort:
    """How much is tried for the order. Chosen on fold 0 of the touches of one Nao.

    Attributes:
        starts: bodies of one limb that begin in each order.
        polished: best orders that are fitted longer, and that the other limb is tried with.
        images: mirror images of the limb for each of these.
        redrawn: draws of a limb for each order while orders change.
        beam: orders that are changed.
        rounds: of changes, at most.
        stale: rounds without a better body after which the search ends.
    """

    starts: int = 3
    polished: int = 48
    images: int = 3
    redrawn: int = 6
    beam: int = 5
    rounds: int = 6
    stale: int = 2


#: What a search for the order tries unless told otherwise.
USUAL_FOR_ORDERS = OrderEffort()
#: What is tried for the bodies of the best two orders.
ONE_PASS = Effort(passes=1, redrawn=24)


def found_orders(
    problems: Problems, seed: int, effort: OrderEffort = USUAL_FOR_ORDERS, last: Effort = ONE_PASS
) -> Population:
    """The best bodies of distinct orders, best first; parts of the best two were drawn anew.

    Args:
        problems: the recordings; the layout says which joints each limb has, in any order.
        seed: of all that is drawn.
        effort: how much is tried.
        last: how much is tried for the bodies of the best two orders.
    """
    random = np.random.default_rng(seed)
    some = _first_orders(problems, random, effort)
    each = Effort(carried=len(some.rows), images=effort.images, bundled=len(some.rows))
    some = distinct(with_second_limb(problems, some, random, each), effort.beam)
    best, stale = np.inf, 0
    limbs = itertools.cycle(problems.body.layout.limbs)
    for limb in itertools.islice(limbs, effort.rounds):
        some = _changed(problems, some, random, effort)
        some = distinct(some.together(_redrawn(problems, some, limb, random, effort)), effort.beam)
        stale = 0 if some.loss[0] < best - 0.1 else stale + 1
        best = min(best, some.loss[0])
        if stale >= effort.stale:
            break
    some = problems.whole.descended(some, steps=1000, rate=0.02, sigmas=(0.6, SIGMA)).best(
        effort.beam
    )
    # The next order of the first limbs has the same chances as the first one.
    joints = [j for limb in _groups(problems.body)[0] for j in problems.body.layout.limbs[limb]]
    other = (some.orders[:, joints] != some.orders[0, joints]).any(axis=1)
    rivals = [0, *np.flatnonzero(other)[:1]]
    fine = [refined(problems, some.some(slice(at, at + 1)), random, last) for at in rivals]
    return distinct(some.together(*fine), effort.beam)


def settled(body: Body, row: np.ndarray, order: np.ndarray) -> tuple[Body, np.ndarray]:
    """The same body with its limbs in the order that was found, so that joint and column agree.

    Args:
        body: its skins, and a layout whose limbs have their joints in any order.
        row: `(P,)` the body found.
        order: `(J,)` column of the readings that turns each joint.
    """
    layout = body.layout
    limbs = {name: [int(order[j]) for j in joints] for name, joints in layout.limbs.items()}
    there = Body(
        layout=Layout(limbs=limbs, holder=layout.holder, mirrored=layout.mirrored),
        skins=body.skins, points=body.points, num_joints=body.num_joints,
    )  # fmt: skip
    moved = row.copy()
    there.axes(moved)[order] = body.axes(row)
    there.centres(moved)[order] = body.centres(row)
    return there, moved


def distinct(some: Population, number: int) -> Population:
    """The best bodies of different orders, best first."""
    seen: set[tuple[int, ...]] = set()
    kept = []
    for index in np.argsort(some.loss, kind="stable"):
        order = tuple(some.orders[index].tolist())
        if order not in seen:
            seen.add(order)
            kept.append(index)
    return some.some(np.array(kept[:number]))


def _first_orders(
    problems: Problems, random: np.random.Generator, effort: OrderEffort
) -> Population:
    """The best bodies of one limb in each of the best orders."""
    body = problems.body
    groups = _groups(body)
    first = problems.pair or (next(iter(body.layout.limbs)),)
    length = len(body.layout.limbs[first[0]])
    tried = list(itertools.permutations(range(length)))
    if len(tried) > _MOST_ORDERS:
        tried = [tuple(random.permutation(length)) for _ in range(_MOST_ORDERS)]
    orders = np.tile(np.arange(body.num_joints), (len(tried) * effort.starts, 1))
    for row, order in zip(orders, itertools.cycle(tried)):
        for limbs in groups:
            own = order if first[0] in limbs else random.permutation(_length(body, limbs))
            for limb in limbs:
                joints = np.array(body.layout.limbs[limb])
                row[joints] = joints[np.array(own)]
    begun = Population(
        rows=at_random(body, len(orders), random), orders=orders,
        loss=np.full(len(orders), np.nan),
    )  # fmt: skip
    coarse = problems.first.descended(begun, steps=350, rate=0.04, sigmas=(4.0, 0.3))
    column = list(body.layout.limbs[first[0]])
    best: dict[tuple[int, ...], int] = {}
    for index in np.argsort(coarse.loss, kind="stable"):
        best.setdefault(tuple(coarse.orders[index, column].tolist()), int(index))
    kept = coarse.some(np.array(list(best.values())[: effort.polished]))
    fine = problems.first.descended(kept, steps=500, rate=0.03, sigmas=(0.8, SIGMA))
    return fine.best(effort.polished)


def _changed(
    problems: Problems, some: Population, random: np.random.Generator, effort: OrderEffort
) -> Population:
    """The best distinct orders after one round of changes, the present ones included."""
    whole = problems.whole
    tried = some.together(
        *(
            _changes(problems.body, some.some(slice(i, i + 1)), random)
            for i in range(len(some.rows))
        )
    )
    tried = whole.descended(tried, steps=160, rate=0.03, sigmas=(0.6, SIGMA))
    kept = distinct(tried, effort.beam)
    kept = whole.descended(kept, steps=250, rate=0.02, sigmas=(0.4, SIGMA))
    return distinct(kept.together(some), effort.beam)


def _redrawn(
    problems: Problems,
    some: Population,
    limb: str,
    random: np.random.Generator,
    effort: OrderEffort,
) -> Population:
    """The same orders with one limb drawn anew."""
    draws = Effort(redrawn=effort.redrawn)
    each = [some.some(slice(at, at + 1)) for at in range(len(some.rows))]
    first, *others = (redrawn(problems, one, limb, random, draws) for one in each)
    return first.together(*others)


def _changes(body: Body, one: Population, random: np.random.Generator) -> Population:
    """All changed orders of one body."""
    rows, orders = [], []
    for limbs in _groups(body):
        for positions, sources in _moves(_length(body, limbs)):
            for mode in (CARRIED, ANEW) if len(positions) > 2 else (CARRIED, LEFT, ANEW):
                row, order = one.rows[0].copy(), one.orders[0].copy()
                for limb in limbs:
                    joints = np.array(body.layout.limbs[limb])
                    to, source = joints[list(positions)], joints[list(sources)]
                    order[to] = one.orders[0, source]
                    _move_axes(body, row, one.rows[0], to, source, mode, random)
                rows.append(row)
                orders.append(order)
    return Population(rows=np.array(rows), orders=np.array(orders), loss=np.full(len(rows), np.nan))


def _move_axes(
    body: Body,
    row: np.ndarray,
    before: np.ndarray,
    to: np.ndarray,
    source: np.ndarray,
    mode: str,
    random: np.random.Generator,
) -> None:
    if mode == CARRIED:
        body.axes(row)[to] = body.axes(before)[source]
        body.centres(row)[to] = body.centres(before)[source]
    if mode == ANEW:
        drawn = random.normal(size=(len(to), 3))
        body.axes(row)[to] = drawn / np.linalg.norm(drawn, axis=1, keepdims=True)
        middle = body.centres(before)[to].mean(axis=0)
        body.centres(row)[to] = middle + 0.7 * random.normal(size=(len(to), 3))


def _moves(length: int) -> list[tuple[Sequence[int], Sequence[int]]]:
    """Swaps of neighbours, then cycles of three neighbours: positions, and where from."""
    swaps = [((at, at + 1), (at + 1, at)) for at in range(length - 1)]
    cycles = [
        ((at, at + 1, at + 2), order)
        for at in range(length - 2)
        for order in ((at + 1, at + 2, at), (at + 2, at, at + 1), (at + 2, at + 1, at))
    ]
    return [*swaps, *cycles]


def _groups(body: Body) -> list[tuple[str, ...]]:
    """Limbs that share an order: pairs, then single ones."""
    pairs = list(body.layout.mirrored)
    paired = {name for pair in pairs for name in pair}
    return [*pairs, *((name,) for name in body.layout.limbs if name not in paired)]


def _length(body: Body, limbs: tuple[str, ...]) -> int:
    return len(body.layout.limbs[limbs[0]])
