"""Shape metrics by name: which kernels are neighbours, how far apart, how to lay them out.

Each metric turns the representation of one part of the body into a graph along its surface.
Distances are shortest paths on this graph.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.shape.cells import Cells, cut_wide_cells
from selftouch_drake.agent.shape.fields import corrected_lengths
from selftouch_drake.agent.shape.overlaps import overlap_lengths
from selftouch_drake.agent.shape.quotient_map import quotient_coordinates
from selftouch_drake.agent.shape.rings import one_ring
from selftouch_drake.quotient import lengths
from selftouch_drake.quotient.graph import connected_edges, neighbour_edges
from selftouch_drake.quotient.kernels import KernelSets
from selftouch_drake.quotient.layout import (
    Embedding,
    classical_embedding,
    curvature_corrected_mds,
    one_thread,
    stress_embedding,
)
from selftouch_drake.quotient.lengths import BodyGraph
from selftouch_drake.quotient.sensations import angles, unlike

Progress = Callable[[float], None]

#: Most networks that the learned metric trains. The second first learns to predict sensations.
_MOST_NETWORKS = 2

#: A learned map is rejected if more than this share of its edges join kernels that feel nothing in
#: common, since neighbours on a body share receptors: below 0.01 where a map was right (six
#: joints), 0.2 to 0.9 where it was not (nine joints and more).
_MOST_UNLIKE = 0.015

#: No network is trained if more than this share of the touches feel nothing in common with the
#: nearest one in motor space: 0.05 with six joints, 0.16 with seven, where a map can be learned;
#: 0.28 to 0.34 with nine and 30,000 touches, where each network was rejected. Looked at are the
#: neighbours of some touches, among the most that a search tree takes in a moment.
_MOST_STRANGE, _NUM_LOOKED_AT, _MOST_AROUND = 0.25, 2000, 200_000

#: A bad map folds if it is constant on kernels, up to their width: of the variance of its third
#: best direction, 2 to 4 over K is within K kernels. Then another network may do better. Where all
#: failed it was 0.06 and more (nothing is constant), or 0 (touches are learned by heart).
_LEAST_WITHIN, _MOST_WITHIN, _ALWAYS_WITHIN = 0.3, 6.0, 0.05

#: A map counts only if paths measured in it and by sensation, with rims, differ by less than this
#: share (standard deviation): 0.03 to 0.06 on bodies with good maps, whole and worn; 0.08 to 0.12
#: on an infant's torso and head, whose errors by maps are two to five times as large as without.
_MOST_APART = 0.07

#: Corrected lengths run along the skin, which the finger cuts short at a rim. An edge is compared
#: with so many rings of neighbours: a rim is narrow, but a bad network stretches wide parts of the
#: body. It crosses a rim if it is shorter than around by more than the noise, times this factor.
_RINGS, _OVER_NOISE = 2, 1.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DoubtedGraph(BodyGraph):
    """A graph of another metric, used because the one that was asked for cannot be trusted.

    Attributes:
        doubt: what could not be trusted, and what was used instead.
    """

    doubt: str


@dataclass(frozen=True, slots=True)
class ShapeMetric:
    """A way to measure a part of the body.

    Attributes:
        graph: builds the graph from a representation, the dimension of the skin, a seed, and a
            function that is called with the fraction done.
        layout: lays out N nodes from the edges of the graph, `(N, N)` shortest paths on it, and the
            dimension of the space.
        calibrated: whether `recovery.expected_error` is calibrated for its layouts.
    """

    graph: Callable[[QuotientRepresentation, int, int, Progress], BodyGraph]
    layout: Callable[[np.ndarray, np.ndarray, int], Embedding]
    calibrated: bool = True


def literal(
    representation: QuotientRepresentation, skin: int, seed: int, progress: Progress
) -> BodyGraph:
    """As in `quotient.lengths.literal`."""
    return lengths.literal(representation, progress)


def motor(representation: QuotientRepresentation, *_: object) -> BodyGraph:
    """Set distances between neighbours, each scaled to the spacing around it."""
    edges = representation.edges
    length = locally_scaled(representation.set_distance[edges[:, 0], edges[:, 1]], edges)
    return BodyGraph(edges=edges, length=length, kernel=np.arange(representation.num_targets))


def sensorimotor(representation: QuotientRepresentation, skin: int, *_: object) -> BodyGraph:
    """As in `quotient.lengths.sensorimotor`, corrected for where the receptors lie.

    It is not corrected where no model of the receptors explains what is felt.
    """
    graph = lengths.sensorimotor(representation)
    targets = representation.target_sensations
    corrected = corrected_lengths(targets, graph.kernel, graph.edges, graph.length, skin)
    return graph if corrected is None else replace(graph, length=corrected)


@one_thread
def learned(
    representation: QuotientRepresentation, skin: int, seed: int, progress: Progress
) -> BodyGraph:
    """Neighbours in a quotient map learned from motor kernels; lengths from map and sensations.

    Lengths from sensations are corrected for where the receptors lie, and shortened where the map
    shows a rim. If both measures differ everywhere, or the map may fold, another network is
    trained. If no network finds neighbours and lengths, the `sensorimotor` metric is used; where
    touches show that none can, none is trained. Where readings say only which receptors feel a
    touch, neighbours are those of the quotient graph, and lengths come from overlaps of receptors.
    """
    by_overlap = overlap_lengths(representation, skin)
    if by_overlap is not None:
        kernel = np.arange(representation.num_targets)
        return BodyGraph(edges=representation.edges, length=by_overlap, kernel=kernel)

    def of_network(number: int) -> Progress:
        return lambda fraction: progress((number + fraction) / _MOST_NETWORKS)

    targets, sets = representation.target_sensations, representation.kernel_sets
    are_unlike = unlike(targets)
    strange, share_unlike, apart = _strange(sets, are_unlike), 1.0, np.inf
    for number in range(_MOST_NETWORKS if strange <= _MOST_STRANGE else 0):
        coordinates = quotient_coordinates(
            sets,
            seed=seed + number,
            target_sensations=targets if number else None,
            progress=of_network(number),
        )
        graph = between_cells(coordinates, skin)
        share = float(are_unlike[*graph.ends.T].mean())
        share_unlike = min(share, share_unlike)
        if share > _MOST_UNLIKE:
            if _may_fold(coordinates):
                continue
            break
        length = _with_rims(_felt_lengths(targets, graph, skin), graph, representation.set_distance)
        apart = min(apart, _disagreement(graph, length))
        if apart < _MOST_APART:
            return replace(graph, length=length)
    doubt = f"{share_unlike:.0%} of the neighbours in the learned map feel nothing in common"
    if strange > _MOST_STRANGE:
        doubt = f"{strange:.0%} of the touches feel nothing in common with the nearest one"
    elif np.isfinite(apart):
        doubt = f"lengths from the learned map and from sensations differ by {apart:.1%}"
    graph = sensorimotor(representation, skin)
    return DoubtedGraph(
        edges=graph.edges,
        length=graph.length,
        kernel=graph.kernel,
        doubt=f"{doubt}; the sensorimotor metric is used instead",
    )


def _strange(sets: KernelSets, are_unlike: np.ndarray) -> float:
    """Share of the touches that feel nothing in common with the nearest one in motor space."""
    if sets.sizes.max() < 2:
        return 0.0  # the map is refused with a reason of its own
    around = slice(None, None, -(-len(sets.x) // _MOST_AROUND))
    x, kernel = sets.x[around], sets.kernel[around]
    rows = np.linspace(0, len(x) - 1, min(_NUM_LOOKED_AT, len(x))).astype(int)
    nearest = KDTree(x).query(x[rows], k=[2])[1][:, 0]
    return float(are_unlike[kernel[rows], kernel[nearest]].mean())


def _may_fold(coordinates: KernelSets) -> bool:
    """Whether a map is constant on kernels, up to their width: if it is bad, it folds."""
    x, sizes = coordinates.x[:, 2], coordinates.sizes
    mean = np.add.reduceat(x, coordinates.offsets[:-1]) / sizes
    squares = np.square(x - mean[coordinates.kernel])
    within = np.mean(np.add.reduceat(squares, coordinates.offsets[:-1]) / sizes)
    share, num_kernels = within / (within + mean.var()), len(sizes)
    most = max(_MOST_WITHIN / num_kernels, _ALWAYS_WITHIN)
    return bool(_LEAST_WITHIN / num_kernels < share < most)


def _felt_lengths(targets: np.ndarray, graph: BodyGraph, skin: int) -> np.ndarray:
    """`(E,)` lengths from sensations, scaled to match those of the graph.

    They are corrected for where the receptors lie, if a model of the receptors explains what is
    felt; if not, they are angles. Pieces of one kernel share a target sensation: between them,
    lengths are those of the graph.
    """
    one = graph.ends[:, 0] == graph.ends[:, 1]
    felt = angles(targets, graph.ends)
    felt = np.where(one, graph.length, felt * graph.length[~one].mean() / felt[~one].mean())
    first = np.sqrt(felt * graph.length)
    corrected = corrected_lengths(targets, graph.kernel, graph.edges, first, skin)
    if corrected is None:
        return felt
    return np.where(one, graph.length, corrected * first[~one].mean() / corrected[~one].mean())


def _with_rims(felt: np.ndarray, graph: BodyGraph, set_distance: np.ndarray) -> np.ndarray:
    """`(E,)` lengths from sensations, shortened where the finger cuts short.

    Both the map and the `(K, K)` set distances show it, and err independently: what they share is
    taken for rims, the rest for noise. Their mean is shortened by a threshold that is the variance
    of the noise over the standard deviation of the rims (BayesShrink: Chang, Yu, Vetterli 2000).
    """
    by_sets = set_distance[*graph.ends.T]
    # Pieces of one kernel have no distance between sets.
    by_sets = np.where(by_sets > 0, by_sets, felt * np.median(by_sets / felt))
    # Less their means over the rings of neighbours around both ends.
    shorter = np.log([graph.length / felt, by_sets / felt])
    ring, ends = one_ring(graph.edges, len(graph.kernel)), graph.edges.T.ravel()
    for value in shorter:
        total, number = np.bincount(ends, np.r_[value, value]), np.bincount(ends)
        for _ in range(_RINGS):
            total, number = ring @ total, ring @ number
        value -= (total / number)[graph.edges].mean(axis=1)
    mean, rims = shorter.mean(axis=0), np.cov(shorter)[0, 1]
    if rims <= 0:
        return felt
    noise = np.var(shorter[0] - shorter[1]) / 4  # of the mean
    threshold = _OVER_NOISE * noise / np.sqrt(rims)
    return felt * np.exp(np.minimum(mean + threshold, 0.0))


def _disagreement(graph: BodyGraph, felt: np.ndarray) -> float:
    """Standard deviation of the log ratio of geodesic distances by two edge lengths.

    Paths shorter than half the median are excluded: on them, random errors do not average out.
    """
    pairs = np.triu_indices(len(graph.kernel), 1)
    by_map, by_feel = (graph.geodesics(length)[pairs] for length in (graph.length, felt))
    long = by_feel > np.median(by_feel) / 2
    return float(np.log(by_map[long] / by_feel[long]).std())


def between_cells(coordinates: KernelSets, skin: int) -> BodyGraph:
    """Neighbours and lengths in coordinates of a quotient map, in widths of the cells."""
    cells = Cells.of(coordinates, skin)
    pieces, kernel = cut_wide_cells(coordinates, cells)
    if len(kernel) > len(cells.mean):
        cells = Cells.of(pieces, skin)
    distance = cells.distances()
    edges = connected_edges(neighbour_edges(distance), distance)
    length = locally_scaled(cells.lengths(edges), edges)
    return BodyGraph(edges=edges, length=length, kernel=kernel)


def locally_scaled(length: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """`(E,)` lengths of `(E, 2)` edges in units of the spacing around their ends, about 1.

    They are `d / sqrt(s_i s_j)`; the spacing `s_i` is the mean length of the edges at kernel i.
    Cells are evenly spaced in sensation, so neighbours should be equally far apart, however
    redundant the arm is there.
    """
    i, j = edges.T
    total = np.bincount(edges.ravel(), np.repeat(length, 2))
    spacing = total / np.maximum(np.bincount(edges.ravel()), 1)
    return length / np.sqrt(spacing[i] * spacing[j])


def _classical(edges: np.ndarray, distances: np.ndarray, dimension: int) -> Embedding:
    return classical_embedding(distances, dimension)


def _by_stress(edges: np.ndarray, distances: np.ndarray, dimension: int) -> Embedding:
    return stress_embedding(distances, dimension)


#: The metrics by name.
SHAPE_METRICS: dict[str, ShapeMetric] = {
    "literal": ShapeMetric(literal, _classical, calibrated=False),
    "motor": ShapeMetric(motor, _by_stress, calibrated=False),
    "learned": ShapeMetric(learned, curvature_corrected_mds),
    "sensorimotor": ShapeMetric(sensorimotor, curvature_corrected_mds),
}
