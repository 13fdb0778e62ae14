"""Recovers the body from the quotient graph: shape, holes and dimension (paper, section IV)."""

from selftouch_drake.agent.shape.body import Body, DistrustWarning, RecoveredPart, recover
from selftouch_drake.agent.shape.dimension import intrinsic_dimension
from selftouch_drake.agent.shape.embedding import (
    Embedding,
    MisfitWarning,
    classical_embedding,
    curvature_corrected_mds,
    stress_embedding,
    warn_of_misfit,
)
from selftouch_drake.agent.shape.homology import Topology, alpha_persistence, topology
from selftouch_drake.agent.shape.metrics import SHAPE_METRICS, BodyGraph, ShapeMetric
from selftouch_drake.agent.shape.quotient_map import quotient_coordinates
from selftouch_drake.agent.shape.surface import alpha_surface, fitted_surface, rolled_surface
from selftouch_drake.agent.shape.unrolling import (
    Torsion,
    Turns,
    double_cover,
    landmarks,
    torsion,
    turns,
)

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
    "Torsion",
    "Turns",
    "alpha_persistence",
    "alpha_surface",
    "classical_embedding",
    "curvature_corrected_mds",
    "double_cover",
    "fitted_surface",
    "intrinsic_dimension",
    "landmarks",
    "quotient_coordinates",
    "recover",
    "rolled_surface",
    "stress_embedding",
    "topology",
    "torsion",
    "turns",
    "warn_of_misfit",
]
