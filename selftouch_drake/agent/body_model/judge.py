"""Whether a body model may be believed: one rule, on touches that no fit has seen.

Held-out touches come in neighbourhoods of motor space, so that a map that only remembers what lies
beside them gains nothing. A touch is near if it lies nearer to its own kernel's place than
neighbouring kernels lie to each other. A touch farther than three such distances is an outlier: its
label is wrong, or another toucher made it. A wrong body does not make outliers; it makes touches
that are neither near nor far. So what counts is the share of near touches among those that are no
outliers, and the share of outliers is told beside it.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.refine import kernel_medians

#: A part is accepted above this share of near touches among held-out inliers.
ACCEPTED = 0.85
#: Distances between neighbouring kernels beyond which a touch is an outlier, and the largest share
#: of outliers at which a part is accepted.
OUTLIER, MOST_OUTLIERS = 3.0, 0.5
#: Touches of a part for each parameter of its chain.
TOUCHES_PER_PARAMETER = 3
#: Held-out touches that a judgement needs.
FEWEST_HELD_OUT = 20
# Share of the touches that is held out, at most so many, in so many neighbourhoods.
_SHARE, _MOST, _NEIGHBOURHOODS = 0.12, 6000, 60


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """What held-out touches say of one part.

    Attributes:
        accepted: whether the part may be believed.
        near: share of near touches among those that are no outliers; NaN if nothing was tested.
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


def held_out(q: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """`(R,)` bool, touches to hold out: whole neighbourhoods of motor space.

    Args:
        q: `(R, J)` standardised readings.
        random: source of randomness.
    """
    number = min(int(_SHARE * len(q)), _MOST)
    chosen = np.zeros(len(q), dtype=bool)
    if number < 1:
        return chosen
    size = -(-number // _NEIGHBOURHOODS)
    centers = q[random.permutation(len(q))[: -(-number // size)]]
    # Near the centre among a share of all touches: a neighbourhood keeps its size as touches grow.
    near = cKDTree(q).query(centers, k=size)[1]
    chosen[np.ravel(near)] = True
    return chosen


def judged(
    places: np.ndarray,
    target: np.ndarray,
    test_places: np.ndarray,
    test_target: np.ndarray,
    *,
    parameters: int,
    number: int,
) -> Judgement:
    """Judges one part.

    Args:
        places: `(n, 3)` places of training touches; NaN for outliers.
        target: `(n,)` their target sensations.
        test_places: `(m, U, 3)` places of held-out touches for each toucher that reaches the part.
        test_target: `(m,)` theirs.
        parameters: of the chains to this part.
        number: of target sensations.
    """
    middle = kernel_medians(places, target, number, least=3)
    known = np.flatnonzero(np.isfinite(middle).all(axis=1))
    tested = np.isfinite(middle[test_target]).all(axis=1)
    few = _too_few(len(target), parameters, int(tested.sum()), len(known))
    if few:
        return Judgement(
            accepted=False, near=np.nan, inliers=np.nan, criterion=np.nan,
            tested=int(tested.sum()), reason=few,
        )  # fmt: skip
    apart = float(np.median(cKDTree(middle[known]).query(middle[known], k=2)[0][:, 1]))
    away = test_places[tested] - middle[test_target[tested]][:, None]
    distance = np.linalg.norm(away, axis=2)
    best = np.nan_to_num(distance, nan=np.inf).argmin(axis=1)
    rows = np.arange(len(best))
    distance = distance[rows, best] / apart
    inlier = distance < OUTLIER
    near = float((distance < 1).sum() / max(inlier.sum(), 1))
    inliers = float(inlier.mean())
    accepted = near > ACCEPTED and inliers > 1 - MOST_OUTLIERS
    return Judgement(
        accepted=accepted,
        near=near,
        inliers=inliers,
        criterion=_criterion(away[rows, best][inlier], test_places[tested][rows, best][inlier]),
        tested=len(rows),
        reason=(
            f"{near:.1%} of {inlier.sum()} held-out touches lie nearer to their own kernel than "
            f"kernels lie to each other ({ACCEPTED:.0%} needed), {1 - inliers:.1%} are outliers "
            f"({MOST_OUTLIERS:.0%} allowed)"
        ),
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
