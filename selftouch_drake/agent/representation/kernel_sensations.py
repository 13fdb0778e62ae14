"""What was felt at the motor configurations that a representation stores."""

from collections.abc import Iterable

import numpy as np
from scipy.sparse import csr_array, vstack

# Rows that are dense at once: bounds the memory, which 5,000 receptors would fill with gigabytes.
_AT_ONCE = 2048


def kernel_sensations(kernel_row: np.ndarray, sensations: Iterable[np.ndarray]) -> csr_array:
    """`(R, S)` float32, unit L2 norm: the sensations of stored configurations.

    Few receptors feel a touch: for a million touches on 100 receptors this takes 70 MB, a dense
    array 400 MB. That is why it is not part of the representation. `kernel_row` is `(R,)`, of the
    experience; the batches `(n, S)` N are all the experience that was learned from.

    Raises:
        ValueError: the experience has fewer rows than the representation was learned from.
    """
    order = np.argsort(kernel_row, kind="stable")
    rising = kernel_row[order]
    first, parts = 0, []
    for batch in sensations:
        start, stop = np.searchsorted(rising, [first, first + len(batch)])
        wanted = rising[start:stop] - first
        for some in np.array_split(wanted, len(wanted) // _AT_ONCE + 1):
            # Double precision: the squares of very light touches underflow in single precision.
            rows = batch[some].astype(float)
            felt = rows / np.linalg.norm(rows, axis=1, keepdims=True)
            parts.append(csr_array(felt.astype(np.float32)))
        first += len(batch)
    if first <= rising[-1]:
        raise ValueError(
            f"sensations have {first} rows, the representation was learned from more: give all "
            "of its experience"
        )
    return vstack(parts, format="csr")[np.argsort(order)]
