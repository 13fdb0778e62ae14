"""Learns from experience, as in the paper, on bodies with several parts, hands and fingers."""

from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.representation.batches import Batches, Map
from selftouch_drake.agent.representation.quotient import QuotientRepresentation, mattering
from selftouch_drake.agent.representation.relevance import touch_modes
from selftouch_drake.agent.representation.reservoir import KernelSample
from selftouch_drake.agent.representation.sorting import Progress, sorted_into_kernels
from selftouch_drake.agent.representation.touches import kernel_parts
from selftouch_drake.quotient.distances import set_distances
from selftouch_drake.quotient.graph import QuotientGraph, combined_distance, quotient_graph
from selftouch_drake.quotient.kernels import KernelSets
from selftouch_drake.quotient.learn import Sizes
from selftouch_drake.quotient.sensations import unlike


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Learned:
    """What was learned from experience.

    Attributes:
        representation: the quotient, and what the agent found beside it.
        component: `(K,)` the component of the quotient graph of each kernel before bridges were
            added; 0 is the largest.
        bridges: `(B, 2)` pairs of kernels i < j, the edges that join components of one part.
    """

    representation: QuotientRepresentation
    component: np.ndarray
    bridges: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Findings:
    """What the agent finds in its experience beside the paper's representation.

    Attributes:
        targets: `(K, S)` target sensations that are kept, unit L2 norm.
        joint_scale: as in `QuotientRepresentation`, as are all that follow.
        kernel_mode: the mode of each touch.
        mode_joints: the joints that matter in each mode.
        overlap: receptors that may feel the same touch.
        part: the part of the body of each kernel.
        num_touches: rows of the experience.
        num_set_aside: touches that were excluded.
    """

    targets: np.ndarray
    joint_scale: np.ndarray
    kernel_mode: np.ndarray
    mode_joints: np.ndarray
    overlap: np.ndarray
    part: np.ndarray
    num_touches: int
    num_set_aside: int


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
    sizes = Sizes(num_targets=num_targets, max_kernel_size=max_kernel_size, seed=seed)
    kernels = sorted_into_kernels(batches, sizes, progress=progress, each=each)
    senses = kernels.senses
    part = kernel_parts(kernels.targets, senses.together.near)
    progress(0.3, "joints that matter")
    double, mode_seed = senses.together.double, sizes.seeds(3)[2]
    mode, mode_joints = touch_modes(kernels.sets, kernels.targets, part, double, seed=mode_seed)
    sets = kernels.sets.at(mattering(kernels.sets.x, mode, mode_joints))
    distance = set_distances(
        sets,
        rough=unlike(kernels.targets),
        progress=lambda fraction: progress(0.6 + 0.4 * fraction, "set distances"),
    )
    graph = joined(sets, kernels.sample, distance, kernels.targets, part)
    found = Findings(
        targets=senses.as_kept(kernels.targets, kernels.total),
        joint_scale=kernels.joint_scale,
        kernel_mode=mode,
        mode_joints=mode_joints,
        overlap=senses.together.overlap,
        part=part,
        num_touches=kernels.num_touches,
        num_set_aside=kernels.num_set_aside,
    )
    learned = represented(sets, kernels.sample, distance, graph, found)
    progress(1.0, "quotient graph")
    return learned


def joined(
    sets: KernelSets,
    sample: KernelSample,
    distance: np.ndarray,
    targets: np.ndarray,
    part: np.ndarray,
) -> QuotientGraph:
    """The quotient graph, whose edges join kernels of one part.

    The sets are those of the rows of the sample (columns q, strength, error), scaled, mu, with the
    joints that matter; `(K, K)` mu is their distance, targets are `(K, S)` and parts `(K,)`.
    """
    combined = combined_distance(distance, targets)
    combined[part[:, None] != part] = np.inf
    return quotient_graph(sets, sample.columns["strength"], combined)


def represented(
    sets: KernelSets,
    sample: KernelSample,
    distance: np.ndarray,
    graph: QuotientGraph,
    found: Findings,
) -> Learned:
    """What was learned, from its pieces; arguments are as in `joined`."""
    representation = QuotientRepresentation(
        target_sensations=found.targets,
        kernel_offsets=sets.offsets,
        kernel_q=sample.columns["q"],
        kernel_row=sample.row,
        kernel_strength=sample.columns["strength"],
        kernel_error=sample.columns["error"],
        kernel_mode=found.kernel_mode,
        mode_joints=found.mode_joints,
        joint_scale=found.joint_scale,
        overlap=found.overlap,
        part=found.part,
        set_distance=distance,
        edges=graph.edges,
        edge_cost=graph.cost,
        num_touches=found.num_touches,
        num_set_aside=found.num_set_aside,
    )
    return Learned(representation=representation, component=graph.component, bridges=graph.bridges)
