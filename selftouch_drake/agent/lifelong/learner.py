"""Online learning: from a stream of touches to the quotient representation (naive).

A new touch goes to the kernel with the most similar target sensation; once that kernel is full, it
replaces an old touch. Distances are recomputed for kernels with enough new touches. When a fifth of
the memory is new, or when many touches are unlike every target, the targets are chosen again from
the remembered touches, as in the offline learner; a new target takes the number of the most similar
old one. Memory and work are bounded: a touch costs the same at any age.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_array
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.representation.learning import Findings, joined, represented
from selftouch_drake.agent.representation.quotient import (
    LEAST_OF_PART,
    NO_MODE,
    QuotientRepresentation,
    mattering,
)
from selftouch_drake.agent.representation.relevance import touch_modes
from selftouch_drake.agent.representation.reservoir import KernelReservoir, KernelSample
from selftouch_drake.agent.representation.several_places import common_targets
from selftouch_drake.agent.representation.touches import (
    kernel_parts,
    receptors_together,
)
from selftouch_drake.quotient.distances import set_distances
from selftouch_drake.quotient.kernels import KernelSets
from selftouch_drake.quotient.learn import MAX_ROWS
from selftouch_drake.quotient.scale import joint_scale
from selftouch_drake.quotient.sensations import assign, strength, unit

#: Touches before the first targets are chosen.
_FIRST = 200

#: Touches per target until all K targets are chosen.
_TOUCHES_PER_TARGET = 8

#: Targets are chosen again when this share of the memory is new.
_NEW = 0.2

#: Modes are found again when the memory has grown by this share.
_NEW_FOR_MODES = 0.5

#: Targets are also chosen again when the share of new touches that are unlike every target exceeds
#: the former share by this: touches of a skin never felt before may look like touches of several
#: places. Unlike means farther than any touch of one place when targets were last chosen.
_UNLIKE = 0.1

#: Distances of a kernel are recomputed when this share of it is new.
_CHANGED = 0.1


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
        # Chosen now and then, as in `QuotientRepresentation`; and the number of touches then.
        self._targets = np.zeros((0, 0), dtype=np.float32)
        self._part = self._joint_scale = np.zeros(0)
        self._together, self._laid_out_at = receptors_together(np.zeros((1, 1))), 0
        # Greatest cosine distance between a touch of one place and its target; share of touches
        # farther than that at that time: touches of several places at once.
        self._reach = self._unlike = 0.0
        # `(M, J)` bool, and the number of remembered touches in which they were found.
        self._mode_joints, self._num_held_for_modes = np.ones((1, 0), dtype=bool), 0
        # Remembered touches per kernel, and the new ones since its distances were computed.
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
        return len(self._targets) > 0

    @threadpool_limits.wrap(limits=1, user_api="blas")
    def take(self, q: np.ndarray, sensation: np.ndarray) -> None:
        """Learns from `(n, J)` q in the robot's units, and `(n, S)` N felt there; no row null."""
        if not len(q):
            return
        self._known = None
        row, felt = np.arange(len(q)), sensation
        if self.knows:
            row, of_pools, aside = self._together.places(sensation)
            felt = self._together.receptors(sensation, row, of_pools)
            label, error = assign(felt, self._targets)
            label = np.where(aside, self.num_targets, label)
            self._num_unlike += int(np.sum(error > self._reach))
        else:
            # Spread evenly, so that no kernel is full before the first targets are chosen.
            label = (self.num_touches + np.arange(len(q))) % self.num_targets
            error = np.zeros(len(q), np.float32)
        self._num_set_aside += int(np.sum(label == self.num_targets))
        # The mode of new touches is unknown, unless there is only one.
        mode = 0 if len(self._mode_joints) == 1 else NO_MODE
        taken = self._memory.add(
            label,
            row=row,
            q=np.asarray(q, dtype=np.float32)[row],
            sensation=np.asarray(sensation, dtype=np.float32)[row],
            strength=strength(felt).astype(np.float32),
            error=error,
            mode=np.full(len(row), mode, dtype=np.int8),
        )
        added = np.bincount(taken, minlength=self.num_targets + 1)
        self._size = np.minimum(self._size + added, self._max_kernel_size)
        self._changed += added
        self._num_new += len(taken)
        if self._targets_are_due():
            self._lay_out()

    def _targets_are_due(self) -> bool:
        """Whether it is time to choose targets, for the first time or again."""
        if not self.knows:
            return self.num_touches >= _FIRST
        if self._num_new >= _NEW * self._size.sum():
            return True
        touches_since = max(self.num_touches - self._laid_out_at, _FIRST)
        return self._num_unlike >= (self._unlike + _UNLIKE) * touches_since

    def remembered(self) -> KernelSample:
        """All remembered touches, by kernel: columns q, sensation, strength, error, mode.

        Rows of kernel `num_targets` are touches of several places at once.
        """
        return self._memory.sample()

    @property
    def representation(self) -> QuotientRepresentation:
        """The representation learned so far, of the offline learner's type.

        Raises:
            ValueError: there were too few touches.
        """
        return self._learn()[0]

    @property
    def kernel_sensation(self) -> csr_array:
        """`(R, S)` unit L2 norm, the sensation at each configuration of `representation`."""
        return self._learn()[1]

    def _lay_out(self) -> None:
        """Chooses targets again and assigns each remembered touch to the most similar one."""
        held = self.remembered()
        first = held.distinct
        q, sensation = held.columns["q"][first], held.columns["sensation"][first]
        some = self._some_of(len(q))
        together = receptors_together(sensation[some])
        touch, of_pools, aside = together.places(sensation)
        felt = together.receptors(sensation, touch, of_pools)
        known = ~aside & np.isin(touch, some)
        num_targets = min(int(known.sum()) // _TOUCHES_PER_TARGET, self.num_targets)
        if num_targets < LEAST_OF_PART:
            return
        overlap = together.overlap
        targets = common_targets(felt[known], num_targets, overlap, together.chance, or_fewer=True)
        if self.knows:
            targets = targets[_numbered_alike(self._targets, targets)]
        else:
            self._mode_joints = np.ones((1, q.shape[1]), dtype=bool)
        label, error = assign(felt, targets)
        of = first[touch]
        self._memory.relabel(
            np.where(aside, self.num_targets, label),
            of,
            strength=strength(felt).astype(np.float32),
            error=error,
            mode=np.where(together.double, NO_MODE, held.columns["mode"][of]),
        )
        self._targets, self._together = targets, together
        self._part = kernel_parts(targets, overlap)
        some = np.unique(touch[known])
        self._joint_scale = joint_scale(q[some], sensation[some])
        self._reach = float(error[known].max())
        self._unlike = float(np.mean(error > self._reach))
        self._laid_out_at = self.num_touches
        held = self.remembered()
        if together.double or len(q) >= (1.0 + _NEW_FOR_MODES) * self._num_held_for_modes:
            self._find_modes(held)
        self._size = np.bincount(held.kernel, minlength=self.num_targets + 1)
        self._distance = np.zeros((len(targets),) * 2, dtype=np.float32)
        self._changed = self._size.copy()
        self._num_new = self._num_unlike = 0

    def _some_of(self, num_touches: int) -> np.ndarray:
        """The numbers of some of the remembered touches, ascending: all if they are few."""
        if num_touches <= MAX_ROWS:
            return np.arange(num_touches)
        rng = np.random.default_rng([self._seed, self.num_touches])
        return np.sort(rng.choice(np.arange(num_touches), MAX_ROWS, replace=False))

    def _find_modes(self, held: KernelSample) -> None:
        """Finds the joints that matter to each remembered touch."""
        known = held.first(len(self._targets))
        x = (known.columns["q"] * self._joint_scale).astype(np.float32)
        sets = KernelSets(x, known.offsets(len(self._targets)))
        mode = np.full(len(held.row), NO_MODE, dtype=np.int8)
        mode[: len(x)], self._mode_joints = touch_modes(
            sets, self._targets, self._part, self._together.double, seed=self._seed
        )
        self._memory.relabel(held.kernel, np.arange(len(mode)), mode=mode)
        self._num_held_for_modes = len(held.row)

    @threadpool_limits.wrap(limits=1, user_api="blas")
    def _learn(self) -> tuple[QuotientRepresentation, csr_array]:
        """The representation of the touches remembered now, and what was felt in them."""
        if not self.knows:
            raise ValueError(
                f"{self.num_touches} touches are too few to learn from: take at least {_FIRST}"
            )
        if self._known is not None:
            return self._known
        num = len(self._targets)
        sample = self.remembered().first(num)
        q, mode = sample.columns["q"], sample.columns["mode"]
        x = mattering((q * self._joint_scale).astype(np.float32), mode, self._mode_joints)
        sets = KernelSets(x, sample.offsets(num))
        changed = self._changed[:num] >= _CHANGED * self._size[:num]
        if changed.any():
            again = set_distances(sets, "quantile", changed=changed)
            self._distance = np.where(changed[:, None] | changed, again, self._distance)
        self._changed[:num][changed] = 0
        graph = joined(sets, sample, self._distance, self._targets, self._part)
        found = Findings(
            targets=self._targets,
            joint_scale=self._joint_scale,
            kernel_mode=mode,
            mode_joints=self._mode_joints,
            overlap=self._together.overlap,
            part=self._part,
            num_touches=self.num_touches,
            num_set_aside=self._num_set_aside,
        )
        learned = represented(sets, sample, self._distance, graph, found)
        self._known = learned.representation, csr_array(unit(sample.columns["sensation"]))
        return self._known


def _numbered_alike(old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """`(K,)` the order in which new targets take the numbers of the most similar old ones.

    Further ones come last.
    """
    before, now = linear_sum_assignment(-(old @ new.T))
    now = now[np.argsort(before)]
    return np.concatenate([now, np.setdiff1d(np.arange(len(new)), now)])
