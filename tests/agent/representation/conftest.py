import numpy as np
import pytest

from selftouch_drake.agent.representation.estimator import QuotientLearner


def touch_sphere(num_rows: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Sensations of 30 receptors on a unit sphere, and 5 joints; 2 have no effect."""
    rng = np.random.default_rng(seed)
    touched, receptors = (rng.normal(size=(n, 3)) for n in (num_rows, 30))
    touched /= np.linalg.norm(touched, axis=1, keepdims=True)
    receptors /= np.linalg.norm(receptors, axis=1, keepdims=True)
    field = np.clip(touched @ receptors.T, 0.0, None) ** 3
    sensation = field * rng.uniform(0.1, 1.0, (num_rows, 1))
    q = np.hstack([touched, rng.uniform(-0.3, 0.3, (num_rows, 2))])
    return sensation.astype(np.float32), q.astype(np.float32)


@pytest.fixture(scope="session")
def experience():
    return touch_sphere(6000)


@pytest.fixture(scope="session")
def learner(experience):
    return QuotientLearner(num_targets=120, max_kernel_size=40, random_state=3).fit(*experience)


@pytest.fixture(scope="session")
def representation(learner):
    return learner.representation_
