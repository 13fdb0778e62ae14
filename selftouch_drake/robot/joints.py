"""What the agent believes of its joints, where that is not what is."""

from __future__ import annotations

import numpy as np

from selftouch_drake.experiment import Experiment
from selftouch_drake.robot.imperfections import standard_noise


def remembered(experiment: Experiment, q: np.ndarray) -> np.ndarray:
    """`(N, J)`, what the agent keeps of the configurations `q` `(N, J)` of its babbling."""
    if not experiment.joints.noise:
        return q
    (seed,) = experiment.random_stream("joints", 1).generate_state(1, np.uint64)
    error = standard_noise(q, q.shape[1], seed=int(seed))
    return (q + experiment.joints.noise * error).astype(q.dtype)


def slip(experiment: Experiment, num_joints: int) -> np.ndarray:
    """`(J,)` rad or m, by how much joints read more than they are, after babbling."""
    chance = np.random.default_rng(experiment.random_stream("joints", 0))
    return experiment.joints.offset * chance.standard_normal(num_joints)
