"""Recovers the body from the quotient graph: shape, holes and dimension (paper, section IV)."""

from selftouch_drake.agent.shape.dimension import intrinsic_dimension
from selftouch_drake.agent.shape.embedding import Embedding, curvature_corrected_mds
from selftouch_drake.agent.shape.homology import Topology, fitted_surface, topology
from selftouch_drake.agent.shape.metrics import SHAPE_METRICS
from selftouch_drake.agent.shape.recovery import RecoveredBody, RecoveredPart, recover

__all__ = [
    "SHAPE_METRICS",
    "Embedding",
    "RecoveredBody",
    "RecoveredPart",
    "Topology",
    "curvature_corrected_mds",
    "fitted_surface",
    "intrinsic_dimension",
    "recover",
    "topology",
]
