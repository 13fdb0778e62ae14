"""Learns where the joints would have to be for an agent to expect what it feels (naive)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from selftouch_drake.agent.network import Network, train

#: Number of networks learned through each series; the mean of all counts. Six networks through one
#: expectation leave 9.3 to 21 % of the touches of before off the skin (three changes, 1000 touches
#: since); three through each of two leave 7.8 to 20 %.
_NETWORKS = 3

#: Hidden units of such a network and training steps, for 1000 touches; both grow with the square
#: root of the number of touches. Touches per training step. On a cube that was stretched, with 5000
#: touches since, 81 % of the touches of before touch with 32 units and 500 steps, and 82 % with
#: twice as many of both.
_HIDDEN, _NUM_STEPS, _BATCH = 32, 500, 512

#: Weight of the squared displacement, in standard deviations, beside the squared error of what is
#: expected, for 1000 touches; it falls with the square root of their number. Without it, joints
#: without effect on a touch go astray, and the touch is forgotten because no joint ever was there.
#: Of 3000 touches from before, 1510 are kept and touch with 0, and 1681 with 0.3 (an active life on
#: a cube, 1000 touches since); 1741 with 0, and 1854 with 0.1 (a cube, 4000); 1984 and 2018 (a
#: sphere, 4000).
_PENALTY = 0.2


def displacement(
    through: Sequence[Sequence[Network]],
    x: np.ndarray,
    start: np.ndarray,
    wanted: np.ndarray,
    counts: np.ndarray,
    *,
    seed: int,
) -> tuple[Network, ...]:
    """Learns what to add to `start`, depending on `x`, so that what is wanted is expected there.

    A blunt network shows from farther away where to go, a sharp one where exactly. So the
    displacement is learned through one after the other.

    Args:
        through: series of networks of what is expected, each from blunt to sharp, which do not
            change; their inputs are standardised configurations.
        x: `(n, J)` float32, standardised configurations.
        start: `(n, J)` float32, standardised configurations to which the displacement is added.
        wanted: `(n, S + 1)` float32, what was felt, as the networks give it.
        counts: `(S + 1,)` float32, 1 where a reading counts and 0 elsewhere.
        seed: for the training.

    Returns:
        Networks from `x` to the displacement; their mean counts.
    """
    rng = np.random.default_rng(seed)
    num_joints, growth = x.shape[1], math.sqrt(len(x) / 1000)
    rows = np.empty(0, dtype=int)

    def batch() -> np.ndarray:
        nonlocal rows
        rows = rng.integers(len(x), size=_BATCH)
        return x[rows]

    def trained(series: Sequence[Network]) -> Network:
        network = Network.random([num_joints, round(_HIDDEN * growth), num_joints], rng)
        network.weights[-1][:] = 0.0
        for expected in series:

            def slope(displaced: np.ndarray, expected: Network = expected) -> np.ndarray:
                outputs, _, slopes = expected.forward(start[rows] + displaced)
                off = 2.0 * counts * (outputs - wanted[rows]) / len(rows)
                pull = 2.0 * _PENALTY / growth / len(rows) * displaced
                return expected.slope_of_inputs(off, slopes) + pull

            train(network, batch, slope, round(_NUM_STEPS * growth))
        return network

    return tuple(trained(series) for series in through for _ in range(_NETWORKS))
