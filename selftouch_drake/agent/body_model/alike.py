"""Kernels that feel alike lie beside each other: a test of their places that asks no joints.

Of many points of several hands some place explains the touches of any kernel, so that no touch
tells that it is wrong. What receptors share does: where a kernel lies far from those that feel most
like it, and these lie together, it is misplaced.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model.scene import Scene, Solution
from selftouch_drake.agent.body_model.who_touched import expected

# Kernels that feel most like one, of its part: fewer say nothing.
_ALIKE, _FEWEST = 8, 4
# A kernel is misplaced if it lies so many times farther from those than they lie from their middle,
# and than half of all kernels lie from theirs. Of 300 right kernels of an iCub none was above 2.6,
# and the wrong ones were at 7 to 22.
_FAR = 3.0
# Kernels are placed anew, and who touched is asked again, so many times at most.
_ROUNDS = 5


@dataclass(frozen=True, slots=True, eq=False)
class Alike:
    """Which kernels feel most alike.

    Attributes:
        near: `(K, N)` of the same part, and feel something in common; -1 where there are no more.
    """

    near: np.ndarray

    @staticmethod
    def of(sensation: csr_array | None, target: np.ndarray, part: np.ndarray) -> "Alike":
        """From what touches felt.

        Args:
            sensation: `(R, S)` readings of the receptors; None: nobody knows what feels alike.
            target: `(R,)` target sensation of each touch.
            part: `(K,)` part of each target sensation.
        """
        near = np.full((len(part), _ALIKE), -1)
        if sensation is None:
            return Alike(near)
        rows = np.arange(len(target))
        whose = csr_array((np.ones(len(rows)), (target, rows)), shape=(len(part), len(rows)))
        felt = (whose @ csr_array(sensation)).toarray()
        felt /= np.maximum(np.linalg.norm(felt, axis=1, keepdims=True), 1e-12)
        for number in np.unique(part):
            own = np.flatnonzero(part == number)
            common = felt[own] @ felt[own].T
            np.fill_diagonal(common, 0.0)
            first = np.argsort(-common, axis=1, kind="stable")[:, :_ALIKE]
            shared = np.take_along_axis(common, first, axis=1) > 0
            near[own, : first.shape[1]] = np.where(shared, own[first], -1)
        return Alike(near)

    def among(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`(K, 3)` the middle of those that feel like each kernel, and `(K,)` how far they are."""
        there = np.where((self.near >= 0)[:, :, None], place[self.near], np.nan)
        enough = np.isfinite(there[:, :, 0]).sum(axis=1) >= _FEWEST
        middle, spread = np.full(place.shape, np.nan), np.full(len(place), np.nan)
        middle[enough] = np.nanmedian(there[enough], axis=1)
        away = np.linalg.norm(there[enough] - middle[enough, None], axis=2)
        spread[enough] = np.nanmedian(away, axis=1)
        return middle, spread

    def misplaced(self, place: np.ndarray) -> np.ndarray:
        """`(K,)` bool, kernels that lie far from those that feel like them."""
        middle, spread = self.among(place)
        away = np.linalg.norm(place - middle, axis=1)
        if not np.isfinite(away).any():
            return np.zeros(len(place), dtype=bool)
        return away > _FAR * np.maximum(spread, np.nanmedian(away))

    def mended(self, scene: Scene, solution: Solution) -> Solution:
        """A solution whose misplaced kernels begin anew where others feel like them."""
        for _ in range(_ROUNDS):
            wrong, middle = self._wrong(solution.place)
            if not wrong.any():
                break
            place = np.where(wrong & np.isfinite(middle), middle, solution.place)
            solution = expected(scene, replace(solution, place=place))
        return solution

    def without_misplaced(self, scene: Scene, solution: Solution) -> Solution:
        """A solution whose misplaced kernels lie where others feel like them, by no touch."""
        wrong, middle = self._wrong(solution.place)
        share = np.where(wrong[scene.target], 0.0, solution.share)
        return replace(solution, share=share, place=np.where(wrong, middle, solution.place))

    def _wrong(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`(K, 1)` bool, misplaced kernels, and `(K, 3)` the middle of the others like each."""
        wrong = self.misplaced(place)[:, None]
        return wrong, self.among(np.where(wrong, np.nan, place))[0]
