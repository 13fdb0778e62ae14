"""The same samples of kernels as in `quotient.kernels.sample_rows`, as experience comes.

Each row of the experience has a random priority that depends only on the seed and the row, and a
kernel keeps the rows with the lowest priorities. So the kernels do not depend on how the experience
is split into batches, and the memory does not grow with the experience.
"""

from dataclasses import dataclass

import numpy as np

from selftouch_drake.quotient.kernels import quick_to_sort

#: Rows are sorted in once so many wait: sorting a few of them at a time is slow.
_LEAST_WAITING = 32_768


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KernelSample:
    """The rows of the experience kept in each kernel, sorted by kernel and then by row.

    Attributes:
        kernel: `(R,)` kernel of each kept row.
        row: `(R,)` row in the experience.
        columns: by name, `(R, ...)` data that were added with these rows.
    """

    kernel: np.ndarray
    row: np.ndarray
    columns: dict[str, np.ndarray]

    def offsets(self, num_kernels: int) -> np.ndarray:
        """`(K + 1,)`: kernel k owns rows `offsets[k]:offsets[k + 1]` of this sample."""
        counts = np.bincount(self.kernel, minlength=num_kernels)
        return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)

    @property
    def distinct(self) -> np.ndarray:
        """`(n,)` ascending, one entry of each row: a double touch is kept once for each part."""
        return np.sort(np.unique(self.row, return_index=True)[1])

    def first(self, num_kernels: int) -> "KernelSample":
        """The rows of kernels 0 to `num_kernels` - 1."""
        rows = slice(int(np.searchsorted(self.kernel, num_kernels)))
        columns = {name: column[rows] for name, column in self.columns.items()}
        return KernelSample(kernel=self.kernel[rows], row=self.row[rows], columns=columns)


@dataclass(frozen=True, slots=True, eq=False)
class Draw:
    """Which rows of a stretch of the experience a reservoir may keep, wherever they are read.

    Attributes:
        seed: of the reservoir.
        first_row: of the stretch.
        highest: `(K,)` a kernel keeps no row of higher priority.
    """

    seed: int
    first_row: int
    highest: np.ndarray

    def take(
        self, kernel: np.ndarray, row: np.ndarray, **columns: np.ndarray
    ) -> dict[str, np.ndarray]:
        """The touches that may be kept; arguments are as in `KernelReservoir.add`."""
        # The i-th row has the i-th draw, however rows are cut.
        random = np.random.Generator(np.random.PCG64(self.seed).advance(self.first_row))
        priority = random.random(int(row[-1]) + 1 if len(row) else 0)[row]
        taken = np.flatnonzero((kernel >= 0) & (priority < self.highest[kernel]))
        return {
            "kernel": np.asarray(kernel, dtype=np.int64)[taken],
            "row": self.first_row + row[taken],
            "priority": priority[taken],
            **{name: column[taken] for name, column in columns.items()},
        }


class KernelReservoir:
    """Samples at most `max_size` rows of each of K kernels, without bias, as experience comes."""

    def __init__(self, num_kernels: int, max_size: int, *, seed: int):
        self._max_size, self._seed = max_size, seed
        #: Number of rows of the experience so far.
        self.num_rows = 0
        # A full kernel takes no row of higher priority than it has.
        self._highest = np.full(num_kernels, np.inf)
        self._settled: dict[str, np.ndarray] = {}
        self._waiting: list[dict[str, np.ndarray]] = []

    def add(
        self, kernel: np.ndarray, *, row: np.ndarray | None = None, **columns: np.ndarray
    ) -> np.ndarray:
        """Adds touches of the next rows of the experience; returns the kernels of what is kept.

        Each has a kernel, `(n,)`, or is left out if that is -1, and is kept with `(n, ...)`
        columns, the same names every time. They are one of each row, or of rows `(n,)` that ascend
        from 0 without a gap.
        """
        row = np.arange(len(kernel)) if row is None else row
        taken = self.draw(self.num_rows).take(kernel, row, **columns)
        self.keep(taken, int(row[-1]) + 1 if len(row) else 0)
        return taken["kernel"]

    def draw(self, first_row: int) -> Draw:
        """Which rows may be kept from a row on, by what is known now."""
        return Draw(self._seed, first_row, self._highest.copy())

    def keep(self, taken: dict[str, np.ndarray], num_rows: int) -> None:
        """Keeps what a draw took of the next `num_rows` rows."""
        self._waiting.append(taken)
        self.num_rows += num_rows
        num_waiting = sum(len(part["row"]) for part in self._waiting)
        if num_waiting > max(len(self._settled.get("row", ())), _LEAST_WAITING):
            self._settle()

    def relabel(self, kernel: np.ndarray, touch: np.ndarray, **columns: np.ndarray) -> None:
        """Gives copies of touches `(n,)` of `sample` to kernels `(n,)`, with some other columns."""
        held = self.sample()
        rows = {name: column[touch] for name, column in held.columns.items()}
        rows |= {"row": held.row[touch], "kernel": np.asarray(kernel, dtype=np.int64), **columns}
        self._settled, self._waiting = {}, [rows]
        self._highest[:] = np.inf
        self._settle()

    def sample(self) -> "KernelSample":
        """The rows kept so far; kernels with at most `max_size` rows are complete."""
        self._settle()
        columns = dict(self._settled)
        kernel, row = columns.pop("kernel"), columns.pop("row")
        order = np.lexsort((row, quick_to_sort(kernel)))
        return KernelSample(
            kernel=kernel[order],
            row=row[order],
            columns={name: column[order] for name, column in columns.items()},
        )

    def _settle(self) -> None:
        """Keeps the rows with the lowest priorities of each kernel."""
        parts = [self._settled, *self._waiting] if self._settled else self._waiting
        rows = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        kernel, priority = rows["kernel"], rows["priority"]
        # Sorting takes long, so rows of kernels that have room are left out.
        full = np.bincount(kernel, minlength=len(self._highest)) >= self._max_size
        keep = ~full[kernel]
        some = np.flatnonzero(~keep)
        order = some[np.lexsort((priority[some], quick_to_sort(kernel[some])))]
        sorted_kernel = kernel[order]
        size = np.bincount(sorted_kernel, minlength=len(self._highest))
        rank = np.arange(len(order)) - (np.cumsum(size) - size)[sorted_kernel]
        keep[order[rank < self._max_size]] = True
        last = order[rank == self._max_size - 1]
        self._highest[kernel[last]] = priority[last]
        if not keep.all():
            rows = {name: column[keep] for name, column in rows.items()}
        self._settled = rows
        self._waiting = []
