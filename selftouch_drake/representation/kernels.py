"""Motor kernel sets: the motor configurations that share a target sensation (paper, section III).

A kernel set keeps at most `max_size` of its configurations, every one with equal chance. Each row
of the experience owns a random priority that depends on the seed and the row alone, and a kernel
keeps the rows of lowest priority. So any cut of the experience into batches, merged in any order,
gives the same kernels: a reservoir that streams.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KernelSample:
    """The rows of the experience kept in each kernel, sorted by kernel and then by row.

    Attributes:
        kernel: `(R,)` kernel that each kept row belongs to.
        row: `(R,)` row in the experience.
        priority: `(R,)` in [0, 1): a kernel keeps its lowest.
    """

    kernel: np.ndarray
    row: np.ndarray
    priority: np.ndarray

    def offsets(self, num_kernels: int) -> np.ndarray:
        """`(K + 1,)`: kernel k owns rows `offsets[k]:offsets[k + 1]` of this sample."""
        counts = np.bincount(self.kernel, minlength=num_kernels)
        return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def sample_kernels(
    label: np.ndarray, max_size: int, *, seed: int, first_row: int = 0
) -> KernelSample:
    """Samples the kernels of one batch of experience without bias.

    Args:
        label: `(n,)` kernel of each row of the batch.
        max_size: most rows that a kernel keeps.
        seed: of the priorities; the same for every batch of one experience.
        first_row: row of the experience where the batch starts.

    Returns:
        The sample; kernels with at most `max_size` rows are complete.
    """
    # PCG64 draws one 64-bit word a double, so that row i always sees the i-th draw.
    priority = np.random.Generator(np.random.PCG64(seed).advance(first_row)).random(len(label))
    return _lowest(
        np.asarray(label, dtype=np.int64),
        np.arange(first_row, first_row + len(label)),
        priority,
        max_size,
    )


def merge_kernels(a: KernelSample, b: KernelSample, max_size: int) -> KernelSample:
    """Merges the samples of two batches: the sample of the two batches together."""
    return _lowest(
        np.concatenate([a.kernel, b.kernel]),
        np.concatenate([a.row, b.row]),
        np.concatenate([a.priority, b.priority]),
        max_size,
    )


def _lowest(
    kernel: np.ndarray, row: np.ndarray, priority: np.ndarray, max_size: int
) -> KernelSample:
    order = np.lexsort((priority, kernel))
    first = np.searchsorted(kernel[order], kernel[order])
    keep = order[np.arange(len(order)) - first < max_size]
    keep = keep[np.lexsort((row[keep], kernel[keep]))]
    return KernelSample(kernel=kernel[keep], row=row[keep], priority=priority[keep])
