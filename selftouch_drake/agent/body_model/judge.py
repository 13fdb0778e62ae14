"""Whether a body model may be believed: one rule, on touches that no fit has seen.

A model of joints says where a touch lies; so does a memory that knows no joints, if it has touched
beside that touch. Only what memory cannot reach proves joints. So each held-out touch is compared
with those touches of its kernel that are *far* from it in motor space, the farther half: joints
bring them to one place although their postures differ, and a map that merely remembers does not.
And a held-out touch whose place a regression without joints finds as well, from all touches that
are as far from it, proves nothing and is left out. Where that leaves few, a rejection does not say
that the body is wrong: the touches prove nothing. A short chain has one or two postures for each
place, which a regression learns.

A touch is near if it lies nearer to its kernel's place than neighbouring kernels lie to each other.
A touch farther than three such distances is an outlier: its label is wrong, or another toucher made
it. A wrong body does not make outliers; it makes touches that are neither near nor far. So what
counts is the share of near touches among those that are no outliers; of these there must be a
majority, or the share falls with them.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.scene import kernel_medians, neighbour_distance

#: A part is accepted above this share of near touches among held-out inliers. Right bodies had
#: 0.89 and more (a torus after 3,000 touches), wrong ones at most 0.87 (a backlash of 0.06 rad) and
#: 0.85 (four joints whose readings mix, places 8 % off).
ACCEPTED = 0.88
#: The same for a part all of whose joints are proved by other parts. Of the parts of two arms and
#: an infant the right link has 0.81 to 0.96 near, the best of the others 0.49.
ACCEPTED_OF_PROVED = 0.75
#: Both where a hand has three points or more, of which the nearest counts. An iCub's head had 0.94
#: with the right joints, and 0.90 with two at wrong places, 6.5 % off; of its forearms the right
#: link has 0.82 to 0.92, the best of the others 0.72.
ACCEPTED_BY_SEVERAL, ACCEPTED_OF_PROVED_BY_SEVERAL = 0.93, 0.8
#: Distances between neighbouring kernels beyond which a touch is an outlier.
OUTLIER = 3.0
#: Touches of a part for each parameter of its chain.
TOUCHES_PER_PARAMETER = 3
#: Held-out touches that a judgement needs.
FEWEST_HELD_OUT = 20
#: What held-out touches are for: to choose between chains, or for the verdict alone.
CHOICE, VERDICT = 1, 2
# Share of the held-out touches that must need joints, or else a rejection proves nothing. Chains
# made by hand, right or bent: 3 to 37 % with two and three joints, 79 % and more with four.
_NEED_JOINTS = 0.5
# A kernel has one posture if half of its touches lie nearer to each other than this, relative to
# any two touches, in motor space. Medians over kernels of made-up bodies: 0.01 to 0.02 with two
# joints, 0.05 for postures drawn at random, 0.17 with three joints, 0.3 and more with four.
_ONE_POSTURE = 0.1
# Share of the touches that is held out, at least and at most so many, in so many neighbourhoods.
_SHARE, _MOST_OF_FEW, _ENOUGH, _MOST, _NEIGHBOURHOODS = 0.12, 0.2, 240, 6000, 60
# Held-out touches that are judged at most, and touches that a memory has: more change nothing but
# the seconds.
_JUDGED, _REMEMBERED = 2000, 20_000
# Touches of a local regression for each of its coefficients, its damping, and touches of a mean.
_PER_COEFFICIENT, _DAMPING, _IN_MEAN = 3, 1e-3, 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """What held-out touches say of one part.

    Attributes:
        accepted: whether the part may be believed.
        near: share of near touches among those that are no outliers and prove something; NaN if
            nothing was tested.
        inliers: share of touches that are no outliers; NaN likewise.
        criterion: log-determinant of the scatter of inliers within kernels, less that of the total.
        tested: number of held-out touches.
        reason: a sentence with the figures.
    """

    accepted: bool
    near: float
    inliers: float
    criterion: float
    tested: int
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sample:
    """Touches of one part, as a model sees them.

    Attributes:
        q: `(n, J)` standardised readings of the joints between the part and its touchers.
        target: `(n,)` target sensations.
        places: `(n, U, 3)` place of each toucher, in the part's frame; NaN where it does not reach.
        toucher: `(n,)` who touched; -1 for an outlier. Not read of held-out touches.
    """

    q: np.ndarray
    target: np.ndarray
    places: np.ndarray
    toucher: np.ndarray

    def some(self, rows: np.ndarray) -> "Sample":
        """Some of the touches."""
        return Sample(
            q=self.q[rows], target=self.target[rows], places=self.places[rows],
            toucher=self.toucher[rows],
        )  # fmt: skip

    def own_places(self) -> np.ndarray:
        """`(n, 3)` places of who touched; NaN for outliers."""
        own = self.places[np.arange(len(self.q)), np.maximum(self.toucher, 0)]
        return np.where((self.toucher >= 0)[:, None], own, np.nan)


def held_out(q: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """`(R,)` 0, or what a touch is held out for: whole neighbourhoods of motor space.

    Args:
        q: `(R, J)` standardised readings.
        random: source of randomness.
    """
    few = min(int(_MOST_OF_FEW * len(q)), _ENOUGH)
    number = min(max(int(_SHARE * len(q)), few), _MOST)
    purpose = np.zeros(len(q), dtype=np.int8)
    if number < 1:
        return purpose
    size = -(-number // _NEIGHBOURHOODS)
    centers = q[random.permutation(len(q))[: -(-number // size)]]
    # Near the centre among a share of all touches: a neighbourhood keeps its size as touches grow.
    near = cKDTree(q).query(centers, k=size)[1].reshape(len(centers), size)
    # One neighbourhood in three is for the choice; what it shares with others, for the verdict.
    purpose[near[0::3].ravel()] = CHOICE
    purpose[near[1::3].ravel()] = VERDICT
    purpose[near[2::3].ravel()] = VERDICT
    return purpose


def judged(
    train: Sample, test: Sample, *, parameters: int, number: int, needed: float = ACCEPTED
) -> Judgement:
    """Judges one part.

    Args:
        train: touches of the fit.
        test: held-out touches.
        parameters: of the chains to this part, which nothing but its touches tells.
        number: of target sensations.
        needed: share of near touches above which it is accepted.
    """
    own = train.own_places()
    middle = kernel_medians(own, train.target, number, least=3)
    known = np.flatnonzero(np.isfinite(middle).all(axis=1))
    rows = np.flatnonzero(np.isfinite(middle[test.target]).all(axis=1))
    test = test.some(rows[:: max(1, -(-len(rows) // _JUDGED))])
    few = _too_few(len(train.q), parameters, len(test.q), len(known))
    if few:
        return unproven(few, len(test.q))
    apart = neighbour_distance(middle[known])
    radius, there = distant(train, own, test)
    away = test.places - there[:, None]
    distance = np.nan_to_num(np.linalg.norm(away, axis=2), nan=np.inf)
    best = distance.argmin(axis=1)
    each = np.arange(len(best))
    distance, away = distance[each, best] / apart, away[each, best]
    inlier = distance < OUTLIER
    inliers = float(inlier.mean())
    places = remembered(train.q, middle[train.target], test.q, radius)
    off = np.linalg.norm(places - middle[test.target], axis=2) / apart
    need_joints = (off > 1).all(axis=0)
    proves = inlier & need_joints
    if inliers > 0.5 and proves.sum() < FEWEST_HELD_OUT:
        few = _prove_nothing(proves.sum(), inlier.sum(), str(FEWEST_HELD_OUT))
        return unproven(few, len(each))
    near = float((distance[proves] < 1).sum() / max(proves.sum(), 1))
    accepted = near * min(1.0, 2 * inliers) > needed
    figures = (
        f"{near:.1%} of {proves.sum()} held-out touches lie nearer to their own kernel than "
        f"kernels lie to each other ({needed:.0%} needed), {1 - inliers:.1%} of "
        f"{len(each)} are outliers (fewer than half needed)"
    )
    # Places of a wrong chain may be such that no regression finds them: one posture tells then.
    need_joints &= radius > _ONE_POSTURE * np.sqrt(2 * train.q.var(axis=0).sum())
    if not accepted and need_joints.mean() < _NEED_JOINTS:
        few = _prove_nothing(need_joints.sum(), len(each), f"{_NEED_JOINTS:.0%}")
        figures = f"{few}; {figures}"
    return Judgement(
        accepted=accepted,
        near=near,
        inliers=inliers,
        criterion=_criterion(away[inlier], test.places[each, best][inlier]),
        tested=len(each),
        reason=figures,
    )


def distant(train: Sample, own: np.ndarray, test: Sample) -> tuple[np.ndarray, np.ndarray]:
    """The place of each held-out touch's kernel, from postures far from its own.

    Args:
        train: touches of the fit.
        own: `(n, 3)` their places; NaN for outliers.
        test: m held-out touches of kernels that training touches met.

    Returns:
        `(m,)` the median distance, in motor space, to touches of the same kernel; and `(m, 3)` the
        median of the places of those beyond, NaN if most of these are outliers.
    """
    order = np.argsort(train.target, kind="stable")
    bounds = np.searchsorted(train.target[order], [test.target, test.target + 1])
    radius, place = np.zeros(len(test.q)), np.full((len(test.q), 3), np.nan)
    for kernel in np.unique(test.target):
        here = np.flatnonzero(test.target == kernel)
        rows = order[bounds[0, here[0]] : bounds[1, here[0]]]
        apart = np.linalg.norm(test.q[here, None] - train.q[rows][None], axis=2)
        radius[here] = np.median(apart, axis=1)
        for touch, from_it in zip(here, apart, strict=True):
            beyond = own[rows[from_it >= radius[touch]]]
            explained = beyond[np.isfinite(beyond[:, 0])]
            if 2 * len(explained) > len(beyond):
                place[touch] = np.median(explained, axis=0)
    return radius, place


def remembered(
    q: np.ndarray, place: np.ndarray, held_out_q: np.ndarray, radius: np.ndarray
) -> np.ndarray:
    """Places of held-out touches from touches beside them, by regressions that know no joints.

    Args:
        q: `(n, J)` standardised readings of touches of the fit.
        place: `(n, 3)` where a memory knows them; NaN where it does not.
        held_out_q: `(m, J)` of held-out touches.
        radius: `(m,)` in motor space; touches within it are not remembered.

    Returns:
        `(2, m, 3)` places by a mean of neighbours, and by a local linear regression.
    """
    kept = np.flatnonzero(np.isfinite(place).all(axis=1))
    kept = kept[:: max(1, -(-len(kept) // _REMEMBERED))]
    q, place = q[kept], place[kept]
    width = q.shape[1] + 1
    number = min(_PER_COEFFICIENT * width, len(q))
    found = np.empty((2, len(held_out_q), 3))
    lengths = (q**2).sum(axis=1)
    penalty = _DAMPING * number * np.diag([0.0] + [1.0] * (width - 1))
    for start in range(0, len(held_out_q), 250):
        some = slice(start, min(start + 250, len(held_out_q)))
        mine = held_out_q[some]
        square = (mine**2).sum(axis=1)[:, None] + lengths - 2 * mine @ q.T
        square[square < radius[some, None] ** 2] = np.inf
        near = np.argpartition(square, number - 1, axis=1)[:, :number]
        nearest = np.argsort(np.take_along_axis(square, near, axis=1), axis=1)[:, :_IN_MEAN]
        found[0, some] = place[np.take_along_axis(near, nearest, axis=1)].mean(axis=1)
        ones = np.ones((*near.shape, 1))
        A = np.concatenate([ones, q[near] - mine[:, None]], axis=2)
        transposed = A.swapaxes(1, 2)
        found[1, some] = np.linalg.solve(transposed @ A + penalty, transposed @ place[near])[:, 0]
    return found


def _prove_nothing(needing: int, among: int, needed: str) -> str:
    return (
        f"the touches prove nothing: {needing} of {among} held-out touches need joints to be "
        f"explained ({needed} needed), a regression that knows no joints places the others as "
        f"well, or their kernel has one posture"
    )


def unproven(reason: str, tested: int) -> Judgement:
    """The judgement where touches prove nothing."""
    return Judgement(
        accepted=False, near=np.nan, inliers=np.nan, criterion=np.nan, tested=tested, reason=reason
    )


def _too_few(touches: int, parameters: int, tested: int, kernels: int) -> str:
    needed = TOUCHES_PER_PARAMETER * parameters
    if touches < needed:
        return f"{touches} touches are too few for {parameters} parameters ({needed} needed)"
    if tested < FEWEST_HELD_OUT:
        return f"{tested} held-out touches are too few to test it ({FEWEST_HELD_OUT} needed)"
    if kernels < 8:
        return f"{kernels} kernels with 3 touches are too few to test it (8 needed)"
    return ""


def _criterion(away: np.ndarray, places: np.ndarray) -> float:
    if len(away) < 8:
        return np.nan
    tiny = 1e-12 * np.eye(3)
    within, total = np.cov(away.T) + tiny, np.cov(places.T) + tiny
    return float(np.linalg.slogdet(within)[1] - np.linalg.slogdet(total)[1])
