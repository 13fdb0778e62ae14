"""The dimension of a part of the body: how fast the number of kernels grows with distance."""

from __future__ import annotations

import numpy as np

#: Growth is measured between the balls that hold these shares of all kernels: from a few neighbours
#: to where the body curves away. Measured on spheres, cubes and tori of 300 and 1000 kernels: 2.0
#: to 2.3 with either naive metric; starting at 2 %, inside the second ring, gives 1.6 to 2.2.
_SHARES = (0.01, 0.1)

#: Fewest neighbours in the smallest ball; the first share of a small body would hold fewer.
_LEAST_NEIGHBOURS = 3

#: The largest ball holds at least so many times as many kernels. Below 150 kernels, a tenth of them
#: would not: between less than a ring of neighbours and a ring, surfaces had 2 to 5 dimensions.
_LEAST_GROWTH = 5

#: Fewest kernels on which growth can be measured.
LEAST_KERNELS = 50


def intrinsic_dimension(distances: np.ndarray) -> float:
    """Correlation dimension: the slope of log(number of kernels) against log(distance).

    Kernels are evenly spaced, so estimators that use nearest neighbours (TwoNN, maximum
    likelihood) do not apply: they assume random positions. On average a ball of radius r around a
    kernel holds c r^d others.

    Args:
        distances: `(K, K)` geodesic distances, symmetric, finite.

    Returns:
        The dimension; 1.8 to 2.4 for a surface.

    Raises:
        ValueError: there are fewer than 50 kernels.
    """
    num_kernels = len(distances)
    if num_kernels < LEAST_KERNELS:
        raise ValueError(
            f"num_targets is {num_kernels}: give at least {LEAST_KERNELS}, to estimate a dimension"
        )
    pairs = np.sort(distances[~np.eye(num_kernels, dtype=bool)])
    smallest = max(_SHARES[0], _LEAST_NEIGHBOURS / num_kernels)
    share = np.geomspace(smallest, max(_SHARES[1], _LEAST_GROWTH * smallest), 20)
    radius = pairs[(share * len(pairs)).astype(int)]
    return float(np.polyfit(np.log(radius), np.log(share), 1)[0])
