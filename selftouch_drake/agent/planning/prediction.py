"""The sensations that the agent expects along a plan, and how sure it is."""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.motions import NO_KERNEL, Plan, steps
from selftouch_drake.agent.planning.touch_model import TouchModel
from selftouch_drake.agent.representation.quotient import QuotientRepresentation, stored_row
from selftouch_drake.quotient.smooth import DEGREE, smooth_curve

# Number of sensations averaged into one: fewer are noisier, more blur. 8 and 24 work as well.
_NUM_ALIKE = 16
# Spread at a waypoint, as a share of the mean distance between the sensations of two waypoints.
_SPREAD_AT_WAYPOINT = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """The sensations expected along a plan.

    Attributes:
        sensation: `(T, S)` unit L2 norm; null in the air.
        spread: `(T,)` proportional to the expected error, a cosine distance: small at waypoints,
            large halfway between two very different sensations. Executions give the factor.
    """

    sensation: np.ndarray
    spread: np.ndarray


def predict_sensation(
    representation: QuotientRepresentation,
    plan: Plan,
    s: np.ndarray,
    kernel_sensation: csr_array | None = None,
    touch_model: TouchModel | None = None,
) -> Prediction:
    """The sensation expected along a plan, from stored touches.

    On steps that a model of touch bends, it also says what is felt: on a torus with twelve joints
    the mean error is 0.031, with stored touches 0.056.

    With target sensations alone, the prediction is interpolated from one to the next; its error is
    about the size of a cell. With the sensations of the stored configurations the error is five
    times smaller, in three steps. First, the sensations felt at the waypoints are interpolated.
    Then each interpolated sensation is replaced by the mean of the most similar sensations that
    were really felt, because two half touches are not one touch halfway. Then the result is
    smoothed like the path. On 60 plans on the torus (300 targets) these steps reduce the mean error
    from 0.036 to 0.017, 0.009 and 0.006. Averages over stored configurations that are near in motor
    space are worse (0.03 to 0.26), because neighbours in motor space can be far apart on the skin.

    The plan was made with the representation; `(T,)` s are path lengths, mu, from 0 to
    `plan.waypoint_s[-1]`; `(R, S)` kernel sensations of unit L2 norm were felt at the rows of
    `kernel_q`.
    """
    plan = plan.without_imagined()
    at_waypoints = np.array(representation.target_sensations[plan.nodes], dtype=float)
    if kernel_sensation is not None:
        for row, (node, q) in enumerate(zip(plan.nodes, plan.waypoints_q, strict=True)):
            stored = None if node == NO_KERNEL else stored_row(representation, node, q)
            if stored is not None:
                at_waypoints[row] = kernel_sensation[[stored]].toarray()[0]
    if plan.nodes[0] == NO_KERNEL:
        at_waypoints[0] = at_waypoints[1]
    length = plan.waypoint_s[-1]
    if kernel_sensation is None or length == 0.0:
        expected = _blend(plan, at_waypoints, s)
    else:

        def truly_felt(u: np.ndarray) -> np.ndarray:
            blend = _unit(_blend(plan, at_waypoints, u))
            return _most_alike(representation, kernel_sensation, plan, u, blend)

        # The sensation is smoothed in the same way as the path.
        num_intervals = len(plan.path.t) - 2 * DEGREE - 1
        smooth = smooth_curve(truly_felt, at_waypoints[[0, -1]], length, num_intervals)
        expected = np.clip(smooth(s), 0.0, None)
    if touch_model is not None and len(plan.modes):
        modes = plan.modes[steps(plan.waypoint_s, s)]
        for mode, firmness in enumerate(touch_model.of_mode):
            if firmness is not None and (rows := modes == mode).any():
                expected[rows] = firmness.sensation(representation.scaled(plan.path(s[rows])))
    expected[~plan.touching(s)] = 0.0
    return Prediction(
        sensation=_unit(expected), spread=_spread(plan.waypoint_s, _unit(at_waypoints), s)
    )


def recall_sensation(plan: Plan, s: np.ndarray, places: np.ndarray, felt: np.ndarray) -> Prediction:
    """The sensation expected along a plan that the agent followed before, at `s` `(T,)` mu.

    It felt `(n, S)` N at `(n,)` places, mu, that rise from the start to the end of the plan.
    """
    at_places = _unit(felt)
    expected = _mixed(at_places, *_share(places, s))
    expected[~plan.touching(s)] = 0.0
    return Prediction(sensation=_unit(expected), spread=_spread(places, at_places, s))


