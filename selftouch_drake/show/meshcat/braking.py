"""Brings an interrupted motion to rest."""

from __future__ import annotations

import numpy as np

from selftouch_drake.agent.motions import Motion
from selftouch_drake.robot.limits import commanded

# s, from full speed to rest: at 1 rad/s that is 2.5 rad/s², half of what plans may use.
BRAKING_S = 0.4
# s, between two samples.
_STEP_S = 0.01


def braked(motion: Motion, time_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The rest of a motion, slowed down to a stop on its own path and so on the skin.

    Args:
        motion: T instants.
        time_s: s, when it is interrupted.

    Returns:
        `(N,)` s from 0, `(N, J)` configurations and `(N, J)` their velocities.
    """
    since = np.linspace(0.0, BRAKING_S, round(BRAKING_S / _STEP_S) + 1)
    # The motion's own time, which goes on ever more slowly.
    at = (time_s + since - since**2 / (2 * BRAKING_S)).clip(0.0, motion.time_s[-1])
    path = commanded(motion.time_s, motion.q, motion.v)
    return since, path(at), path(at, 1) * (1.0 - since / BRAKING_S)[:, None]
