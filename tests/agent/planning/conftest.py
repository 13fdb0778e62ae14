import numpy as np
import pytest

from selftouch_drake.agent.representation.quotient import QuotientRepresentation


def ring_representation(num_kernels=24, members=6, *, links=None, seed=0):
    """Kernels on a circle of radius 1 rad in the first two of three joints."""
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * np.arange(num_kernels) / num_kernels
    centre = np.stack([np.cos(angle), np.sin(angle), np.zeros(num_kernels)], axis=1)
    kernel_q = np.repeat(centre, members, axis=0)
    kernel_q = kernel_q + 0.03 * rng.normal(size=kernel_q.shape)
    sensor = 2 * np.pi * np.arange(12) / 12
    targets = np.exp(2.0 * np.cos(angle[:, None] - sensor))
    targets /= np.linalg.norm(targets, axis=1, keepdims=True)
    if links is None:
        links = [(k, (k + 1) % num_kernels) for k in range(num_kernels)]
    edges = np.array(sorted((min(e), max(e)) for e in links), dtype=int).reshape(-1, 2)
    difference = centre[:, None] - centre
    distance = np.linalg.norm(difference, axis=2)
    return QuotientRepresentation(
        target_sensations=targets,
        kernel_offsets=members * np.arange(num_kernels + 1),
        kernel_q=kernel_q,
        kernel_row=np.arange(len(kernel_q)),
        kernel_strength=rng.uniform(1.0, 2.0, len(kernel_q)),
        kernel_error=rng.uniform(0.0, 0.1, len(kernel_q)),
        kernel_mode=np.zeros(len(kernel_q), dtype=int),
        mode_joints=np.ones((1, 3), dtype=bool),
        joint_scale=np.ones(3),
        overlap=np.ones((12, 12), dtype=bool),
        part=np.zeros(num_kernels, dtype=int),
        num_touches=len(kernel_q),
        set_distance=distance,
        edges=edges,
        edge_cost=distance[edges[:, 0], edges[:, 1]],
        embedding=centre,
    )


@pytest.fixture(scope="session")
def ring():
    return ring_representation()


@pytest.fixture(scope="session")
def make_ring():
    return ring_representation
