"""The internal representation: the quotient space M/=_Psi (paper, sections II and III).

The agent cannot see the pose X of its end effector, nor the sensory function phi. By the paper's
theorem it need not: M/=_Psi, which it can build from motor configurations M and sensations
S = Psi(M) alone, is homeomorphic to X/=_phi, the quotient space of poses. Each point of M/=_Psi is
a motor kernel set; distances between these sets, and the graph over near ones, are its topology.
"""

from dataclasses import dataclass

import numpy as np

from .kernels import KernelSets


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Representation:
    """Motor kernel sets, their distances and the graph over them.

    K kernels over S receptors and J joints; R stored motor configurations in total. Motor
    configurations are in the robot's units, which the agent does not know. All distances in motor
    space are between scaled configurations, `q * joint_scale`. Their unit is the motor unit,
    mu: the unit of a joint whose scale is 1.

    Attributes:
        target_sensations: `(K, S)` target sensations, unit L2 norm.
        kernel_offsets: `(K + 1,)` kernel k owns rows `kernel_offsets[k]:kernel_offsets[k + 1]`.
        kernel_q: `(R, J)` in the robot's units, motor configurations, grouped by kernel.
        kernel_row: `(R,)` row of the experience from which each configuration was taken.
        kernel_strength: `(R,)` N, L2 norm of the sensation felt there; firm touches are strong.
        kernel_error: `(R,)` cosine distance from the sensation felt there to the target sensation.
        joint_scale: `(J,)` positive factors that make the joints comparable.
        set_distance: `(K, K)` mu, symmetric quantile distance between kernel sets.
        edges: `(E, 2)` pairs of kernels that are neighbours on the body, i < j, sorted. See
            `graph.surface_neighbours`.
        edge_cost: `(E,)` mu, mean nearest-neighbour distance between the stronger halves of both
            kernels: their configurations that were felt more strongly than the median.
        num_touches: rows of the experience.
    """

    target_sensations: np.ndarray
    kernel_offsets: np.ndarray
    kernel_q: np.ndarray
    kernel_row: np.ndarray
    kernel_strength: np.ndarray
    kernel_error: np.ndarray
    joint_scale: np.ndarray
    set_distance: np.ndarray
    edges: np.ndarray
    edge_cost: np.ndarray
    num_touches: int

    @property
    def num_targets(self) -> int:
        """K, the number of target sensations, kernel sets and nodes of the graph."""
        return len(self.target_sensations)

    @property
    def num_rows(self) -> int:
        """R, the number of stored motor configurations."""
        return len(self.kernel_q)

    @property
    def kernel_sets(self) -> KernelSets:
        """The kernel sets between which distances are measured: scaled, mu, float32."""
        return KernelSets(self.scaled(self.kernel_q).astype(np.float32), self.kernel_offsets)

    def scaled(self, q: np.ndarray) -> np.ndarray:
        """`(..., J)` mu, scaled configurations, between which distances are measured."""
        return np.asarray(q) * self.joint_scale

    def members(self, kernel: int) -> slice:
        """The rows of `kernel_*` that belong to `kernel`."""
        return slice(int(self.kernel_offsets[kernel]), int(self.kernel_offsets[kernel + 1]))

    def checked_target(self, target: int | None) -> int:
        """`target` as an int; raises a ValueError if it is not the number of a target sensation."""
        if not isinstance(target, int | np.integer) or not 0 <= target < self.num_targets:
            raise ValueError(
                f"target {target} is out of range: give one of 0 to {self.num_targets - 1}, "
                "the targets of this representation"
            )
        return int(target)
