"""A representation beside the shape that was recovered from it."""

from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np

from selftouch_drake.agent.representation.quotient import QuotientRepresentation


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EmbeddedRepresentation(QuotientRepresentation):
    """What the agent learned, and where its kernels lie on the body that it recovered.

    `learn` makes a representation, whole; a body is recovered from it, and its `embed` makes this.

    Attributes:
        embedding: `(K, 3)` position of each kernel in the recovered shape of its part, in a pose
            and unit of that part; NaN in fragments.

    Raises:
        ValueError: as `QuotientRepresentation`.
    """

    by_kernel: ClassVar[tuple[str, ...]] = (*QuotientRepresentation.by_kernel, "embedding")

    embedding: np.ndarray

    def __post_init__(self) -> None:
        QuotientRepresentation.__post_init__(self)
        self.check_arrays({"embedding": (self.num_targets, 3)})


def embedded(
    representation: QuotientRepresentation, positions: np.ndarray
) -> EmbeddedRepresentation:
    """The same representation, with `(K, 3)` positions beside it."""
    names = [field.name for field in fields(QuotientRepresentation)]
    learned = {name: getattr(representation, name) for name in names}
    return EmbeddedRepresentation(**learned, embedding=positions)
