"""Online learning: from a stream of touches to the quotient representation (naive).

The agent remembers at most `max_kernel_size` touches of each kernel. A new touch goes to the kernel
with the most similar target sensation; once that kernel is full, it replaces an old touch.
Distances are recomputed for kernels with enough new touches.

When a fifth of the memory is new, or when many touches are unlike every target, the targets are
chosen again from the remembered touches, as in the offline learner: farthest points, each moved to
the centre of its cell. Targets keep their numbers: a new target takes the number of the most
similar old one. Memory and work are bounded: a touch costs the same at any age.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_array
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.representation.kernels import (
    KernelReservoir,
    KernelSample,
    KernelSets,
)
from selftouch_drake.agent.representation.learning import MAX_ROWS, common_targets, with_graph
from selftouch_drake.agent.representation.quantise import assign, strength, unit
from selftouch_drake.agent.representation.quotient import (
    LEAST_KERNELS,
    NO_MODE,
    QuotientRepresentation,
    mattering,
)
from selftouch_drake.agent.representation.relevance import joint_scale, touch_modes
from selftouch_drake.agent.representation.set_distances import set_distances
from selftouch_drake.agent.representation.touches import (
    ambiguous_touches,
    kernel_parts,
    receptors_together,
)

#: Touches before the first targets are chosen, and touches per target until all K are chosen.
_FIRST = 200
_TOUCHES_A_TARGET = 8

#: Targets are chosen again when this share of the memory is new, and modes when this share is.
_NEW, _NEW_FOR_MODES = 0.2, 0.5

#: Targets are also chosen again when the share of new touches that are unlike every target exceeds
#: the former share by this: touches of a skin never felt before may look like touches of several
#: places. Unlike means farther than any touch of one place when targets were last chosen.
_UNLIKE = 0.1

#: Distances of a kernel are recomputed when this share of it is new.
_CHANGED = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Layout:
    """Results that are recomputed now and then from all remembered touches.

    Targets, overlap, part, joint scale and modes are as of `QuotientRepresentation`.

    Attributes:
        chance: whether touches of two places of a part come together by chance.
        reach: greatest cosine distance between a touch of one place and its target.
        unlike: share of touches farther than that at the time: touches of several places at once.
        num_touches: rows of the experience at that time.
        num_held_for_modes: number of remembered touches when modes were last found.
    """

    targets: np.ndarray
    overlap: np.ndarray
    chance: bool
    part: np.ndarray
    joint_scale: np.ndarray
    reach: float
    unlike: float
    mode_joints: np.ndarray
    num_touches: int
    num_held_for_modes: int


class OnlineLearner:
    """Learns motor kernel sets and the quotient graph from a stream of touches.

    The same touches in the same chunks give the same bytes.

    Args:
        num_targets: K, number of target sensations once there are enough touches for them.
        max_kernel_size: most touches remembered per kernel.
        seed: from which all randomness comes.
    """

    def __init__(
        self, num_targets: int = 300, max_kernel_size: int = 1000, *, seed: int = 0
    ) -> None:
        self.num_targets = num_targets
        self._max_kernel_size = max_kernel_size
        self._seed = seed
        # The last one is not a kernel: it holds touches of several places, which are set aside.
        self._memory = KernelReservoir(num_targets + 1, max_kernel_size, seed=seed)
        self._num_set_aside = 0
        self._layout: _Layout | None = None
        #: Remembered touches per kernel, and the new ones since its distances were computed.
        self._size = np.zeros(num_targets + 1, dtype=int)
        self._changed = np.zeros(num_targets + 1, dtype=int)
        self._num_new = self._num_unlike = 0
        self._distance = np.zeros((0, 0), dtype=np.float32)
        self._known: tuple[QuotientRepresentation, csr_array] | None = None

    @property
    def num_touches(self) -> int:
        """Number of touches taken so far."""
        return self._memory.num_rows

    @property
    def knows(self) -> bool:
        """Whether there were enough touches for a representation."""
        return self._layout is not None

    @threadpool_limits.wrap(limits=1, user_api="blas")
    def take(self, q: np.ndarray, sensation: np.ndarray) -> None:
        """Learns from `(n, J)` q in the robot's units, and `(n, S)` N felt there; no row null."""
        if not len(q):
            return
        self._known = None
        label, error = self._labels(sensation)
        self._num_set_aside += int(np.sum(label == self.num_targets))
        taken = self._memory.add(
            label,
            q=np.asarray(q, dtype=np.float32),
            sensation=np.asarray(sensation, dtype=np.float32),
            strength=strength(sensation).astype(np.float32),
            error=error,
            mode=np.full(len(q), self._mode_of_new, dtype=np.int8),
        )
        added = np.bincount(label[taken], minlength=self.num_targets + 1)
        self._size = np.minimum(self._size + added, self._max_kernel_size)
        self._changed += added
        self._num_new += len(taken)
        if self._layout is not None:
            self._num_unlike += int(np.sum(error > self._layout.reach))
        if self._is_due:
            self._lay_out()

    def remembered(self) -> KernelSample:
        """All remembered touches, by kernel: columns q, sensation, strength, error, mode.

        Rows of kernel `num_targets` are touches of several places at once.
        """
        return self._memory.sample()

    @property
    def representation(self) -> QuotientRepresentation:
        """The representation learned so far, of the offline learner's type, without embedding.

        Raises:
            ValueError: there were too few touches.
        """
        return self._learned[0]

    @property
    def kernel_sensation(self) -> csr_array:
        """`(R, S)` unit L2 norm, the sensation at each configuration of `representation`."""
        return self._learned[1]

    @property
    def _is_due(self) -> bool:
        if self._layout is None:
            return self._memory.num_rows >= _FIRST
        new = max(self._memory.num_rows - self._layout.num_touches, _FIRST)
        return self._num_new >= _NEW * self._size.sum() or (
            self._num_unlike >= (self._layout.unlike + _UNLIKE) * new
        )

    @property
    def _mode_of_new(self) -> int:
        """Mode of new touches: the only one, or `NO_MODE` as long as it is unknown."""
        one = self._layout is None or len(self._layout.mode_joints) == 1
        return 0 if one else NO_MODE

    def _labels(self, sensation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`(n,)` the kernel of each touch (`num_targets` if of several places), and its error."""
        if self._layout is None:
            # Spread evenly, so that no kernel is full before the first targets are chosen.
            row = self._memory.num_rows + np.arange(len(sensation))
            return row % self.num_targets, np.zeros(len(sensation), np.float32)
        label, error = assign(sensation, self._layout.targets)
        aside = ambiguous_touches(sensation, self._layout.overlap, self._layout.chance)
        return np.where(aside, self.num_targets, label), error

    @threadpool_limits.wrap(limits=1, user_api="blas")
    def _lay_out(self) -> None:
        """Chooses targets again and assigns each remembered touch to the most similar one."""
        held = self._memory.sample()
        q, sensation = held.columns["q"], held.columns["sensation"]
        some = np.arange(len(q))
        if len(some) > MAX_ROWS:
            rng = np.random.default_rng([self._seed, self._memory.num_rows])
            some = np.sort(rng.choice(some, MAX_ROWS, replace=False))
        overlap, chance = receptors_together(sensation[some])
        aside = ambiguous_touches(sensation, overlap, chance)
        some = some[~aside[some]]
        num_targets = min(len(some) // _TOUCHES_A_TARGET, self.num_targets)
        if num_targets < LEAST_KERNELS:
            return
        old = self._layout
        targets = common_targets(
            sensation[some], num_targets, overlap if chance else None, or_fewer=True
        )
        if old is not None:
            targets = _numbered_as(targets, old.targets)
        label, error = assign(sensation, targets)
        self._memory.relabel(np.where(aside, self.num_targets, label), error=error)
        reach = float(error[some].max())
        layout = _Layout(
            targets=targets,
            overlap=overlap,
            chance=chance,
            part=kernel_parts(targets, overlap),
            joint_scale=joint_scale(q[some], sensation[some]),
            reach=reach,
            unlike=float(np.mean(error > reach)),
            mode_joints=np.ones((1, q.shape[1]), dtype=bool) if old is None else old.mode_joints,
            num_touches=self._memory.num_rows,
            num_held_for_modes=0 if old is None else old.num_held_for_modes,
        )
        if len(q) >= (1.0 + _NEW_FOR_MODES) * layout.num_held_for_modes:
            layout = self._with_modes(layout)
        self._layout = layout
        self._size = np.bincount(self._memory.sample().kernel, minlength=self.num_targets + 1)
        self._distance = np.zeros((len(targets),) * 2, dtype=np.float32)
        self._changed = self._size.copy()
        self._num_new = self._num_unlike = 0
        self._known = None

    def _with_modes(self, layout: _Layout) -> _Layout:
        """Finds the joints that matter to each remembered touch."""
        held = self._memory.sample()
        known = held.first(len(layout.targets))
        mode = np.full(len(held.row), NO_MODE, dtype=np.int8)
        x = (known.columns["q"] * layout.joint_scale).astype(np.float32)
        sets = KernelSets(x, known.offsets(len(layout.targets)))
        mode[: len(x)], mode_joints = touch_modes(
            sets, layout.targets, layout.part, seed=self._seed
        )
        self._memory.relabel(held.kernel, mode=mode)
        return dataclasses.replace(
            layout, mode_joints=mode_joints, num_held_for_modes=len(held.row)
        )

    @property
    @threadpool_limits.wrap(limits=1, user_api="blas")
    def _learned(self) -> tuple[QuotientRepresentation, csr_array]:
        if self._layout is None:
            raise ValueError(
                f"{self._memory.num_rows} touches are too few to learn from: take at least {_FIRST}"
            )
        if self._known is None:
            self._known = self._learn(self._layout)
        return self._known

    def _learn(self, layout: _Layout) -> tuple[QuotientRepresentation, csr_array]:
        """The representation of the touches remembered now."""
        num = len(layout.targets)
        sample = self._memory.sample().first(num)
        q, mode = sample.columns["q"], sample.columns["mode"]
        x = mattering((q * layout.joint_scale).astype(np.float32), mode, layout.mode_joints)
        sets = KernelSets(x, sample.offsets(num))
        changed = self._changed[:num] >= _CHANGED * self._size[:num]
        if changed.any():
            again = set_distances(sets, "quantile", changed=changed)
            self._distance = np.where(changed[:, None] | changed, again, self._distance)
        self._changed[:num][changed] = 0
        learned = with_graph(
            sample,
            sets,
            self._distance,
            target_sensations=layout.targets,
            kernel_mode=mode,
            mode_joints=layout.mode_joints,
            joint_scale=layout.joint_scale,
            overlap=layout.overlap,
            part=layout.part,
            num_touches=self._memory.num_rows,
            num_set_aside=self._num_set_aside,
        )
        return learned.representation, csr_array(unit(sample.columns["sensation"]))


def _numbered_as(targets: np.ndarray, old: np.ndarray) -> np.ndarray:
    """`(K, S)` targets, each with the number of the most similar old one; further ones last."""
    before, now = linear_sum_assignment(-(old @ targets.T))
    now = now[np.argsort(before)]
    return targets[np.concatenate([now, np.setdiff1d(np.arange(len(targets)), now)])]
