"""Learns the quotient representation from experience (paper, section III)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import csr_array
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.representation.graphs import (
    component_labels,
    connected_edges,
    surface_neighbours,
    unlike,
)
from selftouch_drake.agent.representation.kernels import KernelReservoir, KernelSample, KernelSets
from selftouch_drake.agent.representation.quantise import assign, strength, target_sensations, unit
from selftouch_drake.agent.representation.quotient import QuotientRepresentation, mattering
from selftouch_drake.agent.representation.relevance import joint_scale, touch_modes
from selftouch_drake.agent.representation.set_distances import (
    MAX_QUERIES,
    linked_nearest,
    set_distances,
)
from selftouch_drake.agent.representation.touches import (
    Together,
    expected_readings,
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

#: Cells with less than this share of the touches of a typical one are chance. On a sphere that two
#: arms touch, 30 of 182 cells held one touch in 100,000 each, and no other less than 349.
_RARE = 0.05

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
    for name, number, least in (
        ("num_targets", num_targets, 2),
        ("max_kernel_size", max_kernel_size, 1),
        ("max_queries", max_queries, 1),
        ("seed", seed, 0),
    ):
        if isinstance(number, bool) or not isinstance(number, int | np.integer) or number < least:
            raise ValueError(f"{name} is {number!r}: give a whole number, {least} or more")
    quantise_seed, sample_seed, mode_seed = np.random.SeedSequence(seed).generate_state(3)

    targets, scale, together, expected, num_rows = _quantised(
        batches, num_targets, int(quantise_seed), progress
    )
    kernels = KernelReservoir(num_targets, max_kernel_size, seed=int(sample_seed))
    num_set_aside, total = 0, np.zeros(targets.shape)
    for whole, q in _in_blocks(batches()):
        row, sensation, left_out = together.places(whole)
        num_set_aside += int(left_out.sum())
        label, error = assign(_as_compared(sensation, expected), targets)
        label[left_out] = -1
        felt = strength(sensation).astype(np.float32)
        if expected is not None:
            kept = np.flatnonzero(label >= 0)
            cells = csr_array((np.ones(len(kept)), (label[kept], kept)), (num_targets, len(label)))
            total += cells @ unit(sensation)
        kernels.add(label, row=row, q=q[row].astype(np.float32), strength=felt, error=error)
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
        max_queries=max_queries,
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
        # What is stored is what is felt.
        known = replace(learned.representation, target_sensations=unit(total))
        learned = replace(learned, representation=known)
    progress(1.0, "quotient graph")
    return learned


def _quantised(
    batches: Batches, num_targets: int, seed: int, progress: Progress
) -> tuple[np.ndarray, np.ndarray, Together, np.ndarray | None, int]:
    """Reads the experience, and chooses target sensations and a scale of the joints.

    Returns these two, what `receptors_together` and `expected_readings` found, and the number of
    rows.
    """
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
    together = receptors_together(columns["sensation"])
    row, sensation, left_out = together.places(columns["sensation"])
    expected = expected_readings(columns["sensation"], together.near)
    sensation = _as_compared(sensation[~left_out], expected)
    kept = np.unique(row[~left_out])
    if not len(kept):
        raise ValueError(
            "sensation has touches on several parts of the body in every row: babble until "
            "each part is touched alone"
        )
    whole, q = columns["sensation"][kept], columns["q"][kept]
    with thread_pool(1) as beside:
        scaling = beside.submit(joint_scale, q, _as_compared(whole, expected))
        targets = common_targets(sensation, num_targets, together)
    return targets, scaling.result(), together, expected, some.num_rows


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
    together: Together,
    *,
    or_fewer: bool = False,
) -> np.ndarray:
    """`(K, S)` target sensations, without those of touches at two places by chance.

    If two places are touched at once by chance, some of these places are so close that the touches
    cannot be recognised. They are rare and unlike all others, so farthest points would choose them.
    So targets with hardly any touches, for their part, are dropped with their touches. If none come
    together by chance, this does nothing. The rest is as of `target_sensations`.
    """
    for _ in range(_MOST_ROUNDS):
        targets = target_sensations(sensation, num_targets, or_fewer=or_fewer)
        if not together.chance:
            break
        label, _ = assign(sensation, targets)
        size, part = (
            np.bincount(label, minlength=len(targets)),
            kernel_parts(targets, together.near),
        )
        typical = np.array([np.median(size[part == number]) for number in range(part.max() + 1)])
        rare = size < _RARE * typical[part]
        if not rare.any():
            break
        sensation = sensation[~rare[label]]
    return targets


#: The text of an error.
NO_ROWS = "sensation has 0 rows: babble until the finger touches the body"


def _checked(batches: Iterable[Batch]) -> Iterator[Batch]:
    """The same batches, each checked when it is read."""
    row, widths = 0, dict[str, int]()
    for given, given_q in batches:
        sensation, q = as_numbers("sensation", given), as_numbers("q", given_q)
        check_sensation(sensation, row)
        if q.ndim != 2 or q.shape[1] == 0:
            raise ValueError(f"q has shape {q.shape}: give motor configurations as (rows, joints)")
        if len(q) != len(sensation):
            raise ValueError(
                f"q has {len(q)} rows and sensation {len(sensation)}: give one motor configuration "
                "for each sensation"
            )
        _check_finite("q", np.isfinite(q).all(axis=1), row)
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


def as_numbers(name: str, rows: Any) -> np.ndarray:
    """The rows as an array; raises a ValueError if they are no real numbers, or sparse."""
    array = np.asarray(rows)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} holds {array.dtype}: give real numbers, not sparse")
    return array


def check_sensation(sensation: np.ndarray, first_row: int = 0) -> None:
    """Rejects sensations that no skin can produce."""
    if sensation.ndim != 2 or sensation.shape[1] == 0:
        raise ValueError(
            f"sensation has shape {sensation.shape}: give sensations as (rows, receptors)"
        )
    felt = strength(sensation).astype(np.float32)
    _check_finite("sensation", np.isfinite(felt), first_row)
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


def _check_finite(name: str, finite: np.ndarray, first_row: int) -> None:
    if (bad := np.flatnonzero(~finite)).size:
        raise ValueError(
            f"{name} row {first_row + bad[0]} holds NaN or infinity: drop such rows ({bad.size})"
        )
