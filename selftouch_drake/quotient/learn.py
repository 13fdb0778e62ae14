"""Construction of the internal representation (paper, section III).

1. The agent stores the motor configurations M that led to non-null sensations S.
2. Vector quantisation of S gives target sensations and their Voronoi cells (`sensations`).
3. The configurations whose sensations share a cell are a motor kernel set: one point of M/=_Psi
   (`kernels`, `reservoir`). The joints get one unit (`scale`).
4. Distances between these sets (`distances`) give the edges of a graph (`graph`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from .batches import NO_ROWS, Batch, Batches, Map, checked, passed
from .distances import set_distances
from .graph import quotient_graph
from .kernels import KernelSets
from .representation import Representation
from .reservoir import Draw, KernelReservoir, KernelSample
from .scale import joint_scale
from .sensations import assign, strength, unlike
from .senses import MakeSenses, OnePlace, Senses
from .threads import thread_pool

#: Rows that target sensations are learned from: 40 per target for 1000 targets.
MAX_ROWS = 40_000

#: Called with the fraction done and what is being done.
Progress = Callable[[float, str], None]


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sorted:
    """The experience, sorted into motor kernel sets.

    Attributes:
        targets: `(K, P)` float32 target sensations, unit L2 norm, in the form that is compared.
        joint_scale: `(J,)` positive factors that make the joints comparable.
        sample: what is kept of each kernel; its columns are `q`, `(R, J)` float32, `strength`,
            `(R,)` N, and `error`, `(R,)` cosine distance to the target sensation.
        senses: what was found out about the sensations.
        total: as of `Senses.total`, of all touches.
        num_touches: rows of the experience.
        num_set_aside: touches that were set aside.
    """

    targets: np.ndarray
    joint_scale: np.ndarray
    sample: KernelSample
    senses: Senses
    total: np.ndarray | float
    num_touches: int
    num_set_aside: int

    @property
    def sets(self) -> KernelSets:
        """The motor kernel sets: scaled configurations, rad, float32."""
        x = (self.sample.columns["q"] * self.joint_scale).astype(np.float32)
        return KernelSets(x, self.sample.offsets(len(self.targets)))


def learn(
    q: np.ndarray,
    sensation: np.ndarray,
    *,
    num_targets: int = 500,
    max_kernel_size: int = 1000,
    seed: int = 0,
) -> Representation:
    """Learns from `(n, S)` N, no row null, felt at `(n, J)` q in the robot's units.

    As the paper does: one body, one kind of touch. The sizes are as of `Sizes`.

    Raises:
        ValueError: a size is invalid, or the experience cannot be learned from.

    Warns:
        DisconnectedWarning: as of `graph.connected_edges`.
    """
    sizes = Sizes(num_targets=num_targets, max_kernel_size=max_kernel_size, seed=seed)
    # Sums in another order, by another number of threads, would give other bytes.
    with threadpool_limits(limits=1, user_api="blas"):
        found = sorted_into_kernels(lambda: [(sensation, q)], sizes)
        distance = set_distances(found.sets, rough=unlike(found.targets))
        firmness = found.sample.columns["strength"]
        graph = quotient_graph(found.sets, firmness, distance, found.targets)
    return Representation(
        target_sensations=found.targets,
        kernel_offsets=found.sets.offsets,
        kernel_q=found.sample.columns["q"],
        kernel_row=found.sample.row,
        kernel_strength=firmness,
        kernel_error=found.sample.columns["error"],
        joint_scale=found.joint_scale,
        set_distance=distance,
        edges=graph.edges,
        edge_cost=graph.cost,
        num_touches=found.num_touches,
    )


def sorted_into_kernels(
    batches: Batches,
    sizes: Sizes,
    *,
    make_senses: MakeSenses = OnePlace,
    progress: Progress = lambda fraction, stage: None,
    each: Map = map,
) -> Sorted:
    """Sorts experience of any size into motor kernel sets, in bounded memory.

    Experience is read twice: for the target sensations, and for the kernel of each touch. The sizes
    of batches do not matter.

    Args:
        batches: called twice, returns the same experience each time.
        sizes: what is kept.
        make_senses: finds out how sensations are compared; by default, each is one touch.
        progress: called with the fraction of learning that is done, up to 0.3, and the stage.
        each: makes the calls that read; what they return does not depend on where.

    Raises:
        ValueError: the experience cannot be learned from, or the second reading has a different
            number of rows.
    """
    quantise_seed, sample_seed = sizes.seeds(2)
    some = KernelReservoir(1, MAX_ROWS, seed=quantise_seed)
    for taken, num_rows in passed(_fair_share, some, checked(batches()), each, check=True):
        some.keep(taken, num_rows)
        progress(0.0, "target sensations")
    columns = _enough(some, sizes.num_targets).columns
    senses = make_senses(columns["sensation"])
    targets, scale = _targets_and_scale(columns["q"], columns["sensation"], senses, sizes)

    kernels = KernelReservoir(sizes.num_targets, sizes.max_kernel_size, seed=sample_seed)
    num_set_aside, total = 0, 0.0
    for block in passed(partial(_sorted_block, targets, senses), kernels, batches(), each):
        kernels.keep(block.taken, block.num_rows)
        num_set_aside += block.num_set_aside
        total += block.total
        progress(min(0.2 + 0.1 * kernels.num_rows / some.num_rows, 0.3), "motor kernels")
    if kernels.num_rows != some.num_rows:
        raise ValueError(
            f"batches gave {some.num_rows} rows, then {kernels.num_rows}: give the same "
            "experience each time"
        )
    return Sorted(
        targets=targets,
        joint_scale=scale,
        sample=kernels.sample(),
        senses=senses,
        total=total,
        num_touches=some.num_rows,
        num_set_aside=num_set_aside,
    )


def _enough(some: KernelReservoir, num_targets: int) -> KernelSample:
    """What was kept of the first reading, if it holds a sensation for each target."""
    if not some.num_rows:
        raise ValueError(NO_ROWS)
    if some.num_rows < num_targets:
        raise ValueError(
            f"num_targets is {num_targets}, but there are only {some.num_rows} "
            "sensations: give a smaller number, or babble longer"
        )
    return some.sample()


def _targets_and_scale(
    q: np.ndarray, sensation: np.ndarray, senses: Senses, sizes: Sizes
) -> tuple[np.ndarray, np.ndarray]:
    """The target sensations, and the scale of the joints, of a sample of the experience."""
    row, felt, set_aside = senses.places(sensation)
    alone = np.unique(row[~set_aside])
    if not len(alone):
        raise ValueError(
            "sensation has touches on several parts of the body in every row: babble until "
            "each part is touched alone"
        )
    compared = senses.compared(felt[~set_aside])
    whole = senses.compared(senses.whole(sensation)[alone])
    with thread_pool(1) as beside:
        scaling = beside.submit(joint_scale, q[alone], whole)
        targets = senses.targets(compared, sizes.num_targets)
    return targets, scaling.result()


def _fair_share(draw: Draw, batch: Batch) -> tuple[dict[str, np.ndarray], int]:
    """Rows of a block that may be learned from, and the number of rows."""
    sensation, q = batch
    row = np.arange(len(q))
    return draw.take(np.zeros_like(row), row, sensation=sensation, q=q.astype(np.float32)), len(q)


class _Block(NamedTuple):
    """What a block of the experience adds to the kernels."""

    taken: dict[str, np.ndarray]
    num_rows: int
    num_set_aside: int
    total: np.ndarray | float


def _sorted_block(targets: np.ndarray, senses: Senses, draw: Draw, batch: Batch) -> _Block:
    """Sorts the touches of a block into kernels."""
    sensation, q = batch
    row, felt, set_aside = senses.places(sensation)
    label, error = assign(senses.compared(felt), targets)
    label[set_aside] = -1
    by_receptor = senses.by_receptor(sensation, row, felt)
    taken = draw.take(
        label,
        row,
        q=q[row].astype(np.float32),
        strength=strength(by_receptor).astype(np.float32),
        error=error,
    )
    total = senses.total(label, by_receptor, len(targets))
    return _Block(taken, len(q), int(set_aside.sum()), total)
