"""The dimension of the recovered body: how fast its kernels are met when going out from one."""

from __future__ import annotations

import numpy as np

#: Radii between which growth is measured, as shares of the kernels met: below, balls hold a few
#: kernels and count their grid; above, they have met the far side of the body.
_SHARES = (0.02, 0.15)


def intrinsic_dimension(distances: np.ndarray) -> float:
    """Correlation dimension: the slope of log(kernels met) over log(distance gone).

    Kernels are spread evenly, so that estimators from the first neighbours (TwoNN, maximum
    likelihood), which assume a random spread, do not apply. A ball of radius r round a kernel
    holds c r^d kernels, its own counted for half a cell of each.

    Args:
        distances: `(K, K)` along the body, symmetric, finite.

    Returns:
        The dimension, 2 for a surface; lower by up to 0.2 where the body bends back on itself.

    Raises:
        ValueError: there are fewer than 50 kernels.
    """
    num_kernels = len(distances)
    if num_kernels < 50:
        raise ValueError(f"num_targets={num_kernels}: dimension needs at least 50 kernels.")
    pairs = np.sort(distances[~np.eye(num_kernels, dtype=bool)])
    share = np.geomspace(*_SHARES, 20)
    radius = pairs[(share * len(pairs)).astype(int)]
    return float(np.polyfit(np.log(radius), np.log(share), 1)[0])
