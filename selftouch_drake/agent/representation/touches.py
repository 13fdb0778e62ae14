"""Several touches in one sensation: the parts of the skin that press alone, told apart (naive).

The agent does not know where its receptors are. But those whose fields overlap feel the same
touches again and again, and those far apart do not: what is felt together most often is one place.
A sensation then falls into parts that no overlap joins, one a finger that presses.
"""

from __future__ import annotations

import numpy as np

from selftouch_drake.agent.representation.quantise import strength

#: Receptors count as overlapping if they feel together in this share of the touches of the rarer of
#: the two. Measured on a sphere with 100 receptors, fingers a quarter turn apart: at 0.4 no touch
#: of one finger was parted, and 73 % of those of two were; at 0.2 it was 28 %, as receptors between
#: two fingers join them; at 0.5 some touches of one finger fell apart.
_LEAST_SHARED = 0.4


def overlapping(sensation: np.ndarray, least_shared: float = _LEAST_SHARED) -> np.ndarray:
    """Finds the receptors that overlap, from what they feel together.

    Args:
        sensation: `(n, S)` N, of touches as they come, most of them of one finger.
        least_shared: share of the touches of the rarer of two receptors that the other feels too.

    Returns:
        `(S, S)` bool, symmetric, true on the diagonal.
    """
    felt = (np.asarray(sensation) > 0).astype(np.float32)
    together = felt.T @ felt
    alone = np.diag(together)
    rarer = np.maximum(np.minimum(alone[:, None], alone[None]), 1.0)
    overlap = together >= least_shared * rarer
    np.fill_diagonal(overlap, True)
    return overlap


def separate_touches(
    sensation: np.ndarray, overlap: np.ndarray, max_touches: int = 2
) -> tuple[np.ndarray, np.ndarray]:
    """Parts each sensation into the touches that no overlap joins.

    Args:
        sensation: `(n, S)` N.
        overlap: `(S, S)` bool, receptors that feel one touch together.
        max_touches: parts that are returned.

    Returns:
        `(n,)` number of parts, counted up to `max_touches + 1`, and `(n, max_touches, S)` N the
        parts, that of the strongest receptor first; zero where there are fewer.
    """
    sensation = np.asarray(sensation, dtype=np.float32)
    joined = overlap.astype(np.float32)
    rest = sensation.copy()
    number = np.zeros(len(sensation), dtype=int)
    parts = np.zeros((len(sensation), max_touches, sensation.shape[1]), dtype=np.float32)
    for touch in range(max_touches):
        some = rest.max(axis=1) > 0
        number += some
        part = np.zeros(rest.shape, dtype=bool)
        part[np.flatnonzero(some), rest[some].argmax(axis=1)] = True
        size = -1
        while size != (size := int(part.sum())):
            part = (part.astype(np.float32) @ joined > 0) & (rest > 0)
        parts[:, touch] = np.where(part, rest, 0.0)
        rest = np.where(part, 0.0, rest)
    return number + (rest.max(axis=1) > 0), parts


def equal_touches(parts: np.ndarray) -> np.ndarray:
    """Divides each touch by its own L2 norm, and adds them up: how hard each presses is left out.

    Args:
        parts: `(n, touches, S)` N, of `separate_touches`.

    Returns:
        `(n, S)` without unit.
    """
    felt = strength(parts.reshape(-1, parts.shape[2])).reshape(parts.shape[:2])
    return np.einsum("nts,nt->ns", parts, 1.0 / np.where(felt > 0, felt, np.inf)).astype(np.float32)
