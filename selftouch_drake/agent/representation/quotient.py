"""The quotient representation: what the agent keeps of its experience."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from selftouch_drake.files import load_arrays, save_arrays


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuotientRepresentation:
    """Motor kernel sets, their distances and the graph over them (paper, sections II and III).

    K kernels over S receptors and J joints; R stored motor configurations in all.

    Attributes:
        target_sensations: `(K, S)` target sensations, unit L2 norm.
        kernel_offsets: `(K + 1,)` kernel k owns rows `kernel_offsets[k]:kernel_offsets[k + 1]`.
        kernel_q: `(R, J)` rad, motor configurations, grouped by kernel.
        kernel_row: `(R,)` row of each configuration in the experience.
        kernel_strength: `(R,)` N, L2 norm of the sensation felt there; firm touches are strong.
        kernel_error: `(R,)` cosine distance from the sensation felt there to the target sensation.
        set_distance: `(K, K)` rad, symmetric quantile distance between kernel sets.
        edges: `(E, 2)` pairs of neighbouring kernels, i < j, sorted: the quotient graph.
        edge_cost: `(E,)` rad, mean nearest distance between the firm configurations of the two,
            those felt more strongly than the median of their kernel.
        embedding: `(K, 3)` the recovered body, arbitrary unit and pose; NaN until it is embedded
            by `selftouch_drake.agent.shape.embed_representation`.

    Raises:
        ValueError: shapes disagree, indices are no whole numbers, or a kernel is empty.
    """

    target_sensations: np.ndarray
    kernel_offsets: np.ndarray
    kernel_q: np.ndarray
    kernel_row: np.ndarray
    kernel_strength: np.ndarray
    kernel_error: np.ndarray
    set_distance: np.ndarray
    edges: np.ndarray
    edge_cost: np.ndarray
    embedding: np.ndarray

    def __post_init__(self) -> None:
        for field in fields(self):
            array = getattr(self, field.name)
            wanted = "iu" if field.name in _INDICES else "fiu"
            if array.dtype.kind not in wanted:
                kind = "whole" if wanted == "iu" else "real"
                raise ValueError(f"{field.name} holds {array.dtype}, not {kind} numbers.")
        # Of a bare number the length is 0, and its shape is refused below.
        num_kernels, num_edges, num_rows = (
            array.shape[0] if array.ndim else 0
            for array in (self.target_sensations, self.edges, self.kernel_q)
        )
        expected: dict[str, tuple[int | None, ...]] = {
            "target_sensations": (num_kernels, None),
            "kernel_offsets": (num_kernels + 1,),
            "kernel_q": (num_rows, None),
            "kernel_row": (num_rows,),
            "kernel_strength": (num_rows,),
            "kernel_error": (num_rows,),
            "set_distance": (num_kernels, num_kernels),
            "edges": (num_edges, 2),
            "edge_cost": (num_edges,),
            "embedding": (num_kernels, 3),
        }
        for name, shape in expected.items():
            found = getattr(self, name).shape
            if len(found) != len(shape) or any(
                want not in (None, have) for want, have in zip(shape, found, strict=True)
            ):
                wanted = ", ".join("any" if size is None else str(size) for size in shape)
                raise ValueError(f"{name} has shape {found}, expected ({wanted}).")
        sizes = np.diff(self.kernel_offsets)
        if self.kernel_offsets[0] != 0 or self.kernel_offsets[-1] != num_rows or (sizes < 1).any():
            raise ValueError(
                f"kernel_offsets must rise from 0 to {num_rows}, the rows of kernel_q, "
                "with no kernel empty."
            )
        if num_edges and (self.edges.min() < 0 or self.edges.max() >= num_kernels):
            raise ValueError(f"edges must join kernels 0 to {num_kernels - 1}.")

    @property
    def num_targets(self) -> int:
        """K, the number of target sensations, kernel sets and nodes of the graph."""
        return len(self.target_sensations)

    def members(self, kernel: int) -> slice:
        """The rows of `kernel_*` that belong to `kernel`."""
        return slice(int(self.kernel_offsets[kernel]), int(self.kernel_offsets[kernel + 1]))

    def save(self, path: Path | str) -> None:
        """Writes the arrays to an `.npz` file, whole or not at all; equal arrays, equal bytes."""
        save_arrays(Path(path), {f.name: getattr(self, f.name) for f in fields(self)})

    @classmethod
    def load(cls, path: Path | str) -> QuotientRepresentation:
        """Reads what `save` wrote; keys of other names are left alone.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: the file is damaged, or is not a representation.
        """
        names = [f.name for f in fields(cls)]
        try:
            arrays = load_arrays(Path(path), names)
        except ValueError as error:
            raise ValueError(f"{error} with `selftouch learn`") from error
        try:
            return cls(**{name: arrays[name] for name in names})
        except ValueError as error:
            reason = str(error).rstrip(".")
            raise ValueError(
                f"{path} is no quotient representation: {reason}; make it again with "
                "`selftouch learn`"
            ) from error


_INDICES = ("kernel_offsets", "kernel_row", "edges")
