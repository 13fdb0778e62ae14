"""From experience to the quotient representation, as a scikit-learn estimator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted

from selftouch_drake.representation.graph import NUM_MUTUAL, connected_edges, neighbour_edges
from selftouch_drake.representation.kernels import KernelSample, sample_kernels
from selftouch_drake.representation.quantise import assign, strength, target_sensations
from selftouch_drake.representation.quotient import QuotientRepresentation
from selftouch_drake.representation.set_distances import MAX_QUERIES, SET_DISTANCES, set_distances

#: Told the fraction done and what is being done.
Progress = Callable[[float, str], None]


class QuotientLearner(BaseEstimator):
    """Learns motor kernel sets and the quotient graph from experience (paper, section III).

    Naive: it reads motor configurations and sensations, and nothing else.

    Args:
        num_targets: K, number of target sensations.
        max_kernel_size: most motor configurations kept in a kernel set.
        set_distance: the set distance kept for shape, a name in `SET_DISTANCES`.
        num_neighbours: mutual nearest kernels that the quotient graph joins.
        max_queries: configurations of a set that ask for their nearest in another.
        random_state: seed; the same seed and experience give the same bytes.

    Attributes:
        representation_: the `QuotientRepresentation`, not embedded yet.
        target_sensations_: `(K, S)` unit L2 norm.
        n_features_in_: S, number of receptors.
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
        """Quantises the sensations, gathers the kernel sets and measures how far apart they are.

        Args:
            sensation: `(n, S)` N, no row null.
            q: `(n, J)` rad, the motor configurations in which they were felt.
            progress: told the fraction done and the stage.

        Returns:
            self.

        Raises:
            ValueError: a parameter, or the experience, cannot be learned from.
        """
        self._check_parameters()
        sensation, q = np.asarray(sensation), np.asarray(q)
        felt = _check_experience(sensation, q, self.num_targets)

        quantise_seed, sample_seed = np.random.SeedSequence(self.random_state).generate_state(2)
        targets = target_sensations(
            sensation,
            self.num_targets,
            rng=np.random.default_rng(quantise_seed),
            progress=lambda fraction: progress(0.25 * fraction, "target sensations"),
        )
        label, error = assign(sensation, targets)
        sample = sample_kernels(label, self.max_kernel_size, seed=int(sample_seed))
        rows, offsets = sample.row, sample.offsets(self.num_targets)
        kernel_q = q[rows].astype(np.float32)

        (distance,) = set_distances(
            kernel_q,
            offsets,
            self.set_distance,
            max_queries=self.max_queries,
            progress=lambda fraction: progress(0.3 + 0.4 * fraction, "set distances"),
        )
        # Firm configurations decide who is a neighbour and what a step costs: measured on plans,
        # the quantile loses contact least as the one, the mean as the other.
        firm_rows, firm_offsets = _firm(sample, felt, self.num_targets)
        near, step = set_distances(
            q[firm_rows],
            firm_offsets,
            "quantile",
            "mean_nearest",
            max_queries=self.max_queries,
            progress=lambda fraction: progress(0.7 + 0.3 * fraction, "quotient graph"),
        )
        edges = connected_edges(neighbour_edges(near, self.num_neighbours), near)

        self.n_features_in_ = sensation.shape[1]
        self.target_sensations_ = targets
        self.representation_ = QuotientRepresentation(
            target_sensations=targets,
            kernel_offsets=offsets,
            kernel_q=kernel_q,
            kernel_row=rows,
            kernel_strength=felt[rows],
            kernel_error=error[rows],
            set_distance=distance,
            edges=edges,
            edge_cost=step[edges[:, 0], edges[:, 1]],
            embedding=np.full((self.num_targets, 3), np.nan),
        )
        return self

    def predict(self, sensation: np.ndarray) -> np.ndarray:
        """Tells the kernel of each sensation.

        Args:
            sensation: `(n, S)` N, no row null.

        Returns:
            `(n,)` index of the nearest target sensation.

        Raises:
            ValueError: a sensation has another number of receptors, is null, or is not finite.
        """
        check_is_fitted(self)
        sensation = np.asarray(sensation)
        _check_sensation(sensation)
        if sensation.shape[1] != self.n_features_in_:
            raise ValueError(
                f"sensation has {sensation.shape[1]} receptors, but {self.n_features_in_} were "
                "learned from: give sensations of the same skin."
            )
        return assign(sensation, self.target_sensations_)[0]

    def _check_parameters(self) -> None:
        least = {"num_targets": 2, "max_kernel_size": 1, "num_neighbours": 1, "max_queries": 1}
        for name, lowest in least.items():
            value: Any = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < lowest:
                raise ValueError(f"{name}={value!r}: give a whole number, {lowest} or more.")
        if self.set_distance not in SET_DISTANCES:
            raise ValueError(
                f"set_distance={self.set_distance!r}: choose one of {', '.join(SET_DISTANCES)}."
            )


