"""A body from nothing but its touches, the order of joints in each limb known.

A few recordings of one limb do not tell its joints: a mirrored skin fits as well. So many bodies of
one limb are carried on, the other limb begins as the mirror image of each, and all recordings
together decide. Then one part after the other is drawn anew, and kept if the loss falls.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.body_model.both_sides.pairs import senses
from selftouch_drake.agent.body_model.both_sides.problem import Body, Population, Problem
from selftouch_drake.agent.body_model.both_sides.recordings import Layout, Recording
from selftouch_drake.agent.body_model.both_sides.start import (
    Image,
    any_turns,
    at_random,
    mirrored,
    scatter_end,
    unfolded,
)

#: Scale of residuals, in diameters of a contact, at which bodies are compared.
SIGMA = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """How much is tried. Chosen on folds 0 and 1 of the touches of one Nao.

    Attributes:
        starts: bodies of one limb that begin at random.
        carried: of them that the other limb is tried with.
        images: mirror images of the limb for each of these.
        bundled: bodies that all recordings together compare.
        passes: how often each part is drawn anew.
        redrawn: bodies of each draw.
        last_steps: of the final descent.
    """

    starts: int = 96
    carried: int = 12
    images: int = 8
    bundled: int = 24
    passes: int = 2
    redrawn: int = 32
    last_steps: int = 4000


#: What a search tries unless told otherwise.
USUAL = Effort()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Problems:
    """The recordings of a body in the order in which they are taken up.

    Attributes:
        first: without the second limb of a pair; all recordings, if there is no pair.
        second: those with it; None if there is none.
        whole: all.
        pair: names of the first limb and the second; None likewise.
        image: what touches say of the second limb as a mirror image; None likewise.
    """

    first: Problem
    second: Problem | None
    whole: Problem
    pair: tuple[str, str] | None
    image: Image | None

    @staticmethod
    def of(recordings: Sequence[Recording], layout: Layout, seed: int = 0) -> "Problems":
        """Skins are learned from all recordings.

        Args:
            recordings: of the body.
            layout: which joints carry what.
            seed: of the pairs of receptors that are looked at.

        Raises:
            ValueError: a pair of limbs whose first one no recording has without the second.
        """
        body = Body.of(recordings, layout)
        whole = Problem.of(body, recordings, seed)
        pair = layout.mirrored[0] if layout.mirrored else None
        if pair is None:
            return Problems(first=whole, second=None, whole=whole, pair=None, image=None)
        late = set(layout.limbs[pair[1]])
        first = [one for one in recordings if not late & set(layout.between(one))]
        second = [one for one in recordings if late & set(layout.between(one))]
        if not first or not second:
            raise ValueError(
                f"limbs {pair[0]} and {pair[1]} are a pair, and no recording has only one of them: "
                "record the first one alone, or name no pair"
            )
        return Problems(
            first=Problem.of(body, first, seed), second=Problem.of(body, second, seed),
            whole=whole, pair=pair, image=_image(body, recordings, pair),
        )  # fmt: skip

    @property
    def body(self) -> Body:
        """Skins and layout."""
        return self.whole.body


def found(problems: Problems, seed: int, effort: Effort = USUAL) -> Population:
    """The best body found, as a population of one.

    Args:
        problems: the recordings.
        seed: of all that is drawn.
        effort: how much is tried.
    """
    random = np.random.default_rng(seed)
    columns = np.arange(problems.body.num_joints)
    orders = np.tile(columns, (effort.starts, 1))
    some = first_limb(problems, orders, random, effort)
    some = with_second_limb(problems, some, random, effort)
    return refined(problems, some.best(), random, effort)


def first_limb(
    problems: Problems, orders: np.ndarray, random: np.random.Generator, effort: Effort
) -> Population:
    """The best bodies of one limb, best first, one for each row of `orders` that begins."""
    rows = at_random(problems.body, len(orders), random)
    begun = Population(rows=rows, orders=orders, loss=np.full(len(rows), np.nan))
    coarse = problems.first.descended(begun, steps=400, rate=0.04, sigmas=(4.0, 0.3))
    fine = problems.first.descended(
        coarse.best(2 * effort.carried), steps=700, rate=0.02, sigmas=(0.6, SIGMA)
    )
    return fine.best(effort.carried)


def with_second_limb(
    problems: Problems, some: Population, random: np.random.Generator, effort: Effort
) -> Population:
    """Bodies with both limbs, best first by all recordings together."""
    if problems.second is None or problems.pair is None:
        return some
    rows = unfolded(problems.first, some.rows)
    some = Population(rows=rows, orders=some.orders, loss=some.loss)
    begun = second_limb(problems, some, effort.images, random)
    number = max(1, effort.bundled // len(some.rows))
    kept = begun.some(best_of_each(begun.loss, len(some.rows), number))
    whole = problems.whole.descended(kept, steps=300, rate=0.02, sigmas=(0.5, SIGMA))
    return problems.whole.descended(
        whole.best(effort.bundled // 4), steps=500, rate=0.02, sigmas=(0.4, SIGMA)
    ).best(effort.bundled)


def second_limb(
    problems: Problems, parents: Population, each: int, random: np.random.Generator
) -> Population:
    """Mirror images of the first limb, fitted while all else is held; `each` for each parent."""
    assert problems.second is not None
    assert problems.pair is not None
    body, pair = problems.body, problems.pair
    begun, _ = mirrored(body, parents, pair, each, random, problems.image)
    free = body.free(*_parts_of(body, pair[1]))
    # The part of shared skins that the first limb never felt may move as well.
    coarse = problems.second.descended(begun, steps=400, rate=0.04, sigmas=(3.0, 0.3), free=free)
    return problems.second.descended(coarse, steps=150, rate=0.02, sigmas=(0.5, SIGMA), free=free)


def refined(
    problems: Problems, one: Population, random: np.random.Generator, effort: Effort
) -> Population:
    """A body whose parts were drawn anew one after the other, and kept where the loss fell."""
    parts = list(problems.body.layout.limbs)
    for _ in range(effort.passes):
        for limb in parts:
            one = _lower(one, redrawn(problems, one, limb, random, effort))
    last = problems.whole.descended(one, steps=effort.last_steps, rate=0.02, sigmas=(0.6, SIGMA))
    return _lower(one, last)


def redrawn(
    problems: Problems,
    one: Population,
    limb: str,
    random: np.random.Generator,
    effort: Effort,
) -> Population:
    """The best body with one limb drawn anew: as the mirror of its pair, or at random."""
    body, whole = problems.body, problems.whole
    if problems.pair and limb in problems.pair:
        other = problems.pair[1 - problems.pair.index(limb)]
        begun, _ = mirrored(body, one, (other, limb), effort.redrawn, random, problems.image)
    else:
        begun = _limb_at_random(body, one, limb, effort.redrawn, random)
    own = set(body.layout.limbs[limb])
    recordings = [r for r in whole.recordings if own & set(body.layout.between(r))]
    problem = Problem(
        body=body, recordings=recordings, random=whole.random,
        data=Problem.of(body, recordings).data,
    )  # fmt: skip
    free = body.free(*_parts_of(body, limb))
    some = problem.descended(begun, steps=400, rate=0.04, sigmas=(3.0, 0.3), free=free)
    some = problem.descended(some.best(6), steps=300, rate=0.02, sigmas=(0.6, SIGMA), free=free)
    return whole.descended(some.best(3), steps=400, rate=0.02, sigmas=(0.5, SIGMA)).best()


def _limb_at_random(
    body: Body, one: Population, limb: str, number: int, random: np.random.Generator
) -> Population:
    rows, before = np.repeat(one.rows, number, axis=0), one.rows[0]
    joints, ends = list(body.layout.limbs[limb]), _parts_of(body, limb)[0]
    drawn = at_random(body, number, random)
    body.axes(rows)[:, joints] = body.axes(drawn)[:, joints]
    middle = body.centres(before)[joints].mean(axis=0)
    body.centres(rows)[:, joints] = middle + random.normal(size=(number, len(joints), 3))
    for end in ends:
        own = body.coefficients(before, end)
        there = own[0] + random.normal(size=(number, 3))
        if random.random() < 0.5 and end in body.skins:
            scatter_end(body, rows, end, random)
        else:
            body.coefficients(rows, end)[:] = own @ any_turns(number, random)
        body.coefficients(rows, end)[:, 0] = there
    orders = np.repeat(one.orders, number, axis=0)
    return Population(rows=rows, orders=orders, loss=np.full(number, np.nan))


def _parts_of(body: Body, limb: str) -> tuple[list[str], list[int]]:
    """Ends and joints of a limb."""
    ends = [end for end in body.ends if body.layout.holder[end] == limb]
    return ends, list(body.layout.limbs[limb])


def best_of_each(loss: np.ndarray, parents: int, number: int) -> np.ndarray:
    """Indices of the best children of each parent."""
    each = len(loss) // parents
    best = np.argsort(loss.reshape(parents, each), axis=1, kind="stable")[:, :number]
    return (best + each * np.arange(parents)[:, None]).ravel()


def _image(body: Body, recordings: Sequence[Recording], pair: tuple[str, str]) -> Image:
    """What touches say of the second limb of a pair as a mirror image of the first."""
    layout = body.layout
    sense = np.ones(body.num_joints)
    told = senses(recordings, layout, *pair)
    for limb in pair:
        sense[list(layout.limbs[limb])] = told
    sides = {}
    for end, skin in body.skins.items():
        if not layout.holder[end]:
            felt = [np.zeros(len(skin.receptor)), np.zeros(len(skin.receptor))]
            for one in recordings:
                for side, limb in enumerate(pair):
                    if {layout.holder[one.above], layout.holder[one.below]} == {limb, ""}:
                        own = one.felt(end)
                        felt[side] += 0 if own is None else own[:, skin.receptor].sum(axis=0)
            if felt[0].any() and felt[1].any():
                sides[end] = felt[1] / felt[1].sum() - felt[0] / felt[0].sum()
    return Image(sense=sense, sides=sides)


def _lower(one: Population, other: Population) -> Population:
    """Whichever has the lower loss."""
    return other if other.loss[0] < one.loss[0] else one
