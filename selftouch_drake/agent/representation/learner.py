"""Learns the quotient representation from experience, as a scikit-learn estimator."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
from scipy.sparse import issparse
from sklearn.base import BaseEstimator
from sklearn.utils import Tags
from sklearn.utils.validation import check_is_fitted, validate_data
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.representation.graphs import surface_neighbours, unlike
from selftouch_drake.agent.representation.joints import joint_scale
from selftouch_drake.agent.representation.kernels import (
    KernelReservoir,
    KernelSample,
    quick_to_sort,
)
from selftouch_drake.agent.representation.neighbours import (
    NUM_MUTUAL,
    component_labels,
    connected_edges,
)
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
    SET_DISTANCES,
    linked_nearest,
    set_distances,
)
from selftouch_drake.agent.representation.touches import (
    by_chance,
    kernel_parts,
    nearby,
    overlapping,
    set_aside,
)
from selftouch_drake.threads import Threads

#: Rows that target sensations are learned from: 40 a target, when there are 1000.
MAX_ROWS = 40_000

# Rows that are worked on at a time, to bound the memory.
_BLOCK = 16_384

#: Targets are chosen anew so often at most, without the touches that hardly any other is like.
_MOST_ROUNDS = 6

#: Called with the fraction done and what is being done.
Progress = Callable[[float, str], None]

#: Gives the experience from its first row on, each time it is called: `(n, S)` sensations in N and
#: `(n, J)` motor configurations in the robot's units, in batches of any size.
Batches = Callable[[], Iterable[tuple[np.ndarray, np.ndarray]]]


class QuotientLearner(BaseEstimator):
    """Learns motor kernel sets and the quotient graph from experience (paper, section III).

    Naive: it reads motor configurations and sensations, and nothing else.

    Args:
        num_targets: K, number of target sensations.
        max_kernel_size: most motor configurations kept per kernel.
        set_distance: the set distance used for shape, a name in `SET_DISTANCES`.
        num_neighbours: number of mutual nearest kernels that the quotient graph joins.
        max_queries: most configurations per set whose nearest neighbours are searched.
        random_state: seed, or a generator to draw one from; the same seed and experience give the
            same bytes.

    Attributes:
        representation_: the `QuotientRepresentation`, not embedded yet.
        target_sensations_: `(K, S)` unit L2 norm.
        component_: `(K,)` the component of the quotient graph of each kernel before bridges were
            added; 0 is the largest.
        bridges_: `(B, 2)` pairs of kernels i < j, the edges that join components of one part.
        n_features_in_: S, number of receptors.
        feature_names_in_: `(S,)` names of the receptors, if the sensations have any.
    """

    def __init__(
        self,
        num_targets: int = 1000,
        max_kernel_size: int = 1000,
        *,
        set_distance: str = "quantile",
        num_neighbours: int = NUM_MUTUAL,
        max_queries: int = MAX_QUERIES,
        random_state: int = 0,
    ) -> None:
        self.num_targets = num_targets
        self.max_kernel_size = max_kernel_size
        self.set_distance = set_distance
        self.num_neighbours = num_neighbours
        self.max_queries = max_queries
        self.random_state = random_state

    def fit(
        self,
        sensation: np.ndarray,
        q: np.ndarray,
        progress: Progress = lambda fraction, stage: None,
    ) -> QuotientLearner:
        """Quantises the sensations, collects the kernel sets and measures their distances.

        Args:
            sensation: `(n, S)` N, no row null.
            q: `(n, J)` the motor configurations at which they were felt, in the robot's units.
            progress: called with the fraction done and the stage.

        Returns:
            self.

        Raises:
            ValueError: a parameter is invalid, or the experience cannot be learned from.
        """
        return self.fit_batches(lambda: [(sensation, q)], progress)

    # Sums in another order, by another number of threads, would give other bytes.
    @threadpool_limits.wrap(limits=1, user_api="blas")
    def fit_batches(
        self, batches: Batches, progress: Progress = lambda fraction, stage: None
    ) -> QuotientLearner:
        """Learns from experience of any size in bounded memory; batch sizes do not matter.

        Experience is read twice: for the target sensations, and for the kernel of each.

        Args:
            batches: called twice, returns the same experience each time, as
                `ExperienceReader.touches` does.
            progress: called with the fraction done and the stage.

        Returns:
            self.

        Raises:
            ValueError: as `fit`, or the second reading has a different number of rows.
        """
        self._check_parameters()
        seed = self.random_state
        if isinstance(seed, np.random.RandomState):
            seed = seed.randint(2**31)
        quantise_seed, sample_seed, mode_seed = np.random.SeedSequence(seed).generate_state(3)

        some = KernelReservoir(1, MAX_ROWS, seed=int(quantise_seed))
        for sensation, q in _in_blocks(self._checked(batches())):
            some.add(
                np.zeros(len(sensation), dtype=int), sensation=sensation, q=q.astype(np.float32)
            )
            progress(0.0, "target sensations")
        if some.num_rows < self.num_targets:
            raise ValueError(
                f"num_targets is {self.num_targets}, but there are only {some.num_rows} "
                "sensations: give a smaller number, or babble longer"
            )
        sample = some.sample().columns
        overlap = overlapping(sample["sensation"])
        chance = by_chance(sample["sensation"], overlap)
        overlap = nearby(sample["sensation"], overlap)
        kept = ~set_aside(sample["sensation"], overlap, chance)
        if not kept.any():
            raise ValueError(
                "sensation has touches on several parts of the body in every row: babble until "
                "each part is touched alone"
            )
        sensation, q = sample["sensation"][kept], sample["q"][kept]
        with Threads(1) as beside:
            scaling = beside.submit(joint_scale, q, sensation)
            targets = common_targets(
                sensation,
                self.num_targets,
                overlap if chance else None,
                progress=lambda fraction: progress(0.2 * fraction, "target sensations"),
            )
        scale = scaling.result()
        kernels = KernelReservoir(self.num_targets, self.max_kernel_size, seed=int(sample_seed))
        num_set_aside = 0
        for sensation, q in _in_blocks(batches()):
            label, error = assign(sensation, targets)
            left_out = set_aside(sensation, overlap, chance)
            num_set_aside += int(left_out.sum())
            label[left_out] = -1
            kernels.add(
                label,
                q=q.astype(np.float32),
                strength=strength(sensation).astype(np.float32),
                error=error,
            )
            done = min(kernels.num_rows / some.num_rows, 1.0)
            progress(0.2 + 0.1 * done, "motor kernels")
        if kernels.num_rows != some.num_rows:
            raise ValueError(
                f"batches gave {some.num_rows} rows, then {kernels.num_rows}: give the same "
                "experience each time"
            )
        self._learn_graph(
            kernels.sample(),
            progress,
            seed=int(mode_seed),
            target_sensations=targets,
            joint_scale=scale,
            overlap=overlap,
            num_touches=some.num_rows,
            num_set_aside=num_set_aside,
        )
        return self

    def _learn_graph(
        self,
        sample: KernelSample,
        progress: Progress,
        *,
        seed: int,
        target_sensations: np.ndarray,
        joint_scale: np.ndarray,
        overlap: np.ndarray,
        **counts: int,
    ) -> None:
        targets, offsets = target_sensations, sample.offsets(len(target_sensations))
        part = kernel_parts(targets, overlap)
        x = (sample.columns["q"] * joint_scale).astype(np.float32)
        mode, mode_joints = touch_modes(
            x,
            offsets,
            targets,
            part,
            seed=seed,
            progress=lambda fraction: progress(0.3 + 0.3 * fraction, "joints that matter"),
        )
        kernel_x = mattering(x, mode, mode_joints)
        (distance,) = set_distances(
            kernel_x,
            offsets,
            self.set_distance,
            max_queries=self.max_queries,
            rough=unlike(targets),
            progress=lambda fraction: progress(0.6 + 0.4 * fraction, "set distances"),
        )
        neighbours, near = surface_neighbours(distance, targets, part, self.num_neighbours)
        edges = connected_edges(neighbours, near)
        progress(1.0, "quotient graph")

        self.target_sensations_ = targets
        self.component_ = component_labels(neighbours, len(targets))
        i, j = edges.T
        self.bridges_ = edges[self.component_[i] != self.component_[j]]
        self.representation_ = QuotientRepresentation(
            target_sensations=targets,
            kernel_offsets=offsets,
            kernel_q=sample.columns["q"],
            kernel_row=sample.row,
            kernel_strength=sample.columns["strength"],
            kernel_error=sample.columns["error"],
            kernel_mode=mode,
            mode_joints=mode_joints,
            joint_scale=joint_scale,
            overlap=overlap,
            part=part,
            set_distance=distance,
            edges=edges,
            edge_cost=firm_steps(kernel_x, *firm(sample, offsets), edges),
            embedding=np.full((len(targets), 3), np.nan),
            **counts,
        )

    def predict(self, sensation: np.ndarray) -> np.ndarray:
        """The kernel of each sensation.

        Args:
            sensation: `(n, S)` N, no row null.

        Returns:
            `(n,)` index of the nearest target sensation.

        Raises:
            ValueError: a sensation has another number of receptors, is null, or is not finite.
        """
        check_is_fitted(self)
        validate_data(self, sensation, reset=False, skip_check_array=True)
        sensation = _numbers("sensation", sensation)
        _check_sensation(sensation)
        if not len(sensation):
            raise ValueError(_NO_ROWS)
        return assign(sensation, self.target_sensations_)[0]

    def __sklearn_tags__(self) -> Tags:
        """Declares what `fit` accepts: non-negative sensations, and a vector target for each."""
        tags = super().__sklearn_tags__()
        tags.input_tags.positive_only = True
        tags.target_tags.required = True
        tags.target_tags.multi_output = True
        tags.target_tags.single_output = False
        return tags

    def _checked(
        self, batches: Iterable[tuple[np.ndarray, np.ndarray]]
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """The same batches, each checked when it is read; records the receptors."""
        row, widths = 0, None
        for given, given_q in batches:
            sensation, q = _numbers("sensation", given), _numbers("q", given_q)
            _check_sensation(sensation, row)
            _check_configurations(q, len(sensation), row)
            if widths is None:
                widths = sensation.shape[1], q.shape[1]
                validate_data(self, given, skip_check_array=True)
            for name, parts, width, found in zip(
                ("sensation", "q"),
                ("receptors", "joints"),
                widths,
                (sensation.shape[1], q.shape[1]),
                strict=True,
            ):
                if found != width:
                    raise ValueError(
                        f"{name} row {row} has {found} {parts}, earlier rows have {width}: give "
                        "experience of one robot"
                    )
            row += len(sensation)
            yield sensation, q
        if row == 0:
            raise ValueError(_NO_ROWS)

    def _check_parameters(self) -> None:
        least = {"num_targets": 2, "max_kernel_size": 1, "num_neighbours": 1, "max_queries": 1}
        for name, lowest in least.items():
            value: Any = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < lowest:
                raise ValueError(f"{name} is {value!r}: give a whole number, {lowest} or more")
        seed = self.random_state
        if not (seed is None or isinstance(seed, np.random.RandomState)) and (
            isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0
        ):
            raise ValueError(f"random_state is {seed!r}: give a whole number, 0 or more")
        if self.set_distance not in SET_DISTANCES:
            raise ValueError(
                f"set_distance is {self.set_distance!r}: choose one of {', '.join(SET_DISTANCES)}"
            )


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
    So targets with hardly any touches are dropped, together with their touches.

    Args:
        sensation: `(n, S)` N, no row null.
        num_targets: K.
        overlap: `(S, S)` bool, of `touches.nearby`; None if no touches come together by chance.
        or_fewer: as of `target_sensations`.
        progress: called with the fraction done.
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


_NO_ROWS = "sensation has 0 rows: babble until the finger touches the body"


def _in_blocks(
    batches: Iterable[tuple[np.ndarray, np.ndarray]],
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The same rows in blocks that are not large."""
    for sensation, q in batches:
        for start in range(0, len(sensation), _BLOCK):
            block = slice(start, start + _BLOCK)
            yield np.asarray(sensation)[block], np.asarray(q)[block]


