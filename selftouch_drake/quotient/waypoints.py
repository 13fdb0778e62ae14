"""Waypoints: one motor configuration of each kernel on a route (paper, section IV).

Each point of M/=_Psi on a route is a set of motor configurations. Which of them the agent passes
decides how far it moves.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise

import numba
import numpy as np
from numba import njit

from .distances import square_step


def smoothest_configurations(layers: Sequence[np.ndarray]) -> np.ndarray:
    """`(W, J)` mu, one configuration of each layer, with the least sum of cubed steps.

    Layered dynamic programming: exact up to float32 rounding, and quadratic in the size of a layer.
    With squares instead of cubes, a long step would remain now and then, and lose contact. Layers
    are `(n_w, J)` mu, scaled candidates along the route; a layer of one candidate is fixed.
    """
    candidates = [np.ascontiguousarray(layer, dtype=np.float32) for layer in layers]
    least_costs = _least_costs(candidates[0].shape[1])
    costs = [np.zeros(len(candidates[0]), dtype=np.float32)]
    for before, here in pairwise(candidates):
        costs.append(np.empty(len(here), dtype=np.float32))
        least_costs(before, costs[-2], np.ascontiguousarray(here.T), costs[-1])
    choice = [int(costs[-1].argmin())]
    for number in range(len(layers) - 1, 0, -1):
        x = candidates[number][choice[-1]]
        choice.append(int(_came_from(candidates[number - 1], costs[number - 1], x)))
    return np.stack([layer[c] for layer, c in zip(layers, reversed(choice), strict=True)])


@lru_cache
def _least_costs(num_joints: int) -> Callable[..., None]:
    """Compiles a step of the search; a fixed number of joints keeps all sums in registers."""

    def least_costs(before, cost_before, here, cost):
        """Writes the least cost to reach each of the `(J, n)` configurations here.

        Those are in the vector lanes, and four of the `(m, J)` before are compared at a time.
        """
        cost[:] = np.inf
        last = len(before) - 1
        for b0 in range(0, last + 1, 4):
            # A short tail repeats its last row, which changes no minimum.
            b1, b2, b3 = min(b0 + 1, last), min(b0 + 2, last), min(b0 + 3, last)
            x0, x1, x2, x3 = before[b0], before[b1], before[b2], before[b3]
            c0, c1, c2, c3 = cost_before[b0], cost_before[b1], cost_before[b2], cost_before[b3]
            for i in range(here.shape[1]):
                s0 = s1 = s2 = s3 = np.float32(0)
                for j in range(num_joints):
                    x = here[j, i]
                    d0, d1, d2, d3 = x - x0[j], x - x1[j], x - x2[j], x - x3[j]
                    s0 += d0 * d0
                    s1 += d1 * d1
                    s2 += d2 * d2
                    s3 += d3 * d3
                t0, t1 = s0 * np.sqrt(s0) + c0, s1 * np.sqrt(s1) + c1
                t2, t3 = s2 * np.sqrt(s2) + c2, s3 * np.sqrt(s3) + c3
                t0, t2 = t0 if t0 < t1 else t1, t2 if t2 < t3 else t3
                least = t0 if t0 < t2 else t2
                cost[i] = least if least < cost[i] else cost[i]

    # Each variant has cache files of its own; `distances._nearest_squared` says why.
    least_costs.__qualname__ += f"_{num_joints}"
    return numba.njit(cache=True, error_model="numpy")(least_costs)


@njit(cache=True)
def _came_from(before, cost_before, x):
    """The previous configuration, of `(m, J)`, from which x is reached at least cost."""
    best, least = 0, np.float32(np.inf)
    for row in range(len(before)):
        square = square_step(x, before[row])
        cost = square * np.sqrt(square) + cost_before[row]
        if cost < least:
            best, least = row, cost
    return best
