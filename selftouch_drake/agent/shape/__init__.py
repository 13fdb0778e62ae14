"""What the quotient graph tells of the body: its shape, topology and dimension (paper, IV)."""

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
from selftouch_drake.agent.shape.metrics import (
    METRICS,
    BodyGraph,
    Metric,
    RecoveredBody,
    embed_representation,
    recover,
)
from selftouch_drake.agent.shape.quotient_map import quotient_coordinates
from selftouch_drake.agent.shape.surface import fitted_surface
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
    "BodyGraph",
    "Embedding",
    "Metric",
    "MisfitWarning",
    "RecoveredBody",
    "Topology",
    "Torsion",
    "Turns",
    "alpha_persistence",
    "classical_embedding",
    "double_cover",
    "embed_representation",
    "fitted_surface",
    "intrinsic_dimension",
    "landmarks",
    "quotient_coordinates",
    "recover",
    "stress_embedding",
    "topology",
    "torsion",
    "turns",
    "unbent_embedding",
    "warn_of_misfit",
]
