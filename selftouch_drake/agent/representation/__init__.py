"""What the agent makes of its experience: the quotient representation (paper, sections II, III)."""

from selftouch_drake.agent.representation.graph import (
    DisconnectedWarning,
    complete_edges,
    component_labels,
    connected_edges,
    geodesics,
    locally_scaled,
    neighbour_edges,
    quotient_pseudo_metric,
    to_networkx,
    write_graphml,
)
from selftouch_drake.agent.representation.kernels import KernelReservoir, KernelSample
from selftouch_drake.agent.representation.learner import QuotientLearner
from selftouch_drake.agent.representation.quantise import assign, target_sensations
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.representation.set_distances import (
    SET_DISTANCES,
    SetDistance,
    set_distances,
)

__all__ = [
    "SET_DISTANCES",
    "DisconnectedWarning",
    "KernelReservoir",
    "KernelSample",
    "QuotientLearner",
    "QuotientRepresentation",
    "SetDistance",
    "assign",
    "complete_edges",
    "component_labels",
    "connected_edges",
    "geodesics",
    "locally_scaled",
    "neighbour_edges",
    "quotient_pseudo_metric",
    "set_distances",
    "target_sensations",
    "to_networkx",
    "write_graphml",
]
