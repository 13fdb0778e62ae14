"""A chain from few touches: found by what they feel like, judged by touches left out in turn.

Below some thousand touches a kernel has a few members at most, and its label says little. The
search is that of kernels, with sensations in place of labels (`smoothness`). What joints read has
no unit that is known; but few touches say more if all joints turn alike by what they read, and
whether they do, touches tell.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.sparse import csr_array
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.body_model import structure
from selftouch_drake.agent.body_model.chain import places
from selftouch_drake.agent.body_model.fit import Bodies, Smooth
from selftouch_drake.agent.body_model.judge import (
    FEWEST_HELD_OUT,
    OUTLIER,
    TOUCHES_PER_PARAMETER,
    Judgement,
    remembered,
    unproven,
)
from selftouch_drake.agent.body_model.model import JointKind
from selftouch_drake.agent.body_model.scene import kernel_medians, neighbour_distance
from selftouch_drake.agent.body_model.smoothness import Sensed, SmoothChain, finished, spread
from selftouch_drake.agent.body_model.structure import Search

#: With fewer touches no body is looked for; with more kernels are as good, and cheaper.
FEWEST, MOST = 40, 2000
#: A joint slides if it turns by less over its range, in radians, and if not to turn costs less.
SLIDES, SLIDE_COST = 0.2, 0.05
#: Below this turn, in radians, turning and sliding look alike.
OPEN = 0.6
# Touches that a search and a finish look at.
_SEARCHED, _FINISHED = 256, 1000
# Of fewer touches than this more populations are searched, and more chains of each. Of 50 touches
# of ten cubes and ten tori six chains of a population led to the right body in 55 of 60 tries, two
# in 51.
_MANY = 150
#: How much more noise a search takes for granted: more of it makes false optima fewer.
SEARCHED_NOISE = 3.0
# A judgement leaves out each of so many sets of touches in turn, and fits the rest anew in so many
# steps at most.
_FOLDS, _REFITTED = 5, 30
# Touches of a neighbourhood in the space of sensations, with which the judgement compares places,
# and the most of these neighbourhoods.
_NEIGHBOURS, _MOST_NEIGHBOURHOODS = 5, 300
# Touches that say where sensations are in the judgement of a tree, and its neighbourhoods: more
# would be finer than depths of touches, and of 300 of two arms 0.6 lay near with the right joints.
_SAYING, _OF_TREE = 1000, 100
# A neighbourhood is coarser than a kernel. A touch is near within this share of the distance to
# the next one, and so many must be near. Of 100 touches of two cubes the right chains had 0.69 and
# more, those of readings that mix joints by 0.1 up to 0.46; within the whole distance 0.90, 0.91.
_NEAR, _ACCEPTED = 0.5, 0.6
# Parameters of a joint that turns or slides; a similarity of all of space changes nothing.
_OF_JOINT, _OF_SIMILARITY = 5, 7


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FewFound:
    """A chain that few touches led to.

    Attributes:
        order: of its joints.
        twists: `(J, 6)` of all joints, for standardised readings.
        point: `(3,)` of the toucher.
        kind: `(J,)` values of `JointKind`.
        swaps: `(L - 1,)` what it costs that neighbours change places.
        place: `(n, 3)` of the touches, as their sensations say it.
        judgement: by touches left out.
        spread: `(6 J + 3, 6 J + 3)` covariance of twists and point; NaN for joints left out.
        alike: whether all joints turn alike by what they read, as far as touches say.
    """

    order: list[int]
    twists: np.ndarray
    point: np.ndarray
    kind: np.ndarray
    swaps: np.ndarray
    place: np.ndarray
    judgement: Judgement
    spread: np.ndarray
    alike: bool


# Matrices of few touches are small: threads that share in one wait for each other.
@threadpool_limits.wrap(limits=1, user_api="blas")
def found_by_sensation(
    search: Search, q: np.ndarray, sensation: csr_array, joints: list[int]
) -> FewFound | None:
    """The first chain that touches left out accept, else the smoothest.

    That chains which began apart agree proves nothing: with few touches they share false optima.

    Args:
        search: what to work on.
        q: `(n, J)` standardised readings.
        sensation: `(n, S)` readings of the receptors.
        joints: that move.
    """
    all_sensed = Sensed.of(sensation)
    used = np.sort(search.random.permutation(len(q))[:_FINISHED])
    sensed, q = all_sensed.some(used), q[used]
    precision = sensed.precision()
    some = np.sort(search.random.permutation(len(used))[:_SEARCHED])
    smooth = sensed.some(some).precision(SEARCHED_NOISE)
    labels = neighbourhoods(sensed, search.random)
    least = np.inf
    best: tuple[list[int], SmoothChain, np.ndarray | None, Judgement] | None = None
    for body in found_chains(search, used[some], smooth, joints):
        order, rough = rough_chain(body)
        unit = None if search.scale is None else search.scale[order]
        chain, unit, verdict = _judged(q[:, order], precision, sensed, labels, rough, unit)
        cost = chain.criterion + _complexity(len(q), len(order), unit)
        if cost < least or verdict.accepted:
            least, best = cost, (order, chain, unit, verdict)
        if verdict.accepted:
            break
    if best is None:
        return None
    order, chain, unit, verdict = best
    chain, kinds = _kinds(q[:, order], precision, chain, unit)
    kind = np.full(q.shape[1], int(JointKind.UNUSED))
    kind[order] = kinds
    twists = np.zeros((q.shape[1], 6))
    twists[order] = chain.twists
    place = places(q[:, order], chain.twists, chain.point)
    return FewFound(
        order=order, twists=twists, point=chain.point, kind=kind,
        swaps=_swap_costs(q, precision, order, chain, unit),
        place=sensed.predicted(place, all_sensed), judgement=verdict,
        spread=_spread(q, precision, order, chain, kinds, unit), alike=unit is not None,
    )  # fmt: skip


def found_chains(
    search: Search, rows: np.ndarray, precision: np.ndarray, joints: list[int]
) -> Iterator[Bodies]:
    """Chains of populations whose joints turn alike by what they read, and of others, in turn.

    None is a screw: screws in a wrong order may explain 50 touches better than the right joints.
    """
    free = np.full(search.num_joints, np.nan)
    alike = free if search.scale is None else search.scale
    times = math.ceil(_MANY / len(rows))
    for _ in range(times):
        for unit in (alike, free):
            group = Smooth(rows, precision, unit)
            yield from structure.found_chains(
                search, group, joints, populations=1, chains=times * structure.CHAINS
            )


def rough_chain(body: Bodies) -> tuple[list[int], SmoothChain]:
    """The joints of a chain of a search, in their order, and where its fit begins."""
    order = structure.order_of(body.ways[0][0])
    return order, SmoothChain(body.twists[0][order], body.points[0, 0], np.inf)


def _complexity(number: int, length: int, unit: np.ndarray | None) -> float:
    """What the parameters of a chain cost, per touch (BIC)."""
    alike = 0 if unit is None else int(np.isfinite(unit).sum())
    return needed_for(length, alike=alike)[0] * np.log(number) / number


def turning_alike(
    q: np.ndarray, precision: np.ndarray, chain: SmoothChain, unit: np.ndarray | None
) -> tuple[SmoothChain, np.ndarray | None]:
    """The chain whose joints turn alike by what they read, if the free one earns no more (BIC).

    Args:
        q: `(n, L)` standardised readings of its joints.
        precision: `(n, n)` of the places.
        chain: each of whose joints turns as far as it may.
        unit: `(L,)` how far q turns joints that read alike, NaN for others; None if that is not
            known.

    Returns:
        The chain, and the unit; None if the joints do not turn alike.
    """
    if unit is None:
        return chain, None
    alike = finished(q, precision, chain, unit=unit)
    earned = len(q) * (alike.criterion - chain.criterion)
    if earned > (np.isfinite(unit).sum() - 1) * np.log(len(q)):
        return chain, None
    return alike, unit


def _judged(
    q: np.ndarray,
    precision: np.ndarray,
    sensed: Sensed,
    labels: np.ndarray,
    rough: SmoothChain,
    unit: np.ndarray | None,
) -> tuple[SmoothChain, np.ndarray | None, Judgement]:
    """A chain, the unit if its joints turn alike, and what touches left out say of it.

    Beside readings of another unit a free chain fits their errors, too. So there the joints also
    turn alike if touches left out agree with that as well, less a standard error.
    """
    free = finished(q, precision, rough)
    chain, alike = turning_alike(q, precision, free, unit)
    verdict = left_out_in_turn(q, sensed, labels, chain, unit=alike)
    if unit is None or alike is not None or np.isfinite(unit).all():
        return chain, alike, verdict
    held = finished(q, precision, free, unit=unit)
    other = left_out_in_turn(q, sensed, labels, held, unit=unit)
    share, its = (one.near * min(1.0, 2 * one.inliers) for one in (verdict, other))
    if its >= share - np.sqrt(share * (1 - share) / len(q)):
        return held, unit, other
    return chain, None, verdict


def neighbourhoods(
    sensed: Sensed, random: np.random.Generator, *, most: int = _MOST_NEIGHBOURHOODS
) -> np.ndarray:
    """`(n,)` labels of touches that feel alike, some five to each, or at most so many labels."""
    number = int(np.clip(len(sensed.share) // _NEIGHBOURS, 1, most))
    # The bounds were chosen with these clusters; tighter ones ask for more.
    seed = int(random.integers(2**31))
    return kmeans2(np.sqrt(sensed.share), number, minit="++", seed=seed, missing="warn")[1]


def needed_for(num_joints: int, *, alike: int = 0) -> tuple[int, int]:
    """Parameters of a chain, some joints of which turn alike, and touches its judgement needs."""
    parameters = _OF_JOINT * num_joints + 3 - _OF_SIMILARITY - max(alike - 1, 0)
    return parameters, TOUCHES_PER_PARAMETER * parameters


def left_out_in_turn(
    q: np.ndarray,
    sensed: Sensed,
    labels: np.ndarray,
    chain: SmoothChain,
    *,
    unit: np.ndarray | None = None,
) -> Judgement:
    """Judges a chain by touches that it did not see: it is fitted anew without each fifth of them.

    The rule is that of `judge`, with a bound of its own; where a kernel lies, a sensation says.
    What a memory of all other touches places as well proves nothing.

    Args:
        q: `(n, L)` readings of its joints.
        sensed: what the touches feel like.
        labels: `(n,)` neighbourhoods.
        chain: of all touches.
        unit: `(L,)` of joints that turn alike, as in `finished`.
    """
    parameters, needed = needed_for(
        len(chain.twists), alike=0 if unit is None else int(np.isfinite(unit).sum())
    )
    if len(q) < needed:
        return unproven(
            f"{len(q)} touches are too few for {parameters} parameters ({needed} needed)", 0
        )
    fold = np.arange(len(q)) * _FOLDS // len(q)
    distance, off = np.empty(len(q)), np.empty(len(q))
    for left_out in range(_FOLDS):
        train, test = np.flatnonzero(fold != left_out), np.flatnonzero(fold == left_out)
        again = finished(q[train], sensed.some(train).precision(), chain, _REFITTED, unit=unit)
        place = places(q, again.twists, again.point)
        distance[test], off[test] = compared(sensed, labels, q, place, place[None, test], test)
    return verdict(distance, off, criterion=chain.criterion)


def judged_in_turn(
    sensation: csr_array,
    q: np.ndarray,
    place: np.ndarray,
    there: np.ndarray,
    judges: np.ndarray,
    random: np.random.Generator,
) -> Judgement:
    """Judges joints by some touches of a part, each left out of what says where sensations are.

    Args:
        sensation: `(n, S)` readings of the receptors.
        q: `(n, L)` readings of the joints.
        place: `(n, 3)` of the touches by the joints; NaN for outliers.
        there: `(U, n, 3)` where each toucher is.
        judges: `(n,)` bool, the touches that judge.
        random: where neighbourhoods begin.
    """
    others = random.permutation(np.flatnonzero(~judges))[:_SAYING]
    some = np.sort(np.concatenate([np.flatnonzero(judges), others]))
    sensation, q, judges = sensation[some], q[some], judges[some]
    place, there, number = place[some], there[:, some], int(judges.sum())
    if number < FEWEST_HELD_OUT or np.isfinite(place).all(axis=1).sum() < FEWEST:
        return unproven(
            f"{number} touches left out are too few to test it ({FEWEST_HELD_OUT} needed)", number
        )
    sensed = Sensed.of(sensation)
    labels = neighbourhoods(sensed, random, most=_OF_TREE)
    fold = np.arange(number) * _FOLDS // number
    distance, off = np.empty(number), np.empty(number)
    for left_out in range(_FOLDS):
        test = np.flatnonzero(judges)[fold == left_out]
        distance[fold == left_out], off[fold == left_out] = compared(
            sensed, labels, q, place, there[:, test], test
        )
    return verdict(distance, off, criterion=np.nan)


def compared(
    sensed: Sensed,
    labels: np.ndarray,
    q: np.ndarray,
    place: np.ndarray,
    there: np.ndarray,
    test: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """How far test touches lie from where their sensations say, by joints and by memory.

    Both `(m,)`, relative to the distance between neighbouring sensations.

    Args:
        sensed: what the touches feel like.
        labels: `(n,)` neighbourhoods.
        q: `(n, L)` readings.
        place: `(n, 3)` of the touches by joints that did not see the test touches; NaN for
            outliers. Those of test touches are not read.
        there: `(U, m, 3)` where each toucher is at the test touches, of which the nearest counts.
        test: `(m,)` rows of the test touches.
    """
    known = np.isfinite(place).all(axis=1)
    known[test] = False
    train = np.flatnonzero(known)
    expected = sensed.some(train).predicted(place[train], sensed.some(test))
    middle = kernel_medians(place[train], labels[train], int(labels.max()) + 1, least=2)
    apart = neighbour_distance(middle[np.isfinite(middle).all(axis=1)])
    memory = remembered(q[train], place[train], q[test], np.zeros(len(test)))
    by_joints, by_memory = (
        np.linalg.norm(found - expected, axis=2).min(axis=0) / apart for found in (there, memory)
    )
    return by_joints, by_memory


def verdict(distance: np.ndarray, off: np.ndarray, *, criterion: float) -> Judgement:
    """The judgement of touches left out, from what `compared` says of them."""
    inlier = distance < OUTLIER
    proves = inlier & (off > 1)
    number = len(distance)
    if 2 * inlier.sum() > number and proves.sum() < FEWEST_HELD_OUT:
        return unproven(
            f"a regression that knows no joints places all but {proves.sum()} of {inlier.sum()} "
            f"touches, left out in turn, as well: they prove nothing ({FEWEST_HELD_OUT} needed "
            "that do)",
            number,
        )
    near = float((distance[proves] < _NEAR).sum() / max(proves.sum(), 1))
    inliers = float(inlier.mean())
    # A share of few touches may be high by chance.
    surely = near - np.sqrt(near * (1 - near) / max(proves.sum(), 1))
    return Judgement(
        accepted=bool(surely * min(1.0, 2 * inliers) > _ACCEPTED),
        near=near,
        inliers=inliers,
        criterion=criterion,
        tested=number,
        reason=(
            f"{near:.1%} of {proves.sum()} touches, left out in turn, lie within half of the "
            f"distance between neighbouring sensations from where their own says, {surely:.1%} "
            f"less a standard error ({_ACCEPTED:.0%} needed), {1 - inliers:.1%} of {number} are "
            "outliers (fewer than half needed)"
        ),
    )


def clearly_off(judgement: Judgement) -> bool:
    """Whether touches left out say no, even if a standard error is added to their share."""
    near = judgement.near
    surely = near + np.sqrt(near * (1 - near) / max(judgement.tested, 1))
    return bool(surely * min(1.0, 2 * judgement.inliers) < _ACCEPTED)


def _kinds(
    q: np.ndarray, precision: np.ndarray, chain: SmoothChain, unit: np.ndarray | None
) -> tuple[SmoothChain, list[int]]:
    """Which joints turn, slide, or leave it open; those that slide do not turn at all."""
    turn = np.linalg.norm(chain.twists[:, :3], axis=1) * np.ptp(q, axis=0)
    kinds = [int(JointKind.TURNS)] * len(turn)
    for joint in np.argsort(turn, kind="stable"):
        if turn[joint] >= OPEN:
            break
        kinds[joint] = int(JointKind.OPEN)
        if turn[joint] < SLIDES:
            straight = chain.twists.copy()
            straight[joint, :3] = 0
            slides = np.array([kind == JointKind.SLIDES for kind in kinds])
            slides[joint] = True
            trial = finished(
                q, precision, SmoothChain(straight, chain.point, np.inf), slides=slides, unit=unit
            )
            if trial.criterion - chain.criterion < SLIDE_COST:
                chain, kinds[joint] = trial, int(JointKind.SLIDES)
    return chain, kinds


def _swap_costs(
    q: np.ndarray,
    precision: np.ndarray,
    order: list[int],
    chain: SmoothChain,
    unit: np.ndarray | None,
) -> np.ndarray:
    """`(L - 1,)` what it costs that neighbours change places."""
    cost = np.zeros(max(len(order) - 1, 0))
    slides = np.array([not twist[:3].any() for twist in chain.twists])
    for index in range(len(cost)):
        swapped = np.arange(len(order))
        swapped[[index, index + 1]] = index + 1, index
        other = SmoothChain(chain.twists[swapped], chain.point, np.inf)
        its = None if unit is None else unit[swapped]
        there = finished(
            q[:, np.array(order)[swapped]], precision, other, _REFITTED,
            slides=slides[swapped], unit=its,
        )  # fmt: skip
        cost[index] = there.criterion - chain.criterion
    return cost


def _spread(
    q: np.ndarray,
    precision: np.ndarray,
    order: list[int],
    chain: SmoothChain,
    kinds: list[int],
    unit: np.ndarray | None,
) -> np.ndarray:
    """`(6 J + 3, 6 J + 3)` covariance, for all joints of the readings."""
    slides = np.array([kind == JointKind.SLIDES for kind in kinds])
    own = [6 * joint + entry for joint in order for entry in range(6)]
    own += [6 * q.shape[1] + axis for axis in range(3)]
    result = np.full((6 * q.shape[1] + 3,) * 2, np.nan)
    result[np.ix_(own, own)] = spread(q[:, order], precision, chain, slides=slides, unit=unit)
    return result
