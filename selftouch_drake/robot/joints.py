"""Joint errors: readings of joints that differ from the truth."""

from __future__ import annotations

import numpy as np

from selftouch_drake.experiment import Experiment
from selftouch_drake.robot.imperfections import standard_noise


def remembered(experiment: Experiment, q: np.ndarray) -> np.ndarray:
    """`(N, J)` configurations as the agent remembers them, for true ones `q` `(N, J)`."""
    if not experiment.joints.noise:
        return q
    (seed,) = experiment.random_stream("joints", 1).generate_state(1, np.uint64)
    error = standard_noise(q, q.shape[1], seed=int(seed))
    return (q + experiment.joints.noise * error).astype(q.dtype)


def slip(experiment: Experiment, num_joints: int) -> np.ndarray:
    """`(J,)` rad or m, by how much joint readings exceed the true positions after babbling."""
    chance = np.random.default_rng(experiment.random_stream("joints", 0))
    return experiment.joints.offset * chance.standard_normal(num_joints)
