"""What the agent keeps from its experience: the quotient, and what it found beside it."""

import dataclasses
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from selftouch_drake.agent.records import Record
from selftouch_drake.quotient.kernels import KernelSets
from selftouch_drake.quotient.links import step_links
from selftouch_drake.quotient.representation import Representation

#: Value in `kernel_mode` of a configuration whose mode is unknown.
NO_MODE = -1

#: Fewest kernels of a part whose shape and holes are recovered. Smaller parts are fragments: the
#: rim of a patch that was hardly touched, or a receptor that shares no touch with others.
LEAST_OF_PART = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuotientRepresentation(Representation, Record):
    """The paper's representation of a body that may have several parts and several hands.

    Attributes:
        kernel_mode: `(R,)` mode of each touch, which determines the joints that matter to it;
            `NO_MODE` where unknown. See `relevance`.
        mode_joints: `(M, J)` bool, the joints that matter in each mode.
        overlap: `(S, S)` bool, symmetric: receptors that may feel the same touch; see
            `touches.Together`.
        part: `(K,)` the part of the body that each kernel lies on; 0 has the most kernels. Edges
            join kernels of one part.
        num_set_aside: touches of several places at once that were excluded; see `Together.places`.

    Raises:
        ValueError: shapes disagree, an array has the wrong type of numbers, or a kernel is empty.
    """

    #: Fields that hold one entry for each stored configuration, and for each kernel.
    by_row: ClassVar[tuple[str, ...]] = (
        *("kernel_q", "kernel_row", "kernel_strength", "kernel_error", "kernel_mode"),
    )
    by_kernel: ClassVar[tuple[str, ...]] = ("target_sensations",)

    kernel_mode: np.ndarray
    mode_joints: np.ndarray
    overlap: np.ndarray
    part: np.ndarray
    num_set_aside: int = 0

    def __post_init__(self) -> None:
        self.check_arrays(dict.fromkeys(("target_sensations", "kernel_q"), (None, None)))
        num_kernels, num_receptors = self.target_sensations.shape
        num_rows, num_joints = self.kernel_q.shape
        self.check_arrays(
            {
                "kernel_offsets": (num_kernels + 1,),
                "kernel_row": (num_rows,),
                "kernel_strength": (num_rows,),
                "kernel_error": (num_rows,),
                "joint_scale": (num_joints,),
                "set_distance": (num_kernels, num_kernels),
                "edges": (None, 2),
                "edge_cost": self.edges.shape[:1],
            }
        )
        sizes = np.diff(self.kernel_offsets)
        if self.kernel_offsets[0] != 0 or self.kernel_offsets[-1] != num_rows or (sizes < 1).any():
            raise ValueError(
                f"kernel_offsets must rise from 0 to {num_rows}, the number of rows of kernel_q, "
                "without empty kernels"
            )
        if not 0 <= self.edges.min(initial=0) <= self.edges.max(initial=0) < num_kernels:
            raise ValueError(f"edges must join kernels 0 to {num_kernels - 1}")
        if not (self.joint_scale > 0).all():
            raise ValueError(f"joint_scale is {self.joint_scale.tolist()}: give positive factors")
        self.check_arrays(
            {
                "mode_joints": (None, num_joints),
                "kernel_mode": (num_rows,),
                "overlap": (num_receptors, num_receptors),
                "part": (num_kernels,),
            }
        )
        self._check_modes_and_parts()

    def _check_modes_and_parts(self) -> None:
        num_modes = len(self.mode_joints)
        if not NO_MODE <= self.kernel_mode.min() <= self.kernel_mode.max() < num_modes:
            raise ValueError(f"kernel_mode must hold modes 0 to {num_modes - 1}, or {NO_MODE}")
        if not self.mode_joints.any(axis=1).all():
            raise ValueError("mode_joints has a mode without joints, expected one or more")
        sizes = np.bincount(self.part) if self.part.min() >= 0 else np.zeros(1)
        if (sizes == 0).any() or (np.diff(sizes) > 0).any():
            raise ValueError("part must number the parts from 0, largest first")
        across = self.edges[np.diff(self.part[self.edges]).any(axis=1)]
        if len(across):
            raise ValueError(f"edges join kernels {across[0].tolist()} of different parts")

    @property
    def num_parts(self) -> int:
        """Number of parts without fragments of fewer than `LEAST_OF_PART` kernels; 1 or more.

        They are parts 0 to `num_parts - 1`.
        """
        return max(int(np.sum(np.bincount(self.part) >= LEAST_OF_PART)), 1)

    def step_links(self) -> np.ndarray:
        """`(L, 2)` the kernels between which plans may step; they are of one part."""
        links = step_links(self.target_sensations, self.edges)
        i, j = links.T
        return links[self.part[i] == self.part[j]]

    @property
    def kernel_sets(self) -> KernelSets:
        """The kernel sets, mu, float32: scaled configurations, joints that matter."""
        x = mattering(self.scaled(self.kernel_q), self.kernel_mode, self.mode_joints)
        return KernelSets(x, self.kernel_offsets)

    def restricted(self, kernels: np.ndarray) -> Self:
        """The representation of some of the kernels, `(n,)` ascending."""
        if len(kernels) == self.num_targets:
            return self
        rows = np.concatenate([np.arange(self.num_rows)[self.members(k)] for k in kernels])
        place = np.full(self.num_targets, -1)
        place[kernels] = np.arange(len(kernels))
        kept = (place[self.edges] >= 0).all(axis=1)
        _, part = np.unique(self.part[kernels], return_inverse=True)
        of_rows = {name: getattr(self, name)[rows] for name in self.by_row}
        of_kernels = {name: getattr(self, name)[kernels] for name in self.by_kernel}
        return dataclasses.replace(
            self,
            kernel_offsets=np.cumsum([0, *np.diff(self.kernel_offsets)[kernels]]),
            set_distance=self.set_distance[np.ix_(kernels, kernels)],
            edges=place[self.edges[kept]],
            edge_cost=self.edge_cost[kept],
            part=part,
            **of_rows,
            **of_kernels,
        )


def mattering(x: np.ndarray, mode: np.ndarray, mode_joints: np.ndarray) -> np.ndarray:
    """`(R, J)` float32, scaled configurations with joints that do not matter set to their mean.

    Otherwise these joints would be noise in every distance between configurations. Mode and
    `mode_joints` are as in `QuotientRepresentation`.
    """
    return np.where(row_joints(mode, mode_joints), x, x.mean(axis=0)).astype(np.float32)


def row_joints(mode: np.ndarray, mode_joints: np.ndarray) -> np.ndarray:
    """`(R, J)` bool, the joints that matter to touches of modes `(R,)`; all for `NO_MODE`."""
    # `NO_MODE` is the last row.
    return np.concatenate([mode_joints, np.ones_like(mode_joints[:1])])[mode]


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
