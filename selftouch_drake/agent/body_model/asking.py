"""Asks for the body model of what an agent has learned."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.body_model.felt_twice import felt_twice, without_last
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.quotient.threads import mapped

if TYPE_CHECKING:
    from selftouch_drake.agent.body_model.fit import Each


def ask_for_model(
    representation: QuotientRepresentation,
    sensation: csr_array | None,
    *,
    joint_names: Sequence[str] | None = None,
    seed: int = 0,
    progress: Callable[[float, str], None] = lambda fraction, doing: None,
    each: "Each" = mapped,
) -> BodyModel:
    """Asks whether the joints turn or slide something rigid.

    Args:
        representation: what was learned; it is only read.
        sensation: `(R, S)` the sensation at each stored motor configuration; without it, receptors
            have no places.
        joint_names: `(J,)` carried along; numbers by default.
        seed: of the fit.
        progress: called with the fraction done and what is being done.
        each: maps starts of the fit, by default over all cores of this machine.

    Returns:
        The model with its judgement; it may be rejected.
    """
    # Whoever only reads a model needs no fit.
    from selftouch_drake.agent.body_model.find import find_body_model

    names = list(joint_names or [f"joint_{n}" for n in range(representation.kernel_q.shape[1])])
    q, kernel = representation.kernel_q.astype(float), kernel_of_rows(representation)
    left_out, added = pressing_two(representation), 0
    # Sums in another order, by another number of threads, would give other bytes.
    with threadpool_limits(limits=1, user_api="blas"):
        if sensation is not None and left_out.any():
            hands = felt_twice(representation, kernel, sensation)
            if hands is not None:
                left_out, added = hands.left_out, hands.along.shape[1]
                q = np.hstack([q, hands.along])
        model = find_body_model(
            q,
            sensation,
            kernel,
            representation.part,
            joint_names=[*names, *(f"{names[0]} along {n}" for n in range(added))],
            double=left_out,
            sequence=representation.kernel_row,
            along=added,
            seed=seed,
            progress=progress,
            each=each,
        )
    return without_last(model, added) if added else model


def kernel_of_rows(representation: QuotientRepresentation) -> np.ndarray:
    """`(R,)` the target sensation of each stored motor configuration."""
    sizes = np.diff(representation.kernel_offsets)
    return np.repeat(np.arange(representation.num_targets), sizes)


def pressing_two(representation: QuotientRepresentation) -> np.ndarray:
    """`(R,)` bool, touches of two parts at once, each of which has a row."""
    _, number, count = np.unique(representation.kernel_row, return_inverse=True, return_counts=True)
    return count[number] > 1
