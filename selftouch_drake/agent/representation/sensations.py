"""The sensations at the stored motor configurations."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.representation.quotient import QuotientRepresentation


def kernel_sensations(
    representation: QuotientRepresentation, sensations: Iterable[np.ndarray]
) -> csr_array:
    """Collects the sensations of the stored configurations from streamed experience.

    Few receptors feel a touch: for a million touches on 100 receptors this takes 70 MB, a dense
    array 400 MB. That is why it is not part of the representation.

    Args:
        representation: R stored configurations.
        sensations: `(n, S)` N, all the experience that it was learned from, in batches.

    Returns:
        `(R, S)` float32, unit L2 norm.

    Raises:
        ValueError: the experience has fewer rows than the representation was learned from.
    """
    order = np.argsort(representation.kernel_row, kind="stable")
    rising = representation.kernel_row[order]
    first, parts = 0, []
    for batch in sensations:
        start, stop = np.searchsorted(rising, [first, first + len(batch)])
        # Double precision: the squares of very light touches underflow in single precision.
        rows = batch[rising[start:stop] - first].astype(float)
        felt = rows / np.linalg.norm(rows, axis=1, keepdims=True)
        parts.append(csr_array(felt.astype(np.float32)))
        first += len(batch)
    if first <= rising[-1]:
        raise ValueError(
            f"sensations have {first} rows, the representation was learned from more: give all "
            "of its experience"
        )
    return _stacked(parts)[np.argsort(order)]


def _stacked(parts: list[csr_array]) -> csr_array:
    data = np.concatenate([part.data for part in parts])
    indices = np.concatenate([part.indices for part in parts])
    counts = np.concatenate([np.diff(part.indptr) for part in parts])
    shape = (len(counts), parts[0].shape[1])
    return csr_array((data, indices, np.concatenate([[0], np.cumsum(counts)])), shape=shape)