def _firm(
    sample: KernelSample, felt: np.ndarray, num_kernels: int
) -> tuple[np.ndarray, np.ndarray]:
    """The more strongly felt half of each kernel: its rows of the experience, and offsets.

    A firm touch lies deep in the skin, so that small errors of the motion do not lose contact.
    """
    offsets = sample.offsets(num_kernels)
    order = np.lexsort((-felt[sample.row], sample.kernel))
    rank = np.arange(len(order)) - offsets[sample.kernel]
    sizes = (np.diff(offsets) + 1) // 2
    firm = np.sort(order[rank < sizes[sample.kernel]])
    return sample.row[firm], np.concatenate([[0], np.cumsum(sizes)])


def _check_experience(sensation: np.ndarray, q: np.ndarray, num_targets: int) -> np.ndarray:
    """Refuses experience that cannot be learned from; returns the `(n,)` strength in newtons."""
    felt = _check_sensation(sensation)
    if q.ndim != 2 or q.shape[1] == 0:
        raise ValueError(f"q has shape {q.shape}: give motor configurations as (rows, joints).")
    if len(q) != len(sensation):
        raise ValueError(
            f"q has {len(q)} rows and sensation {len(sensation)}: give one motor configuration "
            "for each sensation."
        )
    _check_numeric("q", q)
    if (bad := np.flatnonzero(~np.isfinite(q).all(axis=1))).size:
        raise ValueError(f"q row {bad[0]} holds NaN or infinity: drop such rows ({bad.size}).")
    if len(sensation) < num_targets:
        raise ValueError(
            f"num_targets={num_targets}, but there are only {len(sensation)} sensations: babble "
            "longer, or ask for fewer targets."
        )
    return felt


def _check_sensation(sensation: np.ndarray) -> np.ndarray:
    """Refuses sensations that no skin gives; returns their `(n,)` strength in newtons."""
    if sensation.ndim != 2 or sensation.shape[1] == 0:
        raise ValueError(
            f"sensation has shape {sensation.shape}: give sensations as (rows, receptors)."
        )
    if len(sensation) == 0:
        raise ValueError("sensation has 0 rows: babble until the finger touches the body.")
    _check_numeric("sensation", sensation)
    felt = strength(sensation).astype(np.float32)
    if (bad := np.flatnonzero(~np.isfinite(felt))).size:
        raise ValueError(
            f"sensation row {bad[0]} holds NaN or infinity: drop such rows ({bad.size})."
        )
    if (lowest := sensation.min()) < 0:
        raise ValueError(
            f"sensation holds {lowest:g}, below 0: give pressures, the sensors' offset removed."
        )
    if (null := np.flatnonzero(felt == 0)).size:
        raise ValueError(
            f"sensation row {null[0]} is null: keep only rows that touch ({null.size} do not)."
        )
    return felt


def _check_numeric(name: str, array: np.ndarray) -> None:
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} holds {array.dtype}: give real numbers.")
