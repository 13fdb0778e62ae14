"""Experience of a sphere, without a world: for tests of the paper's own part and of the agent's."""

import numpy as np


def touch_sphere(num_rows: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """5 joints, of which 2 have no effect, and sensations of 30 receptors on a unit sphere."""
    rng = np.random.default_rng(seed)
    touched, receptors = (rng.normal(size=(n, 3)) for n in (num_rows, 30))
    touched /= np.linalg.norm(touched, axis=1, keepdims=True)
    receptors /= np.linalg.norm(receptors, axis=1, keepdims=True)
    field = np.clip(touched @ receptors.T, 0.0, None) ** 3
    sensation = field * rng.uniform(0.1, 1.0, (num_rows, 1))
    q = np.hstack([touched, rng.uniform(-0.3, 0.3, (num_rows, 2))])
    return q.astype(np.float32), sensation.astype(np.float32)
