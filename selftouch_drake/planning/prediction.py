"""What the agent expects to feel along a plan."""

from __future__ import annotations

import numpy as np

from selftouch_drake.planning.plan import Plan
from selftouch_drake.planning.smoothing import DEGREE, smooth_curve
from selftouch_drake.representation.quotient import QuotientRepresentation

# Sensations that are averaged to one: fewer are noisier, more blur. 8 and 24 do as well.
_NUM_ALIKE = 16


def predict_sensation(
    representation: QuotientRepresentation,
    plan: Plan,
    s: np.ndarray,
    kernel_sensation: np.ndarray | None = None,
) -> np.ndarray:
    """The sensation expected along a plan.

    From target sensations alone the expectation is linear from one to the next, and as near to
    what is felt as a target sensation is to its own cell. With the sensations of the stored
    configurations it is three to five times nearer, in three steps: linear from what was felt at
    one waypoint to what was felt at the next; then, for each blend of two, the sensations most like
    it that were truly felt, as two half touches are not one touch halfway; then smoothed as the
    path is. Averages over stored configurations that are near in motor space are worse (0.03 to
    0.26), as neighbours in motor space lie far apart on the skin.

    Args:
        representation: the one that the plan was made with.
        plan: the plan.
        s: `(T,)` rad, path lengths in `[0, plan.waypoint_s[-1]]`.
        kernel_sensation: `(R, S)` unit L2 norm, what was felt at each row of `kernel_q`.

    Returns:
        `(T, S)` predicted sensation, unit L2 norm.
    """
    targets = representation.target_sensations[plan.nodes]
    if kernel_sensation is None:
        return _unit(_blend(plan.waypoint_s, targets, s))
    at_waypoints = np.stack(
        [
            _felt_at(representation, kernel_sensation, node, q)
            for node, q in zip(plan.nodes, plan.waypoints_q, strict=True)
        ]
    )
    length = plan.waypoint_s[-1]
    if length == 0.0:
        return np.repeat(at_waypoints[:1], len(s), axis=0)

    def truly_felt(u: np.ndarray) -> np.ndarray:
        blend = _unit(_blend(plan.waypoint_s, at_waypoints, u))
        return _most_alike(representation, kernel_sensation, plan, u, blend)

    num_intervals = len(plan.path.t) - 2 * DEGREE - 1
    expected = smooth_curve(truly_felt, at_waypoints[[0, -1]], length, num_intervals)
    return _unit(np.clip(expected(s), 0.0, None))


def _felt_at(
    representation: QuotientRepresentation, kernel_sensation: np.ndarray, node: int, q: np.ndarray
) -> np.ndarray:
    """`(S,)` what was felt at `q`; the target sensation if nothing is stored there."""
    members = representation.members(node)
    off = np.abs(representation.kernel_q[members] - q).max(axis=1)
    # Stored configurations are float32.
    if off.min() > 1e-5:
        return representation.target_sensations[node]
    return kernel_sensation[members][off.argmin()].astype(float)


def _most_alike(
    representation: QuotientRepresentation,
    kernel_sensation: np.ndarray,
    plan: Plan,
    s: np.ndarray,
    blend: np.ndarray,
) -> np.ndarray:
    """`(T, S)` mean of the sensations most like each of `blend`, in the kernels near that step.

    Near are the two kernels of the step and those that the graph joins to both.
    """
    joined = np.zeros((representation.num_targets,) * 2, dtype=bool)
    i, j = representation.edges.T
    joined[i, j] = joined[j, i] = True
    result = np.empty_like(blend)
    step = _step(plan.waypoint_s, s)
    for number in np.unique(step):
        a, b = plan.nodes[number : number + 2]
        near = {a, b, *np.flatnonzero(joined[a] & joined[b])}
        felt = np.concatenate([kernel_sensation[representation.members(k)] for k in near])
        rows = step == number
        count = min(_NUM_ALIKE, len(felt))
        likeness = blend[rows].astype(felt.dtype) @ felt.T
        alike = np.argpartition(-likeness, count - 1, axis=1)[:, :count]
        result[rows] = felt[alike].mean(axis=1)
    return _unit(result)


def _step(waypoint_s: np.ndarray, s: np.ndarray) -> np.ndarray:
    """`(T,)` between which waypoint and the next each `s` lies."""
    return np.searchsorted(waypoint_s, s, side="right").clip(1, max(len(waypoint_s) - 1, 1)) - 1


def _blend(waypoint_s: np.ndarray, sensation: np.ndarray, s: np.ndarray) -> np.ndarray:
    """`(T, S)` linear from the `(W, S)` sensation at one waypoint to that at the next."""
    before = _step(waypoint_s, s)
    after = np.minimum(before + 1, len(waypoint_s) - 1)
    step = waypoint_s[after] - waypoint_s[before]
    along = s - waypoint_s[before]
    share = np.divide(along, step, out=np.zeros(len(s)), where=step > 0.0)[:, None]
    return (1.0 - share) * sensation[before] + share * sensation[after]


def _unit(sensation: np.ndarray) -> np.ndarray:
    norm = np.linalg.norm(sensation, axis=1, keepdims=True)
    return np.divide(sensation, norm, out=np.zeros(sensation.shape), where=norm > 0.0)
