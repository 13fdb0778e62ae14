"""What the quotient graph tells of the body: its shape, topology and dimension (paper, IV)."""

from selftouch_drake.shape.dimension import intrinsic_dimension
from selftouch_drake.shape.embedding import (
    METRICS,
    Embedding,
    body_distances,
    classical_embedding,
    embed,
    embed_representation,
    stress_embedding,
)
from selftouch_drake.shape.homology import Topology, alpha_persistence, topology
from selftouch_drake.shape.surface import fitted_surface

__all__ = [
    "METRICS",
    "Embedding",
    "Topology",
    "alpha_persistence",
    "body_distances",
    "classical_embedding",
    "embed",
    "embed_representation",
    "fitted_surface",
    "intrinsic_dimension",
    "stress_embedding",
    "topology",
]
