"""Which joints each limb has, told from touches before any body is known.

A joint between the two ends of a recording changes what both feel; any other joint is noise. So
what a recording's skins felt is predicted from all joints but one, each posture from all others.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from selftouch_drake.agent.body_model.both_sides.grain import Skin
from selftouch_drake.agent.body_model.both_sides.problem import shares
from selftouch_drake.agent.body_model.both_sides.recordings import Recording, same_posture

# Touches within so many rad are one posture.
_ONE_POSTURE = 0.05
# Ridges that are tried, for standardised joints, and how much less products of two of them count.
_RIDGES, _PRODUCTS = (1.0, 3.0, 10.0, 30.0, 100.0), 0.5


def relevance(skins: Mapping[str, Skin], recordings: Sequence[Recording]) -> np.ndarray:
    """`(J, R)` by how much of the variance a recording's sensations are predicted worse without it.

    Args:
        skins: what touches say of each skin.
        recordings: of one body.
    """
    return np.array([_of_recording(skins, one) for one in recordings]).T


def limbs_of(
    matters: np.ndarray, recordings: Sequence[Recording], holder: Mapping[str, str]
) -> dict[str, list[int]]:
    """Joints of each limb, sorted: a joint belongs where it explains most and leaves out least.

    Two limbs that carry the same kinds of ends, and no third does, get the same number of joints.

    Args:
        matters: `(J, R)` relevance of each joint to each recording.
        recordings: of one body.
        holder: the limb at whose end a skin or a point is; an empty name for the trunk.
    """
    names = [name for name in dict.fromkeys(holder.values()) if name]
    takes_part = np.array(
        [[name in (holder[one.above], holder[one.below]) for one in recordings] for name in names]
    )
    score = matters @ np.where(takes_part, 1, -1).T
    best = score.argmax(axis=1)
    kinds = ends_of_limbs(recordings, holder)
    for kind in set(kinds.values()):
        alike = [at for at, name in enumerate(names) if kinds[name] == kind]
        if len(alike) == 2:
            best = _as_many(score, best, alike)
    return {name: np.flatnonzero(best == at).tolist() for at, name in enumerate(names)}


def ends_of_limbs(
    recordings: Sequence[Recording], holder: Mapping[str, str]
) -> dict[str, tuple[int, int]]:
    """Numbers of skins and of points that each limb carries."""
    skins = {
        end for one in recordings for end in (one.above, one.below) if one.felt(end) is not None
    }
    return {
        limb: (
            sum(own == limb and end in skins for end, own in holder.items()),
            sum(own == limb and end not in skins for end, own in holder.items()),
        )
        for limb in dict.fromkeys(holder.values())
        if limb
    }


def _as_many(score: np.ndarray, best: np.ndarray, alike: Sequence[int]) -> np.ndarray:
    """`(J,)` limb of each joint, moved at the least cost until both have the same number.

    Ends with one joint more in one of them where no single move would help.
    """
    best = best.copy()
    while True:
        counts = [int((best == limb).sum()) for limb in alike]
        more, fewer = alike if counts[0] > counts[1] else alike[::-1]
        short = abs(counts[0] - counts[1])
        moves = [
            (score[joint, here] - score[joint, there], joint, there)
            for joint, here in enumerate(best)
            for there in range(score.shape[1])
            if there != here
            and there != more
            and (here == more or there == fewer)
            and (there == fewer) + (here == more) <= short
        ]
        if not short or not moves:
            return best
        _, joint, there = min(moves)
        best[joint] = there


def _of_recording(skins: Mapping[str, Skin], one: Recording) -> np.ndarray:
    rows, above, below = shares(skins, one)
    label = same_posture(one.q[rows], _ONE_POSTURE)
    number = np.bincount(label)
    mean = np.zeros((len(number), len(label)))
    mean[label, np.arange(len(label))] = 1 / number[label]
    q, felt = mean @ one.q[rows], mean @ np.column_stack([above[:, 1:], below[:, 1:]])
    q = (q - q.mean(axis=0)) / np.maximum(q.std(axis=0), 1e-9)
    felt = felt - felt.mean(axis=0)
    joints = np.arange(q.shape[1])
    every = _left_out_error(q, felt)
    without = np.array([_left_out_error(q[:, joints != joint], felt) for joint in joints])
    return (without - every) / (felt**2).sum()


def _left_out_error(q: np.ndarray, felt: np.ndarray) -> float:
    """Squared error of each posture, predicted from all others by its joints and their products."""
    first, second = np.triu_indices(q.shape[1])
    design = np.column_stack([np.ones(len(q)), q, _PRODUCTS * q[:, first] * q[:, second]])
    damped = np.eye(design.shape[1])
    damped[0, 0] = 1e-9
    best = np.inf
    for ridge in _RIDGES:
        hat = design @ np.linalg.solve(design.T @ design + ridge * damped, design.T)
        error = (felt - hat @ felt) / np.maximum(1 - np.diag(hat), 1e-3)[:, None]
        best = min(best, float((error**2).sum()))
    return best
