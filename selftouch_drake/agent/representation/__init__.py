"""Learns the quotient representation from experience (paper, sections II, III).

Its scikit-learn estimator is in `representation.estimator`, and not needed to use it.
"""

from selftouch_drake.agent.representation.graphs import (
    DisconnectedWarning,
    geodesics,
    to_networkx,
    without_vectors,
)
from selftouch_drake.agent.representation.kernels import kernel_sensations
from selftouch_drake.agent.representation.learning import learn
from selftouch_drake.agent.representation.quantise import target_sensations
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.representation.touches import felt_kernels

__all__ = [
    "DisconnectedWarning",
    "QuotientRepresentation",
    "felt_kernels",
    "geodesics",
    "kernel_sensations",
    "learn",
    "target_sensations",
    "to_networkx",
    "without_vectors",
]
