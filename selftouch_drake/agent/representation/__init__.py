"""Learns the quotient representation from experience (paper, sections II, III).

The estimator, which needs scikit-learn, is imported on first use.
"""

from typing import TYPE_CHECKING, Any

from selftouch_drake.agent.representation.graphs import to_networkx, without_vectors
from selftouch_drake.agent.representation.kernels import kernel_sensations
from selftouch_drake.agent.representation.learning import learn
from selftouch_drake.agent.representation.neighbours import DisconnectedWarning, geodesics
from selftouch_drake.agent.representation.quantise import target_sensations
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.representation.touches import felt_kernels

if TYPE_CHECKING:
    from selftouch_drake.agent.representation.estimator import QuotientLearner

__all__ = [
    "DisconnectedWarning",
    "QuotientLearner",
    "QuotientRepresentation",
    "felt_kernels",
    "geodesics",
    "kernel_sensations",
    "learn",
    "target_sensations",
    "to_networkx",
    "without_vectors",
]


def __getattr__(name: str) -> Any:
    if name != "QuotientLearner":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from selftouch_drake.agent.representation.estimator import QuotientLearner

    return QuotientLearner
