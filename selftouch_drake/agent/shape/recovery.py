"""The recovered body: shape, holes and dimension of each of its parts."""

import dataclasses
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.representation.embedded import EmbeddedRepresentation, embedded
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.shape.metrics import SHAPE_METRICS, DoubtedGraph
from selftouch_drake.quotient.body import Shape, holes_and_dimension, layout_and_space, skin_of
from selftouch_drake.quotient.dimension import MISFIT
from selftouch_drake.quotient.holes import neighbour_spacings
from selftouch_drake.quotient.layout import Embedding
from selftouch_drake.quotient.lengths import BodyGraph

#: Logarithm of the expected shape error: constant, and slopes in the logarithms of stress,
#: unevenness and number of kernels. Calibrated by least squares on the bodies, skins, joints,
#: touches and targets of `benchmarks/accuracy/trust.py confidence`.
_CONSTANT, _SLOPES = 2.48, (0.15, 1.21, -0.37)

#: A shape is trusted below this expected error and from this margin of its holes on.
MOST_ERROR, LEAST_MARGIN = 0.04, 4.0

#: Neighbours from which the spacing around a kernel is measured, as on a surface.
_NEIGHBOURS = 6


class DistrustWarning(UserWarning):
    """A metric, or the layout, cannot be trusted on a part of the body."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecoveredPart(Shape):
    """One part of the body as one metric measures it: n kernels.

    Attributes:
        doubt: why the metric cannot be trusted here, and what was used instead; None if it can.
        kernels: `(n,)` kernels on this part, ascending.
        pieces: `(P, d)` positions of the pieces of kernels that were cut into pieces; holes are
            those of kernels and pieces.
    """

    doubt: str | None
    kernels: np.ndarray
    pieces: np.ndarray

    @property
    def places(self) -> np.ndarray:
        """`(n + P, d)` positions of the kernels, then of the pieces: the part without gaps."""
        return np.concatenate([self.positions, self.pieces])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecoveredBody:
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
        """`(K, 3)` positions, in the pose and unit of each kernel's part; NaN in fragments.

        A part in a plane has 0 as its third coordinate.
        """
        positions = np.full((self.num_kernels, 3), np.nan)
        for part in self.parts:
            positions[part.kernels] = 0.0
            positions[part.kernels, : part.positions.shape[1]] = part.positions
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
        """Expected error of the worst part, as a fraction of its extent; None if not calibrated.

        It is calibrated on surfaces. Of a line, distances show the length alone, and no error.
        """
        has_line = any(part.skin_dimension == 1 for part in self.parts)
        if has_line or not SHAPE_METRICS[self.metric].calibrated:
            return None
        return max(expected_error(part.embedding) for part in self.parts)

    @property
    def trusted(self) -> bool:
        """Whether shape and holes of all parts can be trusted."""
        margins = [0.0 if part.topology is None else part.topology.margin for part in self.parts]
        return trusted(self.expected_error, min(margins))

    def embed(self, representation: QuotientRepresentation) -> EmbeddedRepresentation:
        """The representation that the body was recovered from, with these positions beside it."""
        return embedded(representation, self.positions)

    def warn_of_misfit(self) -> None:
        """Warns about each part whose distances do not fit in three dimensions.

        Geodesic distances on a closed surface never fit exactly, so the fourth eigenvalue is never
        0. A large one means shortcuts, wrong lengths, or a quotient space that is not a body; where
        a fourth dimension takes the misfit away, the part is said to need it.

        Warns:
            DistrustWarning: the fourth eigenvalue is above 0.15; the text gives it.
        """
        for part in self.parts:
            misfit = part.embedding.fourth_eigenvalue
            if misfit > MISFIT:
                remedy = (
                    "it needs a fourth dimension, and is laid out in three"
                    if part.space_dimension == 4
                    else "babble longer, or choose another metric"
                )
                warnings.warn(
                    f"the recovered body does not fit in space: the fourth eigenvalue is "
                    f"{misfit:.0%} of the first, above {MISFIT:.0%}: {remedy}",
                    DistrustWarning,
                    stacklevel=2,
                )


def expected_error(layout: Embedding) -> float:
    """Expected root mean square error of an unbent layout, as a fraction of its extent (naive).

    Inconsistent distances along the body leave stress. And target sensations are evenly spaced in
    sensation, so kernels are unevenly spaced where lengths are wrong, or where the skin is bad.
    Both are dimensionless, and so comparable between bodies and skins. Few kernels show little of
    a shape. The layout is of `curvature_corrected_mds`; others have higher stress.
    """
    # The floor is needed for layouts of few kernels, without any stress.
    found = layout.stress, unevenness(layout.positions), len(layout.positions)
    return float(np.exp(_CONSTANT + np.log(np.maximum(found, 1e-6)) @ _SLOPES))


def trusted(error: float | None, margin: float) -> bool:
    """Whether a shape with this expected error, and holes of this smallest margin, is trusted."""
    return bool(error is not None and error < MOST_ERROR and margin >= LEAST_MARGIN)


def unevenness(positions: np.ndarray) -> float:
    """Standard deviation of the logarithm of the spacing around each of the `(n, d)` positions."""
    return float(np.log(neighbour_spacings(positions, _NEIGHBOURS)).std())


def recover(
    representation: QuotientRepresentation,
    metric: str,
    *,
    seed: int = 0,
    holes: bool = True,
    progress: Callable[[float], None] = lambda fraction: None,
) -> RecoveredBody:
    """Recovers each part of the body by a metric chosen by name.

    The representation has 5 kernels or more. The seed is for metrics that learn; the same one gives
    the same bytes. Holes and dimension are found if asked for.

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
        part = representation.restricted(kernels)
        skin = skin_of(part)
        graph = SHAPE_METRICS[metric].graph(part, skin, seed, of_part)
        doubt = graph.doubt if isinstance(graph, DoubtedGraph) else None
        if doubt is not None:
            warnings.warn(
                f"the {metric} metric cannot be trusted on a part of {len(kernels)} kernels: "
                f"{doubt}",
                DistrustWarning,
                stacklevel=2,
            )
        parts.append(_recovered_part(kernels, graph, skin, metric, doubt, holes))
        of_part(1.0)
    return RecoveredBody(metric=metric, parts=tuple(parts), num_kernels=representation.num_targets)


def _recovered_part(
    kernels: np.ndarray, graph: BodyGraph, skin: int, metric: str, doubt: str | None, holes: bool
) -> RecoveredPart:
    """A part of the body, of kernels `(n,)`, from its graph."""
    kernel, distances = graph.kernel, graph.geodesics(graph.length)
    layout, space = layout_and_space(graph.edges, distances, skin, SHAPE_METRICS[metric].layout)
    # The position and the distances of a kernel are the means over its pieces.
    num_pieces = np.bincount(kernel)[kernel]
    mean = csr_array((1.0 / num_pieces, (kernel, np.arange(len(kernel)))))
    positions, pieces = mean @ layout.positions, layout.positions[num_pieces > 1]
    between = mean @ (mean @ distances).T
    np.fill_diagonal(between, 0.0)
    found, dimension = None, None
    if holes:
        found, dimension = holes_and_dimension(np.concatenate([positions, pieces]), between, skin)
    return RecoveredPart(
        doubt=doubt,
        kernels=kernels,
        distances=between,
        skin_dimension=skin,
        space_dimension=space,
        embedding=dataclasses.replace(layout, positions=positions),
        pieces=pieces,
        topology=found,
        dimension=dimension,
    )
