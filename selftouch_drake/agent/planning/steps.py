"""Lengths of steps in motor space, compiled for use in searches."""

from __future__ import annotations

from numba import njit


# Not cached: its callers keep it.
@njit
def square_steps(candidates, x, squared):
    """Writes the squared distance of each column of `(J, n)` candidates to x into `squared[:n]`."""
    count = candidates.shape[1]
    squared[:count] = 0.0
    for joint in range(len(x)):  # joint by joint, so that the inner loop vectorises
        at = x[joint]
        for i in range(count):
            step = candidates[joint, i] - at
            squared[i] += step * step
