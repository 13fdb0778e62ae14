"""Representations that tests lay by hand."""

import numpy as np

from selftouch_drake.agent.representation.quotient import QuotientRepresentation


def laid_by_hand(configurations, edges, targets=None):
    """A representation whose kernels hold the given one-joint configurations, all firm."""
    sizes = [len(c) for c in configurations]
    kernel_q = np.concatenate(configurations)[:, None].astype(float)
    num_kernels, num_rows = len(sizes), len(kernel_q)
    edges = np.array(edges, dtype=int)
    return QuotientRepresentation(
        target_sensations=np.eye(num_kernels) if targets is None else targets,
        kernel_offsets=np.cumsum([0, *sizes]),
        kernel_q=kernel_q,
        kernel_row=np.arange(num_rows),
        kernel_strength=np.ones(num_rows),
        kernel_error=np.zeros(num_rows),
        kernel_mode=np.zeros(num_rows, dtype=int),
        mode_joints=np.ones((1, 1), dtype=bool),
        joint_scale=np.ones(1),
        overlap=np.ones((num_kernels, num_kernels), dtype=bool),
        part=np.zeros(num_kernels, dtype=int),
        num_touches=num_rows,
        set_distance=np.zeros((num_kernels, num_kernels)),
        edges=edges,
        edge_cost=np.ones(len(edges)),
        embedding=np.zeros((num_kernels, 3)),
    )
