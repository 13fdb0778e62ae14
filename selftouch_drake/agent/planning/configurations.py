"""Chooses one motor configuration in each kernel of a route."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numba import njit

from selftouch_drake.agent.planning.steps import square_steps


def smoothest_configurations(layers: Sequence[np.ndarray]) -> np.ndarray:
    """Chooses one configuration per layer, with the least sum of cubed steps.

    Layered dynamic programming: exact up to float32 rounding, and quadratic in the size of a layer.
    With squares instead of cubes, a long step would remain now and then, and lose contact.

    Args:
        layers: W arrays `(n_w, J)` rad, the scaled candidates of each kernel along the route; a
            layer of one candidate is fixed.

    Returns:
        `(W, J)` rad, the chosen configurations.
    """
    joints_first = [np.ascontiguousarray(layer.T, dtype=np.float32) for layer in layers]
    cost = np.zeros(len(layers[0]), dtype=np.float32)
    came_from = []
    for before, here in pairwise(joints_first):
        cost, parent = _step(before, cost, here)
        came_from.append(parent)
    choice = [int(cost.argmin())]
    for previous in reversed(came_from):
        choice.append(int(previous[choice[-1]]))
    return np.stack([layer[c] for layer, c in zip(layers, reversed(choice), strict=True)])


@njit(cache=True)
def _step(before, cost_before, here):
    """`(n,)` the least cost to reach each of the `(J, n)` configurations here, and its parent."""
    count = here.shape[1]
    cost, parent = np.empty(count, dtype=np.float32), np.empty(count, dtype=np.int64)
    through = np.empty(len(cost_before), dtype=np.float32)
    for i in range(count):
        square_steps(before, here[:, i], through)
        for b in range(len(through)):
            through[b] = through[b] * np.sqrt(through[b]) + cost_before[b]
        parent[i] = np.argmin(through)
        cost[i] = through[parent[i]]
    return cost, parent


def closest_configurations(layers: Sequence[np.ndarray]) -> np.ndarray:
    """Chooses in each layer the configuration closest to the previous one: the paper's method.

    Args:
        layers: W arrays `(n_w, J)` rad, scaled, the first of one configuration.

    Returns:
        `(W, J)` rad, the chosen configurations.
    """
    chosen = [layers[0][0]]
    for layer in layers[1:]:
        chosen.append(layer[np.square(layer - chosen[-1]).sum(axis=1).argmin()])
    return np.stack(chosen)
