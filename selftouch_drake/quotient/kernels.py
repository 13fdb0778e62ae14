"""Motor kernel sets: the points of M/=_Psi (paper, sections II and III).

All motor configurations M with one sensation, Psi(M) = S, form a class of the relation =_Psi. In a
finite sample, such a class is the set of configurations whose sensations are in the cell of one
target sensation: a *motor kernel set*, or kernel for short.
"""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, slots=True, eq=False)
class KernelSets:
    """K motor kernel sets: the configurations of one kernel after those of the other.

    Attributes:
        x: `(R, J)` configurations, scaled or not, or `(R, D)` other coordinates of them.
        offsets: `(K + 1,)` kernel k owns rows `offsets[k]:offsets[k + 1]`.
    """

    x: np.ndarray
    offsets: np.ndarray

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @property
    def sizes(self) -> np.ndarray:
        """`(K,)` the number of configurations of each kernel."""
        return np.diff(self.offsets)

    @property
    def kernel(self) -> np.ndarray:
        """`(R,)` the kernel of each configuration."""
        return np.repeat(np.arange(len(self)), self.sizes)

    def configurations(self, kernel: int) -> np.ndarray:
        """`(n, J)` the configurations of `kernel`."""
        return self.x[self.offsets[kernel] : self.offsets[kernel + 1]]

    def at(self, x: np.ndarray) -> "KernelSets":
        """The same sets in other coordinates, `(R, D)`."""
        return replace(self, x=x)

    def thinned(self, most: int) -> "KernelSets":
        """At most so many configurations of each kernel, evenly strided."""
        sizes, kept = self.sizes, np.minimum(self.sizes, most)
        offsets = np.concatenate([[0], np.cumsum(kept)])
        kernel = np.repeat(np.arange(len(self)), kept)
        number = np.arange(len(kernel)) - offsets[kernel]
        return KernelSets(
            self.x[self.offsets[kernel] + number * sizes[kernel] // kept[kernel]], offsets
        )

    def stronger_half(self, strength: np.ndarray) -> "KernelSets":
        """The half of each kernel that was felt more strongly, by `(R,)` strengths.

        A firm touch is deep in the skin, so small motion errors do not lose contact.
        """
        kernel = self.kernel
        order = np.lexsort((-strength, quick_to_sort(kernel)))
        sizes = (self.sizes + 1) // 2
        rank = np.arange(len(order)) - self.offsets[kernel]
        rows = np.sort(order[rank < sizes[kernel]])
        return KernelSets(self.x[rows], np.concatenate([[0], np.cumsum(sizes)]))


def quick_to_sort(kernel: np.ndarray) -> np.ndarray:
    """The same numbers in as few bytes as they need: numpy sorts one or two bytes by counting."""
    return kernel.astype(np.min_scalar_type(kernel.max(initial=0)))


def sample_rows(kernel: np.ndarray, max_size: int, *, seed: int) -> np.ndarray:
    """`(R,)` rows of `(n,)` kernels, at most `max_size` of each, sorted by kernel and then by row.

    Each row of a kernel is kept with equal probability. The paper keeps a thousand.
    """
    priority = np.random.Generator(np.random.PCG64(seed)).random(len(kernel))
    order = np.lexsort((priority, quick_to_sort(kernel)))
    by_kernel = kernel[order]
    rank = np.arange(len(order)) - np.searchsorted(by_kernel, by_kernel)
    kept = np.sort(order[rank < max_size])
    return kept[np.argsort(kernel[kept], kind="stable")]
