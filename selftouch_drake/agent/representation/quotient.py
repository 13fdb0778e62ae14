"""The quotient representation: what the agent keeps from its experience."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from selftouch_drake.agent.representation.kernels import KernelSets

#: Value in `kernel_mode` of a configuration whose mode is unknown.
NO_MODE = -1

#: Fewest kernels of a part whose shape and holes are recovered. Smaller parts are fragments: the
#: rim of a patch that was hardly touched, or a receptor that shares no touch with others.
LEAST_KERNELS = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuotientRepresentation:
    """Motor kernel sets, their distances and the graph over them (paper, sections II and III).

    K kernels over S receptors and J joints; R stored motor configurations in total. Motor
    configurations are in the robot's units, which the agent does not know. All distances in motor
    space are between scaled configurations, `q * joint_scale`. Their unit is called "rad": the unit
    of a joint whose scale is 1.

    Attributes:
        target_sensations: `(K, S)` target sensations, unit L2 norm.
        kernel_offsets: `(K + 1,)` kernel k owns rows `kernel_offsets[k]:kernel_offsets[k + 1]`.
        kernel_q: `(R, J)` in the robot's units, motor configurations, grouped by kernel.
        kernel_row: `(R,)` row of each configuration in the experience.
        kernel_strength: `(R,)` N, L2 norm of the sensation felt there; firm touches are strong.
        kernel_error: `(R,)` cosine distance from the sensation felt there to the target sensation.
        kernel_mode: `(R,)` mode of each touch, which determines the joints that matter to it;
            `NO_MODE` where unknown. See `relevance`.
        mode_joints: `(M, J)` bool, the joints that matter in each mode.
        joint_scale: `(J,)` positive factors that make the joints comparable.
        overlap: `(S, S)` bool, symmetric: receptors that may feel the same touch; see
            `touches.nearby`.
        part: `(K,)` the part of the body that each kernel lies on; 0 has the most kernels.
        set_distance: `(K, K)` rad, symmetric quantile distance between kernel sets.
        edges: `(E, 2)` pairs of kernels that are neighbours on the body, i < j, sorted; both are on
            the same part. See `graphs.surface_neighbours`.
        edge_cost: `(E,)` rad, mean nearest-neighbour distance between the firm configurations of
            both kernels, those felt more strongly than the median of their kernel.
        embedding: `(K, 3)` position of each kernel in the recovered shape of its part, in a pose
            and unit of that part; NaN until `Body.embed` fills it, and in parts not recovered.
        num_touches: rows of the experience.
        num_set_aside: rows of the experience that touched several places at once and were
            excluded; see `touches.ambiguous_touches`.

    Raises:
        ValueError: shapes disagree, an array has the wrong type of numbers, or a kernel is empty.
    """

    target_sensations: np.ndarray
    kernel_offsets: np.ndarray
    kernel_q: np.ndarray
    kernel_row: np.ndarray
    kernel_strength: np.ndarray
    kernel_error: np.ndarray
    kernel_mode: np.ndarray
    mode_joints: np.ndarray
    joint_scale: np.ndarray
    overlap: np.ndarray
    part: np.ndarray
    set_distance: np.ndarray
    edges: np.ndarray
    edge_cost: np.ndarray
    embedding: np.ndarray
    num_touches: int
    num_set_aside: int = 0

    def __post_init__(self) -> None:
        # A scalar counts as length 0; its shape is rejected below.
        num_kernels, num_edges, num_rows, num_modes = (
            array.shape[0] if array.ndim else 0
            for array in (self.target_sensations, self.edges, self.kernel_q, self.mode_joints)
        )
        receptors, joints = self.target_sensations.shape[1:2], self.kernel_q.shape[1:2]
        real, whole, boolean = ("fiu", "real numbers"), ("iu", "whole numbers"), ("b", "booleans")
        expected: dict[str, tuple[tuple[str, str], tuple[int | None, ...]]] = {
            "target_sensations": (real, (num_kernels, None)),
            "kernel_offsets": (whole, (num_kernels + 1,)),
            "kernel_q": (real, (num_rows, None)),
            "kernel_row": (whole, (num_rows,)),
            "kernel_strength": (real, (num_rows,)),
            "kernel_error": (real, (num_rows,)),
            "kernel_mode": (whole, (num_rows,)),
            "mode_joints": (boolean, (num_modes, *joints)),
            "joint_scale": (real, joints),
            "overlap": (boolean, 2 * receptors),
            "part": (whole, (num_kernels,)),
            "set_distance": (real, (num_kernels, num_kernels)),
            "edges": (whole, (num_edges, 2)),
            "edge_cost": (real, (num_edges,)),
            "embedding": (real, (num_kernels, 3)),
        }
        for name, ((kinds, words), shape) in expected.items():
            array = getattr(self, name)
            if array.dtype.kind not in kinds:
                raise ValueError(f"{name} holds {array.dtype}, expected {words}")
            if len(array.shape) != len(shape) or any(
                want not in (None, have) for want, have in zip(shape, array.shape, strict=True)
            ):
                wanted = ", ".join("any" if size is None else str(size) for size in shape)
                raise ValueError(f"{name} has shape {array.shape}, expected ({wanted})")
        sizes = np.diff(self.kernel_offsets)
        if self.kernel_offsets[0] != 0 or self.kernel_offsets[-1] != num_rows or (sizes < 1).any():
            raise ValueError(
                f"kernel_offsets must rise from 0 to {num_rows}, the number of rows of kernel_q, "
                "without empty kernels"
            )
        if num_edges and (self.edges.min() < 0 or self.edges.max() >= num_kernels):
            raise ValueError(f"edges must join kernels 0 to {num_kernels - 1}")
        if not (np.isfinite(self.joint_scale).all() and (self.joint_scale > 0).all()):
            raise ValueError(f"joint_scale is {self.joint_scale.tolist()}: give positive factors")
        if num_rows and not NO_MODE <= self.kernel_mode.min() <= self.kernel_mode.max() < num_modes:
            raise ValueError(f"kernel_mode must hold modes 0 to {num_modes - 1}, or {NO_MODE}")
        if not self.mode_joints.any(axis=1).all():
            raise ValueError("mode_joints has a mode without joints, expected one or more")
        _check_parts(self.part, self.edges)

    @property
    def num_targets(self) -> int:
        """K, the number of target sensations, kernel sets and nodes of the graph."""
        return len(self.target_sensations)

    @property
    def num_parts(self) -> int:
        """Number of parts without fragments of fewer than `LEAST_KERNELS` kernels; 1 or more.

        They are parts 0 to `num_parts - 1`.
        """
        return max(int(np.sum(np.bincount(self.part) >= LEAST_KERNELS)), 1)

    @property
    def kernel_sets(self) -> KernelSets:
        """The kernel sets, rad, float32: scaled configurations, joints that matter."""
        x = mattering(self.scaled(self.kernel_q), self.kernel_mode, self.mode_joints)
        return KernelSets(x, self.kernel_offsets)

    def scaled(self, q: np.ndarray) -> np.ndarray:
        """`(..., J)` rad, scaled configurations, between which distances are measured."""
        return np.asarray(q) * self.joint_scale

    def unscaled(self, x: np.ndarray) -> np.ndarray:
        """`(..., J)` in the robot's units, the inverse of `scaled`."""
        return np.asarray(x) / self.joint_scale

    def members(self, kernel: int) -> slice:
        """The rows of `kernel_*` that belong to `kernel`."""
        return slice(int(self.kernel_offsets[kernel]), int(self.kernel_offsets[kernel + 1]))

    def restricted(self, kernels: np.ndarray) -> QuotientRepresentation:
        """The representation of some of the kernels, `(n,)` ascending."""
        if len(kernels) == self.num_targets:
            return self
        rows = np.concatenate([np.arange(self.num_rows)[self.members(k)] for k in kernels])
        place = np.full(self.num_targets, -1)
        place[kernels] = np.arange(len(kernels))
        kept = (place[self.edges] >= 0).all(axis=1)
        _, part = np.unique(self.part[kernels], return_inverse=True)
        return dataclasses.replace(
            self,
            target_sensations=self.target_sensations[kernels],
            kernel_offsets=np.cumsum([0, *np.diff(self.kernel_offsets)[kernels]]),
            kernel_q=self.kernel_q[rows],
            kernel_row=self.kernel_row[rows],
            kernel_strength=self.kernel_strength[rows],
            kernel_error=self.kernel_error[rows],
            kernel_mode=self.kernel_mode[rows],
            part=part,
            set_distance=self.set_distance[np.ix_(kernels, kernels)],
            edges=place[self.edges[kept]],
            edge_cost=self.edge_cost[kept],
            embedding=self.embedding[kernels],
        )

    @property
    def num_rows(self) -> int:
        """R, the number of stored motor configurations."""
        return len(self.kernel_q)

    def to_arrays(self) -> dict[str, np.ndarray]:
        """All fields as arrays, by name."""
        return {field.name: np.asarray(getattr(self, field.name)) for field in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> QuotientRepresentation:
        """Inverse of `to_arrays`; other names are ignored.

        Raises:
            ValueError: an array is missing or does not fit the others; the text names it.
        """
        names = [field.name for field in fields(cls)]
        if missing := [name for name in names if name not in arrays]:
            raise ValueError(f"{', '.join(missing)} is missing")
        checked: dict[str, Any] = {name: np.asarray(arrays[name]) for name in names}
        for name in ("num_touches", "num_set_aside"):
            count = checked[name]
            if count.shape != () or count.dtype.kind not in "iu" or count < 0:
                raise ValueError(f"{name} is {count.tolist()}, expected a whole number >= 0")
            checked[name] = int(count)
        return cls(**checked)


def mattering(x: np.ndarray, mode: np.ndarray, mode_joints: np.ndarray) -> np.ndarray:
    """`(R, J)` float32, scaled configurations with joints that do not matter set to their mean.

    Otherwise these joints would be noise in every distance between configurations. Mode and
    `mode_joints` are as of `QuotientRepresentation`.
    """
    matter = row_joints(mode, mode_joints)
    return np.where(matter, x, x.mean(axis=0)).astype(np.float32)


def row_joints(mode: np.ndarray, mode_joints: np.ndarray) -> np.ndarray:
    """`(R, J)` bool, the joints that matter to touches of modes `(R,)`; all for `NO_MODE`."""
    known = np.concatenate([mode_joints, np.ones((1, mode_joints.shape[1]), dtype=bool)])
    return known[np.where(mode == NO_MODE, len(mode_joints), mode)]


def stored_row(representation: QuotientRepresentation, kernel: int, q: np.ndarray) -> int | None:
    """The row of `kernel_q` at which `(J,)` q is stored in a kernel; None if it is not.

    Joints that do not matter to a touch may have any position.
    """
    members = representation.members(kernel)
    off = np.abs(representation.scaled(representation.kernel_q[members] - q))
    matter = row_joints(representation.kernel_mode[members], representation.mode_joints)
    off = np.where(matter, off, 0.0).max(axis=1)
    # Stored configurations are float32.
    return members.start + int(off.argmin()) if off.min() < 1e-5 else None


def _check_parts(part: np.ndarray, edges: np.ndarray) -> None:
    if not len(part):
        return
    sizes = np.bincount(part) if part.min() >= 0 else np.zeros(1)
    if (sizes == 0).any() or (np.diff(sizes) > 0).any():
        raise ValueError("part must number the parts from 0, largest first")
    i, j = edges.T
    if (across := np.flatnonzero(part[i] != part[j])).size:
        first = edges[across[0]].tolist()
        raise ValueError(f"edges join kernels {first} of different parts")
