"""Learns the quotient representation from experience (paper, sections II, III).

The estimator, which needs scikit-learn, is imported on first use.
"""

from typing import TYPE_CHECKING, Any

from selftouch_drake.agent.representation.graphs import (
    step_links,
    surface_edges,
    to_networkx,
    without_vectors,
)
from selftouch_drake.agent.representation.joints import joint_scale
from selftouch_drake.agent.representation.kernels import (
    KernelReservoir,
    KernelSample,
    KernelSets,
    kernel_sensations,
)
from selftouch_drake.agent.representation.learning import Batches, Learned, learn
from selftouch_drake.agent.representation.neighbours import (
    DisconnectedWarning,
    complete_edges,
    component_labels,
    connected_edges,
    geodesics,
    locally_scaled,
    neighbour_edges,
)
from selftouch_drake.agent.representation.quantise import assign, target_sensations
from selftouch_drake.agent.representation.quotient import LEAST_KERNELS, QuotientRepresentation
from selftouch_drake.agent.representation.set_distances import (
    SET_DISTANCES,
    LinkedNearest,
    SetDistance,
    linked_nearest,
    set_distances,
)
from selftouch_drake.agent.representation.touches import felt_kernels

if TYPE_CHECKING:
    from selftouch_drake.agent.representation.estimator import QuotientLearner

__all__ = [
    "LEAST_KERNELS",
    "SET_DISTANCES",
    "Batches",
    "DisconnectedWarning",
    "KernelReservoir",
    "KernelSample",
    "KernelSets",
    "Learned",
    "LinkedNearest",
    "QuotientLearner",
    "QuotientRepresentation",
    "SetDistance",
    "assign",
    "complete_edges",
    "component_labels",
    "connected_edges",
    "felt_kernels",
    "geodesics",
    "joint_scale",
    "kernel_sensations",
    "learn",
    "linked_nearest",
    "locally_scaled",
    "neighbour_edges",
    "set_distances",
    "step_links",
    "surface_edges",
    "target_sensations",
    "to_networkx",
    "without_vectors",
]


def __getattr__(name: str) -> Any:
    if name != "QuotientLearner":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from selftouch_drake.agent.representation.estimator import QuotientLearner

    return QuotientLearner
