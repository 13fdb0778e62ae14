"""Construction of the internal representation (paper, section III).

1. The agent stores the motor configurations M that led to non-null sensations S (`checks`).
2. Vector quantisation of S gives target sensations and their Voronoi cells (`sensations`).
3. The configurations whose sensations share a cell are a motor kernel set: one point of M/=_Psi
   (`kernels`). The joints get one unit (`scale`).
4. Distances between these sets (`distances`) give the edges of a graph (`graph`).
"""

from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from .checks import checked_experience, require_rows
from .distances import set_distances
from .graph import combined_distance, quotient_graph
from .kernels import KernelSets, sample_rows
from .representation import Representation
from .scale import joint_scale
from .sensations import assign, strength, target_sensations, unlike

#: Rows that target sensations are learned from: 40 per target for 1000 targets. More take time.
MAX_ROWS = 40_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Sizes:
    """How much a learner keeps.

    Attributes:
        num_targets: K, number of target sensations.
        max_kernel_size: most motor configurations kept per kernel.
        seed: the same seed and experience give the same bytes.

    Raises:
        ValueError: a number is not whole, or too small.
    """

    num_targets: int = 500
    max_kernel_size: int = 1000
    seed: int = 0

    def __post_init__(self) -> None:
        for name, least in (("num_targets", 2), ("max_kernel_size", 1), ("seed", 0)):
            number = getattr(self, name)
            whole = isinstance(number, int | np.integer) and not isinstance(number, bool)
            if not whole or number < least:
                raise ValueError(f"{name} is {number!r}: give a whole number, {least} or more")

    def seeds(self, count: int) -> list[int]:
        """Seeds for so many purposes; more of them do not change the first ones."""
        return [int(one) for one in np.random.SeedSequence(self.seed).generate_state(count)]


def learn(
    q: np.ndarray,
    sensation: np.ndarray,
    *,
    num_targets: int = 500,
    max_kernel_size: int = 1000,
    seed: int = 0,
) -> Representation:
    """Learns from `(n, S)` N, no row null, felt at `(n, J)` q in the robot's units.

    As the paper does: one body, one kind of touch. The sizes are as in `Sizes`.

    Raises:
        ValueError: a size is invalid, or the experience cannot be learned from.

    Warns:
        DisconnectedWarning: as in `graph.connected_edges`.
    """
    sizes = Sizes(num_targets=num_targets, max_kernel_size=max_kernel_size, seed=seed)
    sensation, q = checked_experience(sensation, q)
    require_rows(len(q), num_targets)
    # Sums in another order, by another number of threads, would give other bytes.
    with threadpool_limits(limits=1, user_api="blas"):
        return _learned(q.astype(np.float32), sensation, sizes)


def _learned(q: np.ndarray, sensation: np.ndarray, sizes: Sizes) -> Representation:
    """As `learn`, from experience that was checked."""
    quantise_seed, sample_seed = sizes.seeds(2)
    some = sample_rows(np.zeros(len(q), dtype=int), MAX_ROWS, seed=quantise_seed)
    targets = target_sensations(sensation[some], sizes.num_targets)
    scale = joint_scale(q[some], sensation[some])

    label, error = assign(sensation, targets)
    row = sample_rows(label, sizes.max_kernel_size, seed=sample_seed)
    counts = np.bincount(label[row], minlength=len(targets))
    sets = KernelSets((q[row] * scale).astype(np.float32), np.cumsum([0, *counts]))
    kernel_strength = strength(sensation[row]).astype(np.float32)

    distance = set_distances(sets, rough=unlike(targets))
    graph = quotient_graph(sets, kernel_strength, combined_distance(distance, targets))
    return Representation(
        target_sensations=targets,
        kernel_offsets=sets.offsets,
        kernel_q=q[row],
        kernel_row=row,
        kernel_strength=kernel_strength,
        kernel_error=error[row],
        joint_scale=scale,
        set_distance=distance,
        edges=graph.edges,
        edge_cost=graph.cost,
        num_touches=len(q),
    )
