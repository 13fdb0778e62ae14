"""Sorts experience of any size into motor kernel sets, of bodies touched at several places.

It does what `quotient.learn` does with arrays, and of one body, one place at a time, gives the same
bytes.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from selftouch_drake.agent.representation.batches import Batch, Batches, Map, checked, passed
from selftouch_drake.agent.representation.reservoir import Draw, KernelReservoir, KernelSample
from selftouch_drake.agent.representation.several_places import SeveralPlaces
from selftouch_drake.quotient.checks import require_rows
from selftouch_drake.quotient.kernels import KernelSets
from selftouch_drake.quotient.learn import MAX_ROWS, Sizes
from selftouch_drake.quotient.scale import joint_scale
from selftouch_drake.quotient.sensations import assign, strength
from selftouch_drake.quotient.threads import thread_pool

#: Called with the fraction done and what is being done.
Progress = Callable[[float, str], None]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SortedExperience:
    """The experience, sorted into motor kernel sets.

    Attributes:
        targets: `(K, P)` float32 target sensations, unit L2 norm, in the form that is compared.
        joint_scale: `(J,)` positive factors that make the joints comparable.
        sample: what is kept of each kernel; its columns are `q`, `(R, J)` float32, `strength`,
            `(R,)` N, and `error`, `(R,)` cosine distance to the target sensation.
        senses: how sensations are taken apart.
        total: as in `SeveralPlaces.total`, of all touches.
        num_touches: rows of the experience.
        num_set_aside: touches that were set aside.
    """

    targets: np.ndarray
    joint_scale: np.ndarray
    sample: KernelSample
    senses: SeveralPlaces
    total: np.ndarray | float
    num_touches: int
    num_set_aside: int

    @property
    def sets(self) -> KernelSets:
        """The motor kernel sets: scaled configurations, mu, float32."""
        x = (self.sample.columns["q"] * self.joint_scale).astype(np.float32)
        return KernelSets(x, self.sample.offsets(len(self.targets)))


def sorted_into_kernels(
    batches: Batches,
    sizes: Sizes,
    *,
    progress: Progress = lambda fraction, stage: None,
    each: Map = map,
) -> SortedExperience:
    """Sorts experience of any size into motor kernel sets, in bounded memory.

    Experience is read twice: for the target sensations, and for the kernel of each touch. The sizes
    of batches do not matter.

    Args:
        batches: called twice, returns the same experience each time.
        sizes: what is kept.
        progress: called with the fraction of learning that is done, up to 0.3, and the stage.
        each: makes the calls that read; what they return does not depend on where.

    Raises:
        ValueError: the experience cannot be learned from, or the second reading has a different
            number of rows.
    """
    quantise_seed, sample_seed = sizes.seeds(2)
    some = KernelReservoir(1, MAX_ROWS, seed=quantise_seed)
    for taken, num_rows in passed(_drawn_rows, some, checked(batches()), each, check=True):
        some.keep(taken, num_rows)
        progress(0.0, "target sensations")
    require_rows(some.num_rows, sizes.num_targets)
    columns = some.sample().columns
    senses = SeveralPlaces.of(columns["sensation"])
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
    return SortedExperience(
        targets=targets,
        joint_scale=scale,
        sample=kernels.sample(),
        senses=senses,
        total=total,
        num_touches=some.num_rows,
        num_set_aside=num_set_aside,
    )


def _targets_and_scale(
    q: np.ndarray, sensation: np.ndarray, senses: SeveralPlaces, sizes: Sizes
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


def _drawn_rows(draw: Draw, batch: Batch) -> tuple[dict[str, np.ndarray], int]:
    """Rows of a block that the target sensations may be learned from, and its number of rows."""
    sensation, q = batch
    row = np.arange(len(q))
    return draw.take(np.zeros_like(row), row, sensation=sensation, q=q.astype(np.float32)), len(q)


class _Block(NamedTuple):
    """What a block of the experience adds to the kernels."""

    taken: dict[str, np.ndarray]
    num_rows: int
    num_set_aside: int
    total: np.ndarray | float


def _sorted_block(targets: np.ndarray, senses: SeveralPlaces, draw: Draw, batch: Batch) -> _Block:
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