def firm_steps(
    kernel_x: np.ndarray, firm: np.ndarray, firm_offsets: np.ndarray, edges: np.ndarray
) -> np.ndarray:
    """`(E,)` rad, mean nearest distance between the firm configurations of both ends.

    The mean over both directions, as in the paper's mean nearest distance.
    """
    ways = np.concatenate([edges, edges[:, ::-1]])
    nearest = linked_nearest(kernel_x[firm], firm_offsets, ways)
    step = np.sqrt(nearest.squared)
    there, back = (
        np.split(np.add.reduceat(step, nearest.offsets[:-1]), 2)
        if len(edges)
        else (
            np.empty(0),
            np.empty(0),
        )
    )
    sizes = np.diff(firm_offsets)
    i, j = edges.T
    return ((there / sizes[i] + back / sizes[j]) / 2).astype(np.float32)


def firm(sample: KernelSample, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The more strongly felt half of each kernel: its rows of the sample, and offsets.

    A firm touch is deep in the skin, so small motion errors do not lose contact.
    """
    order = np.lexsort((-sample.columns["strength"], quick_to_sort(sample.kernel)))
    rank = np.arange(len(order)) - offsets[sample.kernel]
    sizes = (np.diff(offsets) + 1) // 2
    firm = np.sort(order[rank < sizes[sample.kernel]])
    return firm, np.concatenate([[0], np.cumsum(sizes)])


def _numbers(name: str, rows: Any) -> np.ndarray:
    if issparse(rows):
        raise TypeError(f"{name} is sparse: give it dense, as {name}.toarray() is")
    array = np.asarray(rows)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} holds {array.dtype}: give real numbers")
    return array


def _check_sensation(sensation: np.ndarray, first_row: int = 0) -> None:
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
