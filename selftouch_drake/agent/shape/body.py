"""The recovered body: shape, holes and dimension of each of its parts."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.representation.neighbours import geodesics
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.shape.confidence import expected_error, trusted
from selftouch_drake.agent.shape.dimension import LEAST_KERNELS, intrinsic_dimension
from selftouch_drake.agent.shape.embedding import Embedding, warn_of_misfit
from selftouch_drake.agent.shape.homology import Topology, flat, topology
from selftouch_drake.agent.shape.metrics import SHAPE_METRICS


class DistrustWarning(UserWarning):
    """A metric cannot be trusted on a part of the body."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecoveredPart:
    """One part of the body as one metric measures it: n kernels.

    Attributes:
        doubt: why the metric cannot be trusted here, and what was used instead; None if it can.
        kernels: `(n,)` kernels on this part, ascending.
        distances: `(n, n)` geodesic distances along the part, in the metric's unit.
        embedding: layout of the kernels in space, in a pose and unit of this part.
        pieces: `(P, 3)` positions of the pieces of kernels that were cut into pieces.
        topology: its holes; None if not requested, or if all places lie in a plane.
        dimension: its intrinsic dimension; None if not requested, or with fewer than 50 kernels.
    """

    doubt: str | None
    kernels: np.ndarray
    distances: np.ndarray
    embedding: Embedding
    pieces: np.ndarray
    topology: Topology | None
    dimension: float | None

    @property
    def positions(self) -> np.ndarray:
        """`(n, 3)` positions of the kernels."""
        return self.embedding.positions

    @property
    def places(self) -> np.ndarray:
        """`(n + P, 3)` positions of the kernels, then of the pieces: the part without gaps."""
        return np.concatenate([self.embedding.positions, self.pieces])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """The body as one metric measures it: K kernels.

    Attributes:
        metric: its name in `SHAPE_METRICS`.
        parts: the parts of the body, largest first, without fragments.
        num_kernels: K.
    """

    metric: str
    parts: tuple[RecoveredPart, ...]
    num_kernels: int

    @property
    def positions(self) -> np.ndarray:
        """`(K, 3)` positions, in the pose and unit of each kernel's part; NaN in fragments."""
        positions = np.full((self.num_kernels, 3), np.nan)
        for part in self.parts:
            positions[part.kernels] = part.positions
        return positions

    @property
    def distances(self) -> np.ndarray:
        """`(K, K)` geodesic distances; infinite between parts and in fragments."""
        distances = np.full((self.num_kernels,) * 2, np.inf)
        np.fill_diagonal(distances, 0.0)
        for part in self.parts:
            distances[np.ix_(part.kernels, part.kernels)] = part.distances
        return distances

    @property
    def expected_error(self) -> float | None:
        """Expected error of the worst part, as a fraction of its extent; None if not calibrated."""
        if not SHAPE_METRICS[self.metric].calibrated:
            return None
        return max(expected_error(part.embedding) for part in self.parts)

    @property
    def trusted(self) -> bool:
        """Whether shape and holes of all parts can be trusted: see `confidence`."""
        margins = [0.0 if part.topology is None else part.topology.margin for part in self.parts]
        return trusted(self.expected_error, min(margins))

    def embed(self, representation: QuotientRepresentation) -> QuotientRepresentation:
        """Fills the `embedding` of the representation that the body was recovered from."""
        return dataclasses.replace(representation, embedding=self.positions)

    def warn_of_misfit(self) -> None:
        """Warns about each part whose distances do not fit in three dimensions.

        Warns:
            MisfitWarning: see `embedding.warn_of_misfit`.
        """
        for part in self.parts:
            warn_of_misfit(part.embedding)


def recover(
    representation: QuotientRepresentation,
    metric: str,
    *,
    seed: int = 0,
    holes: bool = True,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Body:
    """Recovers each part of the body by a metric chosen by name.

    Args:
        representation: K kernels, 4 or more.
        metric: a name in `SHAPE_METRICS`.
        seed: for metrics that learn; the same seed gives the same bytes.
        holes: also find holes and dimension.
        progress: called with the fraction done.

    Raises:
        ValueError: the metric is unknown, or the representation is too small for it.

    Warns:
        DistrustWarning: the metric cannot be trusted on a part.
    """
    if metric not in SHAPE_METRICS:
        raise ValueError(f"metric {metric!r} is unknown: choose one of {', '.join(SHAPE_METRICS)}")
    num_parts = representation.num_parts
    parts = []
    for number in range(num_parts):

        def of_part(fraction: float, number: int = number) -> None:
            progress((number + fraction) / num_parts)

        kernels = np.flatnonzero(representation.part == number)
        found = _recovered(representation.restricted(kernels), kernels, metric, seed, of_part)
        parts.append(_with_holes(found) if holes else found)
        of_part(1.0)
    return Body(metric=metric, parts=tuple(parts), num_kernels=representation.num_targets)


def _recovered(
    representation: QuotientRepresentation,
    kernels: np.ndarray,
    metric: str,
    seed: int,
    progress: Callable[[float], None],
) -> RecoveredPart:
    """Recovers one part from the representation restricted to its `kernels`."""
    graph = SHAPE_METRICS[metric].graph(
        representation, seed, lambda fraction: progress(0.9 * fraction)
    )
    if graph.doubt is not None:
        warnings.warn(
            f"the {metric} metric cannot be trusted on a part of {len(kernels)} kernels: "
            f"{graph.doubt}",
            DistrustWarning,
            stacklevel=3,
        )
    num_kernels = len(kernels)
    kernel = np.arange(num_kernels) if graph.kernel is None else graph.kernel
    distances = geodesics(graph.edges, graph.length, len(kernel))
    layout = SHAPE_METRICS[metric].layout(graph, distances)
    # The position and the distances of a kernel are the means over its pieces.
    number = np.bincount(kernel, minlength=num_kernels)
    mean = csr_array(
        (1.0 / number[kernel], (kernel, np.arange(len(kernel)))), shape=(num_kernels, len(kernel))
    )
    between = mean @ (mean @ distances).T
    np.fill_diagonal(between, 0.0)
    return RecoveredPart(
        doubt=graph.doubt,
        kernels=kernels,
        distances=between,
        embedding=dataclasses.replace(layout, positions=mean @ layout.positions),
        pieces=layout.positions[number[kernel] > 1],
        topology=None,
        dimension=None,
    )


def _with_holes(part: RecoveredPart) -> RecoveredPart:
    enough = len(part.kernels) >= LEAST_KERNELS
    return dataclasses.replace(
        part,
        topology=None if flat(part.places) else topology(part.places),
        dimension=intrinsic_dimension(part.distances) if enough else None,
    )
