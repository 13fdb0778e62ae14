"""The quotient representation: what the agent keeps from its experience."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.records import Record
from selftouch_drake.agent.representation.kernels import KernelSets

#: Value in `kernel_mode` of a configuration whose mode is unknown.
NO_MODE = -1

#: Fewest kernels of a part whose shape and holes are recovered. Smaller parts are fragments: the
#: rim of a patch that was hardly touched, or a receptor that shares no touch with others.
LEAST_KERNELS = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuotientRepresentation(Record):
    """Motor kernel sets, their distances and the graph over them (paper, sections II and III).

    K kernels over S receptors and J joints; R stored motor configurations in total. Motor
    configurations are in the robot's units, which the agent does not know. All distances in motor
    space are between scaled configurations, `q * joint_scale`. Their unit is called "rad": the unit
    of a joint whose scale is 1.

    Attributes:
        target_sensations: `(K, S)` target sensations, unit L2 norm.
        kernel_offsets: `(K + 1,)` kernel k owns rows `kernel_offsets[k]:kernel_offsets[k + 1]`.
        kernel_q: `(R, J)` in the robot's units, motor configurations, grouped by kernel.
        kernel_row: `(R,)` row of each configuration in the experience, one for each place.
        kernel_strength: `(R,)` N, L2 norm of the sensation felt there; firm touches are strong.
        kernel_error: `(R,)` cosine distance from the sensation felt there to the target sensation.
        kernel_mode: `(R,)` mode of each touch, which determines the joints that matter to it;
            `NO_MODE` where unknown. See `relevance`.
        mode_joints: `(M, J)` bool, the joints that matter in each mode.
        joint_scale: `(J,)` positive factors that make the joints comparable.
        overlap: `(S, S)` bool, symmetric: receptors that may feel the same touch; see
            `touches.Together`.
        part: `(K,)` the part of the body that each kernel lies on; 0 has the most kernels.
        set_distance: `(K, K)` rad, symmetric quantile distance between kernel sets.
        edges: `(E, 2)` pairs of kernels that are neighbours on the body, i < j, sorted; both are on
            the same part. See `graphs.surface_neighbours`.
        edge_cost: `(E,)` rad, mean nearest-neighbour distance between the firm configurations of
            both kernels, those felt more strongly than the median of their kernel.
        embedding: `(K, 3)` position of each kernel in the recovered shape of its part, in a pose
            and unit of that part; NaN until `RecoveredBody.embed` fills it, and in fragments.
        num_touches: rows of the experience.
        num_set_aside: touches of several places at once that were excluded; see `Together.places`.

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
        matrices = "target_sensations", "kernel_q", "mode_joints"
        self.check_arrays(dict.fromkeys(matrices, (None, None)))
        num_kernels, num_receptors = self.target_sensations.shape
        (num_rows, num_joints), num_modes = self.kernel_q.shape, len(self.mode_joints)
        of_rows = "kernel_row", "kernel_strength", "kernel_error", "kernel_mode"
        self.check_arrays(
            {
                "kernel_offsets": (num_kernels + 1,),
                **dict.fromkeys(of_rows, (num_rows,)),
                "mode_joints": (num_modes, num_joints),
                "joint_scale": (num_joints,),
                "overlap": (num_receptors, num_receptors),
                "part": (num_kernels,),
                "set_distance": (num_kernels, num_kernels),
                "edges": (None, 2),
                "edge_cost": self.edges.shape[:1],
                "embedding": (num_kernels, 3),
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
    def num_targets(self) -> int:
        """K, the number of target sensations, kernel sets and nodes of the graph."""
        return len(self.target_sensations)

    @property
    def num_rows(self) -> int:
        """R, the number of stored motor configurations."""
        return len(self.kernel_q)

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

    def members(self, kernel: int) -> slice:
        """The rows of `kernel_*` that belong to `kernel`."""
        return slice(int(self.kernel_offsets[kernel]), int(self.kernel_offsets[kernel + 1]))

    def restricted(self, kernels: np.ndarray) -> "QuotientRepresentation":
        """The representation of some of the kernels, `(n,)` ascending."""
        if len(kernels) == self.num_targets:
            return self
        rows = np.concatenate([np.arange(self.num_rows)[self.members(k)] for k in kernels])
        place = np.full(self.num_targets, -1)
        place[kernels] = np.arange(len(kernels))
        kept = (place[self.edges] >= 0).all(axis=1)
        by_row = "kernel_q", "kernel_row", "kernel_strength", "kernel_error", "kernel_mode"
        by_kernel = "target_sensations", "embedding"
        _, part = np.unique(self.part[kernels], return_inverse=True)
        return dataclasses.replace(
            self,
            **{name: getattr(self, name)[rows] for name in by_row},
            **{name: getattr(self, name)[kernels] for name in by_kernel},
            kernel_offsets=np.cumsum([0, *np.diff(self.kernel_offsets)[kernels]]),
            part=part,
            set_distance=self.set_distance[np.ix_(kernels, kernels)],
            edges=place[self.edges[kept]],
            edge_cost=self.edge_cost[kept],
        )


def mattering(x: np.ndarray, mode: np.ndarray, mode_joints: np.ndarray) -> np.ndarray:
    """`(R, J)` float32, scaled configurations with joints that do not matter set to their mean.

    Otherwise these joints would be noise in every distance between configurations. Mode and
    `mode_joints` are as of `QuotientRepresentation`.
    """
    return np.where(row_joints(mode, mode_joints), x, x.mean(axis=0)).astype(np.float32)


def row_joints(mode: np.ndarray, mode_joints: np.ndarray) -> np.ndarray:
    """`(R, J)` bool, the joints that matter to touches of modes `(R,)`; all for `NO_MODE`."""
    # `NO_MODE` is the last row.
    return np.concatenate([mode_joints, np.ones_like(mode_joints[:1])])[mode]


def stored_row(representation: "QuotientRepresentation", kernel: int, q: np.ndarray) -> int | None:
    """The row of `kernel_q` at which `(J,)` q is stored in a kernel; None if it is not.

    Joints that do not matter to a touch may have any position.
    """
    members = representation.members(kernel)
    off = np.abs(representation.scaled(representation.kernel_q[members] - q))
    matter = row_joints(representation.kernel_mode[members], representation.mode_joints)
    off = np.where(matter, off, 0.0).max(axis=1)
    # Stored configurations are float32.
    return members.start + int(off.argmin()) if off.min() < 1e-5 else None
