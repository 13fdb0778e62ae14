"""Touches of one sphere, for all tests of a life."""

import numpy as np
import pytest
from skins import touch

from selftouch_drake.agent.lifelong.expectation import TouchSet


@pytest.fixture(scope="package")
def touches():
    q, sensation, *_ = touch(["sphere"], 7500, num_receptors=40)
    order = np.random.default_rng(0).permutation(len(q))
    return TouchSet(q[order].astype(np.float32), sensation[order].astype(np.float32))


@pytest.fixture(scope="package")
def unbent():
    """Gives where joints read that act as if they were at `q`, `(n, J)`: a bent arm."""

    def readings(q):
        now = q.copy()
        for _ in range(30):
            bent = now + 0.2 * np.sin(1.5 * now[:, [1, 0, 2, 3, 4]][:, : now.shape[1]])
            now = now + q - bent
        return now.astype(np.float32)

    return readings
