"""Learns the quotient representation from experience (paper, section III)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.sparse import csr_array
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.representation.batches import (
    NO_ROWS,
    Batch,
    Batches,
    Map,
    checked,
    passed,
)
from selftouch_drake.agent.representation.graphs import (
    component_labels,
    connected_edges,
    surface_neighbours,
    unlike,
)
from selftouch_drake.agent.representation.kernels import (
    Draw,
    KernelReservoir,
    KernelSample,
    KernelSets,
)
from selftouch_drake.agent.representation.quantise import assign, strength, target_sensations, unit
from selftouch_drake.agent.representation.quotient import QuotientRepresentation, mattering
from selftouch_drake.agent.representation.relevance import joint_scale, touch_modes
from selftouch_drake.agent.representation.set_distances import linked_nearest, set_distances
from selftouch_drake.agent.representation.touches import (
    Together,
    expected_readings,
    kernel_parts,
    pooled,
    receptors_together,
)
from selftouch_drake.threads import thread_pool

#: Rows that target sensations are learned from: 40 per target for 1000 targets.
MAX_ROWS = 40_000

#: Most rounds in which targets are chosen, each without the touches of rare targets of the last.
_MOST_ROUNDS = 6

#: Cells with less than this share of the touches of a typical one are chance. On a sphere that two
#: arms touch, 30 of 182 cells held one touch in 100,000 each, and no other less than 349.
_RARE = 0.05

#: Called with the fraction done and what is being done.
Progress = Callable[[float, str], None]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Learned:
    """What was learned from experience.

    Attributes:
        representation: not embedded yet.
        component: `(K,)` the component of the quotient graph of each kernel before bridges were
            added; 0 is the largest.
        bridges: `(B, 2)` pairs of kernels i < j, the edges that join components of one part.
    """

    representation: QuotientRepresentation
    component: np.ndarray
    bridges: np.ndarray


# Sums in another order, by another number of threads, would give other bytes.
@threadpool_limits.wrap(limits=1, user_api="blas")
def learn(
    batches: Batches,
    *,
    num_targets: int,
    max_kernel_size: int,
    seed: int = 0,
    progress: Progress = lambda fraction, stage: None,
    each: Map = map,
) -> Learned:
    """Learns from experience of any size in bounded memory; batch sizes do not matter.

    Experience is read twice: for the target sensations, and for the kernel of each.

    Args:
        batches: called twice, returns the same experience each time, as
            `ExperienceReader.touches` and `stored` do.
        num_targets: K, number of target sensations.
        max_kernel_size: most motor configurations kept per kernel.
        seed: the same seed and experience give the same bytes.
        progress: called with the fraction done and the stage.
        each: makes the calls that read; what they return does not depend on where.

    Raises:
        ValueError: a parameter is invalid, the experience cannot be learned from, or the second
            reading has a different number of rows.
    """
    for name, number, least in (
        ("num_targets", num_targets, 2),
        ("max_kernel_size", max_kernel_size, 1),
        ("seed", seed, 0),
    ):
        if isinstance(number, bool) or not isinstance(number, int | np.integer) or number < least:
            raise ValueError(f"{name} is {number!r}: give a whole number, {least} or more")
    quantise_seed, sample_seed, mode_seed = np.random.SeedSequence(seed).generate_state(3)

    targets, scale, together, expected, num_rows = _quantised(
        batches, num_targets, int(quantise_seed), progress, each
    )
    kernels = KernelReservoir(num_targets, max_kernel_size, seed=int(sample_seed))
    num_set_aside, total = 0, 0.0
    sort = partial(_sorted, targets, together, expected)
    for taken, rows, left_out, felt in passed(sort, kernels, batches(), each):
        kernels.keep(taken, rows)
        num_set_aside += left_out
        total += felt
        progress(min(0.2 + 0.1 * kernels.num_rows / num_rows, 0.3), "motor kernels")
    if kernels.num_rows != num_rows:
        raise ValueError(
            f"batches gave {num_rows} rows, then {kernels.num_rows}: give the same experience "
            "each time"
        )
    sample = kernels.sample()
    x = (sample.columns["q"] * scale).astype(np.float32)
    sets = KernelSets(x, sample.offsets(num_targets))
    part = kernel_parts(targets, together.near)
    progress(0.3, "joints that matter")
    mode, mode_joints = touch_modes(sets, targets, part, together.double, seed=int(mode_seed))
    sets = sets.at(mattering(x, mode, mode_joints))
    distance = set_distances(
        sets,
        "quantile",
        rough=unlike(targets),
        progress=lambda fraction: progress(0.6 + 0.4 * fraction, "set distances"),
    )
    learned = with_graph(
        sample,
        sets,
        distance,
        target_sensations=targets,
        kernel_mode=mode,
        mode_joints=mode_joints,
        joint_scale=scale,
        overlap=together.near,
        part=part,
        num_touches=num_rows,
        num_set_aside=num_set_aside,
    )
    if expected is not None:
        # Binary targets are stored as they are felt, pools as they are compared.
        pool = together.pool
        felt = np.asarray(total) if together.binary else targets[:, pool] / np.bincount(pool)[pool]
        known = replace(
            learned.representation, target_sensations=unit(felt), overlap=together.overlap
        )
        learned = replace(learned, representation=known)
    progress(1.0, "quotient graph")
    return learned


def _quantised(
    batches: Batches, num_targets: int, seed: int, progress: Progress, each: Map
) -> tuple[np.ndarray, np.ndarray, Together, np.ndarray | None, int]:
    """Reads the experience, and chooses target sensations and a scale of the joints.

    Returns these two, what `receptors_together` and `expected_readings` found, and the number of
    rows.
    """
    some = KernelReservoir(1, MAX_ROWS, seed=seed)
    for taken, rows in passed(_some, some, checked(batches()), each, check=True):
        some.keep(taken, rows)
        progress(0.0, "target sensations")
    if not some.num_rows:
        raise ValueError(NO_ROWS)
    if some.num_rows < num_targets:
        raise ValueError(
            f"num_targets is {num_targets}, but there are only {some.num_rows} "
            "sensations: give a smaller number, or babble longer"
        )
    columns = some.sample().columns
    together = receptors_together(columns["sensation"])
    felt = pooled(columns["sensation"], together.pool)
    row, sensation, left_out = together.places(columns["sensation"])
    expected = expected_readings(felt, together)
    sensation = _as_compared(sensation[~left_out], expected)
    kept = np.unique(row[~left_out])
    if not len(kept):
        raise ValueError(
            "sensation has touches on several parts of the body in every row: babble until "
            "each part is touched alone"
        )
    whole, q = _as_compared(felt[kept], expected), columns["q"][kept]
    with thread_pool(1) as beside:
        scaling = beside.submit(joint_scale, q, whole)
        targets = common_targets(sensation, num_targets, together.near, together.chance)
    return targets, scaling.result(), together, expected, some.num_rows


def _some(draw: Draw, batch: Batch) -> tuple[dict[str, np.ndarray], int]:
    sensation, q = batch
    row = np.arange(len(q))
    return draw.take(np.zeros_like(row), row, sensation=sensation, q=q.astype(np.float32)), len(q)


def _sorted(
    targets: np.ndarray,
    together: Together,
    expected: np.ndarray | None,
    draw: Draw,
    batch: Batch,
) -> tuple[dict[str, np.ndarray], int, int, np.ndarray | float]:
    """Sorts touches into kernels.

    Returns what may be kept, the numbers of touches and of those left out, and what is felt in each
    kernel in all, if it must be known.
    """
    whole, q = batch
    row, of_pools, left_out = together.places(whole)
    label, error = assign(_as_compared(of_pools, expected), targets)
    label[left_out] = -1
    sensation = together.receptors(whole, row, of_pools)
    felt: np.ndarray | float = 0.0
    if together.binary:
        kept = np.flatnonzero(label >= 0)
        cells = csr_array((np.ones(len(kept)), (label[kept], kept)), (len(targets), len(label)))
        felt = cells @ unit(sensation)
    firm = strength(sensation).astype(np.float32)
    taken = draw.take(label, row, q=q[row].astype(np.float32), strength=firm, error=error)
    return taken, len(q), int(left_out.sum()), felt


def _as_compared(sensation: np.ndarray, expected: np.ndarray | None) -> np.ndarray:
    return sensation if expected is None else sensation.astype(np.float32) @ expected


def with_graph(
    sample: KernelSample,
    sets: KernelSets,
    distance: np.ndarray,
    **known: Any,
) -> Learned:
    """Joins kernels that are neighbours on the body.

    The sets are those of the rows of the sample (columns q, strength, error), scaled, rad, and
    `(K, K)` rad their distance; `known` are all other fields of the representation.
    """
    targets, part = known["target_sensations"], known["part"]
    neighbours, near = surface_neighbours(distance, targets, part)
    edges = connected_edges(neighbours, near)
    component = component_labels(neighbours, len(targets))
    (i, j), firm = edges.T, sets.firm(sample.columns["strength"])
    # Mean nearest distances in both directions, as in the paper, between firm touches.
    offsets, _, squared = linked_nearest(firm, np.concatenate([edges, edges[:, ::-1]]))
    there, back = np.split(np.add.reduceat(np.sqrt(squared), offsets[:-1]), 2)
    representation = QuotientRepresentation(
        kernel_offsets=sets.offsets,
        kernel_q=sample.columns["q"],
        kernel_row=sample.row,
        kernel_strength=sample.columns["strength"],
        kernel_error=sample.columns["error"],
        set_distance=distance,
        edges=edges,
        edge_cost=((there / firm.sizes[i] + back / firm.sizes[j]) / 2).astype(np.float32),
        embedding=np.full((len(targets), 3), np.nan),
        **known,
    )
    bridges = edges[component[i] != component[j]]
    return Learned(representation=representation, component=component, bridges=bridges)


def common_targets(
    sensation: np.ndarray,
    num_targets: int,
    near: np.ndarray,
    chance: bool,
    *,
    or_fewer: bool = False,
) -> np.ndarray:
    """`(K, S)` target sensations, without those of touches at two places by chance.

    If two places are touched at once by chance, some of these places are so close that the touches
    cannot be recognised. They are rare and unlike all others, so farthest points would choose them.
    So targets with hardly any touches, for their part, are dropped with their touches. If not
    `chance`, this does nothing. Parts follow from `(S, S)` `near`; it and `chance` are as of
    `Together`, all else is as of `target_sensations`.
    """
    for _ in range(_MOST_ROUNDS):
        targets = target_sensations(sensation, num_targets, or_fewer=or_fewer)
        if not chance:
            break
        label, _ = assign(sensation, targets)
        size = np.bincount(label, minlength=len(targets))
        part = kernel_parts(targets, near)
        typical = np.array([np.median(size[part == number]) for number in range(part.max() + 1)])
        rare = size < _RARE * typical[part]
        if not rare.any():
            break
        sensation = sensation[~rare[label]]
    return targets