def _most_alike(
    representation: QuotientRepresentation,
    kernel_sensation: csr_array,
    plan: Plan,
    s: np.ndarray,
    blend: np.ndarray,
) -> np.ndarray:
    """`(T, S)` mean of the sensations most similar to each of `blend`, in kernels near that step.

    These are the two kernels of the step, and those that the graph joins to both; on a step through
    the air, only the two.
    """
    joined = np.zeros((representation.num_targets,) * 2, dtype=bool)
    i, j = representation.edges.T
    joined[i, j] = joined[j, i] = True
    result = np.empty_like(blend)
    step = steps(plan.waypoint_s, s)
    for number in np.unique(step):
        a, b = plan.nodes[number : number + 2]
        near = {b} if a == NO_KERNEL else {a, b, *np.flatnonzero(joined[a] & joined[b])}
        members = np.concatenate([np.r_[representation.members(k)] for k in sorted(near)])
        felt = kernel_sensation[members]
        here = step == number
        likeness = np.ascontiguousarray((felt @ blend[here].T.astype(felt.dtype)).T)
        alike = members[_largest(likeness, min(_NUM_ALIKE, len(members)))]
        chosen = kernel_sensation[alike.ravel()].toarray()
        result[here] = chosen.reshape(*alike.shape, -1).mean(axis=1)
    return _unit(result)


@numba.njit(cache=True)
def _largest(values: np.ndarray, count: int) -> np.ndarray:
    """`(n, count)` where the largest of each row of `(n, m)` are, in no order.

    Of thousands of values, a few are kept: numpy's `argpartition` takes ten times as long.
    """
    found = np.empty((len(values), count), dtype=np.int64)
    for row, kept in zip(values, found):  # noqa: B905 (numba's zip is never strict)
        kept[:] = np.arange(count)
        worst = np.argmin(row[:count])
        for place in range(count, len(row)):
            if row[place] > row[kept[worst]]:
                kept[worst] = place
                worst = np.argmin(row[kept])
    return found


def _spread(waypoint_s: np.ndarray, at_waypoints: np.ndarray, s: np.ndarray) -> np.ndarray:
    """`(T,)` a parabola between each two waypoints, as high as the distance of their sensations.

    Its rank correlation with the error is 0.6 (300 targets) and 0.35 (1000). The distance of the
    path from its polyline and the length of the step do not correlate with the error.
    """
    if len(waypoint_s) == 1:
        return np.zeros(len(s))
    apart = 1.0 - np.sum(at_waypoints[1:] * at_waypoints[:-1], axis=1)
    step, share = _share(waypoint_s, s)
    return 4.0 * share * (1.0 - share) * apart[step] + _SPREAD_AT_WAYPOINT * apart.mean()


def _share(waypoint_s: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`(T,)` the step that each `s` is part of, and `(T,)` the share of it that is done."""
    before = steps(waypoint_s, s)
    after = np.minimum(before + 1, len(waypoint_s) - 1)
    length = waypoint_s[after] - waypoint_s[before]
    along = s - waypoint_s[before]
    return before, np.divide(along, length, out=np.zeros(len(s)), where=length > 0.0)


def _blend(plan: Plan, sensation: np.ndarray, s: np.ndarray) -> np.ndarray:
    """`(T, S)` linear interpolation between the `(W, S)` sensations at the waypoints.

    In the air it jumps halfway, so that smoothing does not mix one touch with the next.
    """
    before, share = _share(plan.waypoint_s, s)
    if plan.in_air.any():
        share = np.where(plan.in_air[before], np.round(share), share)
    return _mixed(sensation, before, share)


def _mixed(sensation: np.ndarray, before: np.ndarray, share: np.ndarray) -> np.ndarray:
    """`(T, S)` linear interpolation in `(W, S)`, at a share of the way from row `before` on."""
    after = np.minimum(before + 1, len(sensation) - 1)
    share, rows = np.stack([1.0 - share, share], axis=1), np.stack([before, after], axis=1)
    ends = np.arange(0, rows.size + 1, 2)
    mixing = csr_array((share.ravel(), rows.ravel(), ends), shape=(len(rows), len(sensation)))
    return mixing @ sensation


def _unit(sensation: np.ndarray) -> np.ndarray:
    """`(T, S)` each row divided by its L2 norm; null rows stay null."""
    length = np.sqrt(np.einsum("ts,ts->t", sensation, sensation))
    return sensation * np.divide(1.0, length, out=length, where=length > 0.0)[:, None]
