"""Recovers the body from the quotient graph: shape, holes and dimension (paper, section IV)."""

from selftouch_drake.agent.shape.body import Body, DistrustWarning, RecoveredPart, recover
from selftouch_drake.agent.shape.dimension import intrinsic_dimension
from selftouch_drake.agent.shape.embedding import (
    Embedding,
    MisfitWarning,
    classical_embedding,
    stress_embedding,
    unbent_embedding,
    warn_of_misfit,
)
from selftouch_drake.agent.shape.homology import Topology, alpha_persistence, topology
from selftouch_drake.agent.shape.metrics import METRICS, BodyGraph, Metric
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
    "METRICS",
    "Body",
    "BodyGraph",
    "DistrustWarning",
    "Embedding",
    "Metric",
    "MisfitWarning",
    "RecoveredPart",
    "Topology",
    "Torsion",
    "Turns",
    "alpha_persistence",
    "alpha_surface",
    "classical_embedding",
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
    "unbent_embedding",
    "warn_of_misfit",
]
