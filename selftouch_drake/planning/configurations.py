"""Which motor configuration to take in each kernel set of a route."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.spatial.distance import cdist


def smoothest_configurations(layers: Sequence[np.ndarray]) -> np.ndarray:
    """One configuration a layer, with the least sum of cubed steps.

    Layered dynamic programming: exact, and quadratic in the size of a layer. Squares would let one
    long step pass here and there, and lose contact on it.

    Args:
        layers: W arrays `(n_w, J)` rad, the candidates of each kernel along the route; a layer of
            one candidate is fixed.

    Returns:
        `(W, J)` rad, the chosen configurations.
    """
    cost = np.zeros(len(layers[0]))
    came_from = []
    for before, here in pairwise(layers):
        squared = cdist(here, before, "sqeuclidean")
        through = squared * np.sqrt(squared) + cost
        came_from.append(through.argmin(axis=1))
        cost = through.min(axis=1)
    choice = [int(cost.argmin())]
    for previous in reversed(came_from):
        choice.append(int(previous[choice[-1]]))
    return np.stack([layer[c] for layer, c in zip(layers, reversed(choice), strict=True)])


def closest_configurations(layers: Sequence[np.ndarray]) -> np.ndarray:
    """One configuration a layer, each the closest to the one before: the paper's literal method.

    Args:
        layers: W arrays `(n_w, J)` rad, the first of one configuration.

    Returns:
        `(W, J)` rad, the chosen configurations.
    """
    chosen = [layers[0][0]]
    for layer in layers[1:]:
        chosen.append(layer[np.square(layer - chosen[-1]).sum(axis=1).argmin()])
    return np.stack(chosen)
