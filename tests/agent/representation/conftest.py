import sys
from pathlib import Path

import pytest

from selftouch_drake.agent.representation.estimator import QuotientLearner

sys.path.insert(0, str(Path(__file__).parents[2] / "quotient"))

from touched_sphere import touch_sphere


@pytest.fixture(scope="session")
def experience():
    q, sensation = touch_sphere(6000)
    return sensation, q


@pytest.fixture(scope="session")
def learner(experience):
    return QuotientLearner(num_targets=120, max_kernel_size=40, random_state=3).fit(*experience)


@pytest.fixture(scope="session")
def representation(learner):
    return learner.representation_
