"""Lengths of steps in motor space, compiled for use in searches."""

from __future__ import annotations

import numpy as np
from numba import njit

# These are not cached: the functions that call them keep them.


@njit
def square_step(x, y):
    """The squared distance of two configurations `(J,)`."""
    total = np.float32(0.0)
    for joint in range(len(x)):
        step = x[joint] - y[joint]
        total += step * step
    return total


@njit
def least_square_step(x, candidates):
    """The first row of `(n, J)` candidates that is nearest to x, and its squared distance."""
    nearest, least = 0, np.float32(np.inf)
    for row in range(len(candidates)):
        square = square_step(x, candidates[row])
        if square < least:
            nearest, least = row, square
    return nearest, least
