"""Random walks in motor space."""

from __future__ import annotations

import numpy as np

from selftouch_drake.compiled import compiled


class RandomWalk:
    """A smooth random walk between joint limits.

    The velocity is a first-order autoregressive process, so successive configurations are close
    and the walk still reaches the whole range. It reflects at the limits: an unbounded walk is
    folded into the range of each joint, which is equivalent because its noise is symmetric.

    Args:
        lower: `(J,)` rad or m, lower limit of each joint.
        upper: `(J,)` rad or m, upper limit of each joint.
        step_size: rad or m per step, standard deviation of the joints' velocity; one for all or
            `(J,)`.
        persistence: share of the velocity that is kept from step to step, 0 to below 1.
        seed: of the walk; the start is uniform between the limits.
    """

    def __init__(
        self,
        *,
        lower: np.ndarray,
        upper: np.ndarray,
        step_size: float | np.ndarray,
        persistence: float,
        seed: np.random.SeedSequence,
    ):
        self._lower = np.asarray(lower, dtype=float)
        self._range = np.asarray(upper, dtype=float) - self._lower
        self._persistence = persistence
        self._innovation = step_size * np.sqrt(1 - persistence**2)
        self._random = np.random.default_rng(seed)
        self._unfolded = self._range * self._random.uniform(size=len(self._lower))
        self._velocity = step_size * self._random.standard_normal(len(self._lower))

    def steps(self, num_steps: int) -> np.ndarray:
        """`(num_steps, J)` the next configurations; the walk does not depend on the chunk size."""
        q = self._random.standard_normal((num_steps, len(self._lower)))
        q *= self._innovation
        _walk(q, self._persistence, self._velocity, self._unfolded, self._lower, self._range)
        return q


@compiled
def _walk(q, persistence, velocity, unfolded, lower, width):
    """Replaces each row of noise by the configuration that the walk then reaches."""
    for n in range(len(q)):
        for j in range(len(velocity)):
            velocity[j] = q[n, j] + persistence * velocity[j]
            unfolded[j] += velocity[j]
            folded = unfolded[j] % (2 * width[j])
            q[n, j] = lower[j] + min(folded, 2 * width[j] - folded)
