"""Points chosen one by one, each as far as possible from all earlier ones."""

from collections.abc import Callable

import numpy as np


def farthest_points(
    distance_from: Callable[[int], np.ndarray],
    num_points: int,
    *,
    first: int = 0,
    weight: np.ndarray | None = None,
    least: float = 0.0,
) -> np.ndarray:
    """Picks points one by one, each as far as possible from all earlier ones.

    Works in any space: `distance_from` defines the distance, and may return its square. Returns
    the indices in order.

    Args:
        distance_from: Called with the index of a point; returns `(n,)` its distances to all
            points. It may overestimate distances larger than the one to the nearest point picked
            before, so a search may stop early.
        num_points: Number of points to pick; fewer are returned if there are fewer.
        first: Index of the first point.
        weight: `(n,)` positive factors; where they are small, points are picked farther apart.
        least: Stops when the next point is nearer than this to a point picked before.
    """
    picked = [int(first)]
    nearest = np.array(distance_from(picked[0]))
    while len(picked) < min(num_points, len(nearest)):
        farthest = int((nearest if weight is None else weight * nearest).argmax())
        if nearest[farthest] < least:
            break
        picked.append(farthest)
        np.minimum(nearest, distance_from(farthest), out=nearest)
    return np.array(picked)
