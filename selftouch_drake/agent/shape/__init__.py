"""Recovers the body from the quotient graph: shape, holes and dimension (paper, section IV)."""

from selftouch_drake.agent.shape.body import (
    Body,
    DistrustWarning,
    MisfitWarning,
    RecoveredPart,
    recover,
)
from selftouch_drake.agent.shape.dimension import (
    intrinsic_dimension,
    skin_dimension,
    space_dimension,
)
from selftouch_drake.agent.shape.embedding import (
    Embedding,
    classical_embedding,
    curvature_corrected_mds,
    stress_embedding,
)
from selftouch_drake.agent.shape.homology import Topology, alpha_persistence, topology
from selftouch_drake.agent.shape.metrics import SHAPE_METRICS, BodyGraph, ShapeMetric
from selftouch_drake.agent.shape.quotient_map import quotient_coordinates
from selftouch_drake.agent.shape.surface import fitted_line, fitted_surface, rolled_surface

__all__ = [
    "SHAPE_METRICS",
    "Body",
    "BodyGraph",
    "DistrustWarning",
    "Embedding",
    "MisfitWarning",
    "RecoveredPart",
    "ShapeMetric",
    "Topology",
    "alpha_persistence",
    "classical_embedding",
    "curvature_corrected_mds",
    "fitted_line",
    "fitted_surface",
    "intrinsic_dimension",
    "quotient_coordinates",
    "recover",
    "rolled_surface",
    "skin_dimension",
    "space_dimension",
    "stress_embedding",
    "topology",
]
