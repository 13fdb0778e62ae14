"""Learns the quotient representation from experience (paper, section III)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import issparse
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.representation.graphs import surface_neighbours, unlike
from selftouch_drake.agent.representation.joints import joint_scale
from selftouch_drake.agent.representation.kernels import (
    KernelReservoir,
    KernelSample,
    KernelSets,
)
from selftouch_drake.agent.representation.neighbours import component_labels, connected_edges
from selftouch_drake.agent.representation.quantise import (
    assign,
    rare_cells,
    strength,
    target_sensations,
)
from selftouch_drake.agent.representation.quotient import QuotientRepresentation, mattering
from selftouch_drake.agent.representation.relevance import touch_modes
from selftouch_drake.agent.representation.set_distances import (
    MAX_QUERIES,
    linked_nearest,
    set_distances,
)
from selftouch_drake.agent.representation.touches import (
    ambiguous_touches,
    kernel_parts,
    receptors_together,
)
from selftouch_drake.threads import thread_pool

#: Rows that target sensations are learned from: 40 per target for 1000 targets.
MAX_ROWS = 40_000

# Rows per block: bounds the memory.
_BLOCK = 16_384

#: Most rounds in which targets are chosen, each without the touches of rare targets of the last.
_MOST_ROUNDS = 6

#: Called with the fraction done and what is being done.
Progress = Callable[[float, str], None]

#: `(n, S)` sensations in N and `(n, J)` motor configurations in the robot's units.
Batch = tuple[np.ndarray, np.ndarray]

#: Gives the experience from its first row on, each time it is called, in batches of any size.
Batches = Callable[[], Iterable[Batch]]


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
    max_queries: int = MAX_QUERIES,
    seed: int = 0,
    progress: Progress = lambda fraction, stage: None,
) -> Learned:
    """Learns from experience of any size in bounded memory; batch sizes do not matter.

    Experience is read twice: for the target sensations, and for the kernel of each.

    Args:
        batches: called twice, returns the same experience each time, as
            `ExperienceReader.touches` does.
        num_targets: K, number of target sensations.
        max_kernel_size: most motor configurations kept per kernel.
        max_queries: most configurations per set whose nearest neighbours are searched.
        seed: the same seed and experience give the same bytes.
        progress: called with the fraction done and the stage.

    Raises:
        ValueError: a parameter is invalid, the experience cannot be learned from, or the second
            reading has a different number of rows.
    """
    _check_parameters(
        num_targets=num_targets, max_kernel_size=max_kernel_size, max_queries=max_queries
    )
    quantise_seed, sample_seed, mode_seed = np.random.SeedSequence(seed).generate_state(3)

    known = _quantised(batches, num_targets, int(quantise_seed), progress)
    sample, num_set_aside = _sampled(batches, known, max_kernel_size, int(sample_seed), progress)
    x = (sample.columns["q"] * known.joint_scale).astype(np.float32)
    sets = KernelSets(x, sample.offsets(num_targets))
    part = kernel_parts(known.targets, known.overlap)
    mode, mode_joints = touch_modes(
        sets,
        known.targets,
        part,
        seed=int(mode_seed),
        progress=lambda fraction: progress(0.3 + 0.3 * fraction, "joints that matter"),
    )
    sets = sets.at(mattering(x, mode, mode_joints))
    distance = set_distances(
        sets,
        "quantile",
        max_queries=max_queries,
        rough=unlike(known.targets),
        progress=lambda fraction: progress(0.6 + 0.4 * fraction, "set distances"),
    )
    learned = with_graph(
        sample,
        sets,
        distance,
        target_sensations=known.targets,
        kernel_mode=mode,
        mode_joints=mode_joints,
        joint_scale=known.joint_scale,
        overlap=known.overlap,
        part=part,
        num_touches=known.num_rows,
        num_set_aside=num_set_aside,
    )
    progress(1.0, "quotient graph")
    return learned


@dataclass(frozen=True, slots=True, eq=False)
class _Quantised:
    """What a sample of the experience shows: fields as of `QuotientRepresentation`.

    Attributes:
        chance: result of `by_chance`.
        num_rows: of the whole experience.
    """

    targets: np.ndarray
    joint_scale: np.ndarray
    overlap: np.ndarray
    chance: bool
    num_rows: int


def _quantised(batches: Batches, num_targets: int, seed: int, progress: Progress) -> _Quantised:
    """Reads the experience, and chooses target sensations and a scale of the joints."""
    some = KernelReservoir(1, MAX_ROWS, seed=seed)
    for sensation, q in _in_blocks(_checked(batches())):
        some.add(np.zeros(len(sensation), dtype=int), sensation=sensation, q=q.astype(np.float32))
        progress(0.0, "target sensations")
    if some.num_rows < num_targets:
        raise ValueError(
            f"num_targets is {num_targets}, but there are only {some.num_rows} "
            "sensations: give a smaller number, or babble longer"
        )
    columns = some.sample().columns
    overlap, chance = receptors_together(columns["sensation"])
    kept = ~ambiguous_touches(columns["sensation"], overlap, chance)
    if not kept.any():
        raise ValueError(
            "sensation has touches on several parts of the body in every row: babble until "
            "each part is touched alone"
        )
    sensation, q = columns["sensation"][kept], columns["q"][kept]
    with thread_pool(1) as beside:
        scaling = beside.submit(joint_scale, q, sensation)
        targets = common_targets(
            sensation,
            num_targets,
            overlap if chance else None,
            progress=lambda fraction: progress(0.2 * fraction, "target sensations"),
        )
    return _Quantised(targets, scaling.result(), overlap, chance, some.num_rows)


def _sampled(
    batches: Batches, known: _Quantised, max_kernel_size: int, seed: int, progress: Progress
) -> tuple[KernelSample, int]:
    """Reads the experience again, for the kernel of each row; counts the rows set aside."""
    kernels = KernelReservoir(len(known.targets), max_kernel_size, seed=seed)
    num_set_aside = 0
    for sensation, q in _in_blocks(batches()):
        label, error = assign(sensation, known.targets)
        left_out = ambiguous_touches(sensation, known.overlap, known.chance)
        num_set_aside += int(left_out.sum())
        label[left_out] = -1
        kernels.add(
            label,
            q=q.astype(np.float32),
            strength=strength(sensation).astype(np.float32),
            error=error,
        )
        progress(0.2 + 0.1 * min(kernels.num_rows / known.num_rows, 1.0), "motor kernels")
    if kernels.num_rows != known.num_rows:
        raise ValueError(
            f"batches gave {known.num_rows} rows, then {kernels.num_rows}: give the same "
            "experience each time"
        )
    return kernels.sample(), num_set_aside


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
    i, j = edges.T
    representation = QuotientRepresentation(
        kernel_offsets=sets.offsets,
        kernel_q=sample.columns["q"],
        kernel_row=sample.row,
        kernel_strength=sample.columns["strength"],
        kernel_error=sample.columns["error"],
        set_distance=distance,
        edges=edges,
        edge_cost=firm_steps(sets.firm(sample.columns["strength"]), edges),
        embedding=np.full((len(targets), 3), np.nan),
        **known,
    )
    bridges = edges[component[i] != component[j]]
    return Learned(representation=representation, component=component, bridges=bridges)


def common_targets(
    sensation: np.ndarray,
    num_targets: int,
    overlap: np.ndarray | None,
    *,
    or_fewer: bool = False,
    progress: Callable[[float], None] = lambda fraction: None,
) -> np.ndarray:
    """`(K, S)` target sensations, without those of touches at two places by chance.

    If two places are touched at once by chance, some of these places are so close that the touches
    cannot be recognised. They are rare and unlike all others, so farthest points would choose them.
    So targets with hardly any touches are dropped, together with their touches. If no touches come
    together by chance, `overlap` `(S, S)` is None; the rest is as of `target_sensations`.
    """
    for _ in range(_MOST_ROUNDS):
        targets = target_sensations(sensation, num_targets, or_fewer=or_fewer, progress=progress)
        if overlap is None:
            break
        label, _ = assign(sensation, targets)
        rare = rare_cells(label, kernel_parts(targets, overlap))
        if not rare.any():
            break
        sensation = sensation[~rare[label]]
    return targets


#: The text of an error.
NO_ROWS = "sensation has 0 rows: babble until the finger touches the body"


def _check_parameters(**numbers: Any) -> None:
    for name, value in numbers.items():
        lowest = 2 if name == "num_targets" else 1
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < lowest:
            raise ValueError(f"{name} is {value!r}: give a whole number, {lowest} or more")


def _checked(batches: Iterable[Batch]) -> Iterator[Batch]:
    """The same batches, each checked when it is read."""
    row, widths = 0, dict[str, int]()
    for given, given_q in batches:
        sensation, q = as_numbers("sensation", given), as_numbers("q", given_q)
        check_sensation(sensation, row)
        _check_configurations(q, len(sensation), row)
        for name, what, array in (("sensation", "receptors", sensation), ("q", "joints", q)):
            width = widths.setdefault(name, array.shape[1])
            if array.shape[1] != width:
                raise ValueError(
                    f"{name} row {row} has {array.shape[1]} {what}, earlier rows have {width}: "
                    "give experience of one robot"
                )
        row += len(sensation)
        yield sensation, q
    if row == 0:
        raise ValueError(NO_ROWS)


def _in_blocks(batches: Iterable[Batch]) -> Iterator[Batch]:
    """The same rows in blocks of at most `_BLOCK`."""
    for sensation, q in batches:
        for start in range(0, len(sensation), _BLOCK):
            block = slice(start, start + _BLOCK)
            yield np.asarray(sensation)[block], np.asarray(q)[block]


def firm_steps(firm: KernelSets, edges: np.ndarray) -> np.ndarray:
    """`(E,)` rad, mean nearest distance between the firm configurations of both ends.

    The mean over both directions, as in the paper's mean nearest distance.
    """
    if not len(edges):
        return np.empty(0, np.float32)
    nearest = linked_nearest(firm, np.concatenate([edges, edges[:, ::-1]]))
    there, back = np.split(np.add.reduceat(np.sqrt(nearest.squared), nearest.offsets[:-1]), 2)
    i, j = edges.T
    return ((there / firm.sizes[i] + back / firm.sizes[j]) / 2).astype(np.float32)


def as_numbers(name: str, rows: Any) -> np.ndarray:
    """The rows as an array.

    Raises:
        TypeError: they are sparse.
        ValueError: they are no real numbers.
    """
    if issparse(rows):
        raise TypeError(f"{name} is sparse: give it dense, as {name}.toarray() is")
    array = np.asarray(rows)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} holds {array.dtype}: give real numbers")
    return array


def check_sensation(sensation: np.ndarray, first_row: int = 0) -> None:
    """Rejects sensations that no skin can produce."""
    if sensation.ndim != 2 or sensation.shape[1] == 0:
        raise ValueError(
            f"sensation has shape {sensation.shape}: give sensations as (rows, receptors)"
        )
    felt = strength(sensation).astype(np.float32)
    if (bad := np.flatnonzero(~np.isfinite(felt))).size:
        raise ValueError(
            f"sensation row {first_row + bad[0]} holds NaN or infinity: drop such rows ({bad.size})"
        )
    if (lowest := sensation.min(initial=0)) < 0:
        raise ValueError(
            f"sensation holds {lowest:g}, a negative reading: give pressures, without the "
            "receptors' offset"
        )
    if (null := np.flatnonzero(felt == 0)).size:
        raise ValueError(
            f"sensation row {first_row + null[0]} is null: keep only rows that touch "
            f"({null.size} do not)"
        )


def _check_configurations(q: np.ndarray, num_rows: int, first_row: int = 0) -> None:
    """Rejects motor configurations that do not match `num_rows` sensations."""
    if q.ndim != 2 or q.shape[1] == 0:
        raise ValueError(f"q has shape {q.shape}: give motor configurations as (rows, joints)")
    if len(q) != num_rows:
        raise ValueError(
            f"q has {len(q)} rows and sensation {num_rows}: give one motor configuration "
            "for each sensation"
        )
    if (bad := np.flatnonzero(~np.isfinite(q).all(axis=1))).size:
        raise ValueError(
            f"q row {first_row + bad[0]} holds NaN or infinity: drop such rows ({bad.size})"
        )
