"""The dimension of a part of the body: how fast its kernels are met when going out from one."""

from __future__ import annotations

import numpy as np

#: Growth is measured between the balls that hold these shares of all kernels: from a few neighbours
#: to where the body bends away. Measured on spheres, cubes and tori of 300 and 1000 kernels: 2.0 to
#: 2.3 by either naive metric; a start at 2 %, inside the second ring, gives 1.6 to 2.2.
_SHARES = (0.01, 0.1)

#: Neighbours in the smallest ball, if the share of a small body would be fewer.
_LEAST_NEIGHBOURS = 3

#: Kernels that growth can be measured on.
LEAST_KERNELS = 50


def intrinsic_dimension(distances: np.ndarray) -> float:
    """Correlation dimension: the slope of log(kernels met) over log(distance gone).

    Kernels are spread evenly, so that estimators from the first neighbours (TwoNN, maximum
    likelihood), which assume a random spread, do not apply. On average a ball of radius r round a
    kernel holds c r^d others.

    Args:
        distances: `(K, K)` along the body, symmetric, finite.

    Returns:
        The dimension; 1.8 to 2.4 for a surface.

    Raises:
        ValueError: there are fewer than 50 kernels.
    """
    num_kernels = len(distances)
    if num_kernels < LEAST_KERNELS:
        raise ValueError(
            f"num_targets={num_kernels}: dimension needs at least {LEAST_KERNELS} kernels."
        )
    pairs = np.sort(distances[~np.eye(num_kernels, dtype=bool)])
    smallest, largest = _SHARES
    share = np.geomspace(max(smallest, _LEAST_NEIGHBOURS / num_kernels), largest, 20)
    radius = pairs[(share * len(pairs)).astype(int)]
    return float(np.polyfit(np.log(radius), np.log(share), 1)[0])
