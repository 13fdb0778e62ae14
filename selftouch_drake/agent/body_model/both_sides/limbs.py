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
    return {name: np.flatnonzero(best == at).tolist() for at, name in enumerate(names)}


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
