"""Layouts have no pose and no scale: one is laid on another to compare them (naive)."""

import numpy as np
from scipy.linalg import orthogonal_procrustes


def align(source: np.ndarray, target: np.ndarray, points: np.ndarray | None = None) -> np.ndarray:
    """Moves, turns, mirrors and scales `(K, d)` `source` onto `(K, D)` `target` (Procrustes).

    If d is less than D, missing coordinates are 0. Returns `source` as it is moved, `(K, D)`, or
    `(N, d)` other points that are moved in the same way.
    """
    missing = ((0, 0), (0, target.shape[1] - source.shape[1]))
    moved = np.pad(source if points is None else points, missing)
    source = np.pad(source, missing)
    middle = source.mean(axis=0)
    centred = source - middle
    goal = target - target.mean(axis=0)
    rotation, singular_sum = orthogonal_procrustes(centred, goal)
    scale = singular_sum / np.square(centred).sum()
    return scale * (moved - middle) @ rotation + target.mean(axis=0)
