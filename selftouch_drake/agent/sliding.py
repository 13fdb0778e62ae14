"""Sliding: from one touch to another without losing contact, by feel (naive).

The straight way between two touching configurations may leave the skin. The agent does not know how
to bend it. But at any touch it can try small movements and notice which ones change how strong the
touch is; along all others it slides. So it moves as straight as it can, and presses more or
less when the touch is weaker or stronger than wanted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from scipy.sparse.csgraph import dijkstra

#: Maps `(n, J)` scaled configurations to the sensations there, `(n, S)` N.
Feel = Callable[[np.ndarray], np.ndarray]

#: Maps `(n, J)` scaled configurations to `(n,)` bool, whether the robot can take them.
Possible = Callable[[np.ndarray], np.ndarray]

#: rad, length of a step, and of a trial to either side. Measured on 51 ways of 2 rad between
#: touches of a forearm with nine joints that matter: 86 % succeed by sliding, 12 % if straight.
_STEP = 0.06
_TRIAL = 0.01

#: It gives up after this multiple of the steps of the straight way, or after the second number.
_MOST_DETOUR, _LEAST_GOES = 4, 30

#: The wanted strength of the touch is interpolated between both ends, but at least this share of
#: the stronger one. The real strength may differ from it by these factors.
_FIRM = 0.6
_LEAST_FELT, _MOST_FELT = 0.3, 3.0

# It gives up if less than this share of the remaining way is along the skin.
_ACROSS = 1e-3

# rad, tolerance for stored float32 configurations.
_SAME = 1e-5

# Number of straight ways checked for a detour before it gives up.
_MOST_CHECKS = 300

# Halvings of a step that loses contact, and corrections of each, before it gives up.
_MOST_HALVINGS, _CORRECTIONS = 5, 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Slides:
    """Ways from one touch to another along which the agent slid.

    N slides through M configurations of J joints in all, scaled (rad).

    Attributes:
        ends: `(N, 2, J)` first and last configuration of each slide.
        offsets: `(N + 1,)` slide n passes rows `offsets[n]:offsets[n + 1]` of `x`.
        x: `(M, J)` touching configurations in between.
        node: `(M,)` the kernel that is felt at each.
    """

    ends: np.ndarray
    offsets: np.ndarray
    x: np.ndarray
    node: np.ndarray

    @classmethod
    def none(cls, num_joints: int) -> Slides:
        """No slides."""
        return cls(
            ends=np.empty((0, 2, num_joints)),
            offsets=np.zeros(1, dtype=int),
            x=np.empty((0, num_joints)),
            node=np.empty(0, dtype=int),
        )

    def check(self, num_joints: int, num_kernels: int) -> None:
        """Checks that these are slides of the given number of joints, between known kernels.

        Raises:
            ValueError: an array does not fit; the text names it.
        """
        num, num_x = max(self.offsets.size - 1, 0), len(np.atleast_1d(self.x))
        shapes = {
            "offsets": (num + 1,),
            "ends": (num, 2, num_joints),
            "x": (num_x, num_joints),
            "node": (num_x,),
        }
        for name, shape in shapes.items():
            array = getattr(self, name)
            whole = name in ("offsets", "node")
            if array.shape != shape or array.dtype.kind not in ("iu" if whole else "f"):
                raise ValueError(
                    f"slide_{name} is {array.dtype} of shape {array.shape}, expected "
                    f"{'whole' if whole else 'real'} numbers of shape {shape}"
                )
            if not np.isfinite(array).all():
                raise ValueError(f"slide_{name} must hold finite numbers")
        ends = self.offsets[[0, -1]].tolist()
        if ends != [0, num_x] or (self.offsets[1:] < self.offsets[:-1]).any():
            raise ValueError(f"slide_offsets must rise from 0 to {num_x}")
        if num_x and not 0 <= self.node.min() <= self.node.max() < num_kernels:
            raise ValueError(f"slide_node must name kernels 0 to {num_kernels - 1}")

    def and_also(
        self, x_from: np.ndarray, x_to: np.ndarray, x: np.ndarray, node: np.ndarray
    ) -> Slides:
        """These slides and one more: its first and last configuration, and what it passes."""
        return Slides(
            ends=np.concatenate([self.ends, np.stack([x_from, x_to])[None]]),
            offsets=np.append(self.offsets, self.offsets[-1] + len(x)),
            x=np.concatenate([self.x, x]),
            node=np.concatenate([self.node, node]),
        )

    def between(self, x_from: np.ndarray, x_to: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The known slide between two configurations: `(m, J)` rad and `(m,)` kernels.

        Joints that do not move on a slide may have any position; m is 0 if no slide is known.
        """
        slide = _latest(self.ends, x_from, x_to)
        if slide < 0:
            return self.x[:0], self.node[:0]
        rows = slice(*self.offsets[slide : slide + 2])
        moved = self.ends[slide, 0] != self.ends[slide, 1]
        return np.where(moved, self.x[rows], x_from), self.node[rows]

    def all_between(self, x_from: np.ndarray, x_to: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `between`, with later slides that replaced parts of the slide."""
        passed, felt = self.between(x_from, x_to)
        if not len(passed):
            return passed, felt
        way = [x_from, *passed, x_to]
        parts = [self.between(*ends) for ends in pairwise(way)]
        x = [x for (mend, _), at in zip(parts, way[1:], strict=True) for x in (*mend, at)]
        node = [n for (_, mend), at in zip(parts, [*felt, -1], strict=True) for n in (*mend, at)]
        return np.array(x[:-1]), np.array(node[:-1])

    def within(self, lower: np.ndarray, upper: np.ndarray) -> Slides:
        """The slides that stay between `lower` and `upper`, `(J,)` each."""
        outside = np.any((self.x < lower) | (self.x > upper), axis=1)
        passed = pairwise(self.offsets.tolist())
        kept = np.array([not bool(outside[a:b].any()) for a, b in passed], dtype=bool)
        sizes = np.diff(self.offsets)
        rows = np.repeat(kept, sizes)
        return Slides(
            ends=self.ends[kept],
            offsets=np.concatenate([[0], np.cumsum(sizes[kept])]),
            x=self.x[rows],
            node=self.node[rows],
        )


@njit(cache=True)
def _latest(ends, x_from, x_to):
    """The last of the slides with these ends, or -1."""
    for slide in range(len(ends) - 1, -1, -1):
        start, end = ends[slide]
        same = True
        for j in range(len(start)):
            if start[j] == end[j]:
                off = abs(x_to[j] - x_from[j])
            else:
                off = max(abs(start[j] - x_from[j]), abs(end[j] - x_to[j]))
            if off >= _SAME:
                same = False
                break
        if same:
            return slide
    return -1


@dataclass(frozen=True, slots=True, eq=False)
class Slider:
    """Slides by feel.

    Attributes:
        feel: returns the sensations at configurations.
        possible: returns whether the robot can take configurations.
        lower: `(J,)` rad, scaled lower limits of the joints.
        upper: `(J,)` rad, scaled upper limits.
    """

    feel: Feel
    possible: Possible
    lower: np.ndarray
    upper: np.ndarray

    def slide(self, x_from: np.ndarray, x_to: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Slides from one touching configuration to another; only joints that differ move.

        Args:
            x_from: `(J,)` rad, scaled.
            x_to: `(J,)` rad, scaled.

        Returns:
            `(M, J)` rad, touching configurations in between, about 0.06 rad apart, and `(M, S)` N,
            the sensations there; None if it did not arrive.
        """
        joints = np.flatnonzero(x_from != x_to)
        felt, at_end = self.feel(np.stack([x_from, x_to]))
        start, end = _strength(np.stack([felt, at_end]))
        if not (start > 0 and end > 0 and self.possible(x_to[None])[0]):
            return None
        whole = float(np.linalg.norm(x_to - x_from))
        x, passed = x_from, list[tuple[np.ndarray, np.ndarray]]()
        for _ in range(max(round(_MOST_DETOUR * whole / _STEP), _LEAST_GOES)):
            rest = float(np.linalg.norm(x_to - x))
            if rest < 1.5 * _STEP:
                xs = np.array([x for x, _ in passed]).reshape(-1, len(x))
                return xs, np.array([f for _, f in passed]).reshape(-1, len(felt))
            wanted = end + (start - end) * min(rest / whole, 1.0)
            found = self._go(x, x_to, felt, max(wanted, _FIRM * max(start, end)), joints)
            if found is None:
                return None
            x, felt = found
            passed.append(found)
        return None

    def detour(self, x_from: np.ndarray, x_to: np.ndarray, over: np.ndarray) -> np.ndarray | None:
        """Finds a way through the air, via some configurations, that the robot can take everywhere.

        It checks the shortest way, removes the parts that are impossible, and repeats (lazy
        probabilistic roadmap, Bohlin and Kavraki 2000).

        Args:
            x_from: `(J,)` rad, scaled.
            x_to: `(J,)` rad, scaled.
            over: `(n, J)` rad, scaled configurations that it may pass.

        Returns:
            `(m, J)` the configurations that it passes, at least one; None if no way was found.
        """
        x = np.concatenate([x_from[None], over, x_to[None]])
        length = np.linalg.norm(x[:, None] - x, axis=2)
        goal = len(x) - 1
        length[0, goal] = length[goal, 0] = 0.0  # no edge: the straight way is not a detour
        checked = np.zeros(length.shape, dtype=bool)
        for _ in range(_MOST_CHECKS):
            total, before = dijkstra(length, indices=0, return_predecessors=True)
            if not np.isfinite(total[goal]):
                return None
            way = [goal]
            while way[-1] != 0:
                way.append(int(before[way[-1]]))
            way.reverse()
            unsure = [(i, j) for i, j in pairwise(way) if not checked[i, j]]
            if not unsure:
                return x[way[1:-1]]
            i, j = unsure[0]
            checked[i, j] = checked[j, i] = True
            if not self.possible(straight(x[i], x[j])).all():
                length[i, j] = length[j, i] = 0.0
        return None

    def slope(self, x: np.ndarray, joints: np.ndarray | None = None) -> np.ndarray:
        """`(J,)` N/rad, how fast the strength of the touch grows at `(J,)` x along each joint.

        Joints that are not in `joints` get 0; by default all are tried.
        """
        joints = np.arange(len(x)) if joints is None else joints
        trials = np.zeros((len(joints), len(x)))
        trials[np.arange(len(joints)), joints] = _TRIAL
        tried = self.within(np.concatenate([x + trials, x - trials]))
        more, less = np.split(_strength(self.feel(tried)), 2)
        apart = np.linalg.norm(np.subtract(*np.split(tried, 2)), axis=1)
        slope = np.zeros(len(x))
        slope[joints] = np.divide(more - less, apart, out=np.zeros(len(apart)), where=apart > 0)
        return slope

    def within(self, x: np.ndarray) -> np.ndarray:
        """`(..., J)` the nearest positions within the limits of the joints."""
        return x.clip(self.lower, self.upper)

    def _go(
        self, x: np.ndarray, x_to: np.ndarray, felt: np.ndarray, wanted: float, joints: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """The next configuration and the sensation there; None if it gives up."""
        slope = self.slope(x, joints)
        steepness = float(np.linalg.norm(slope))
        if not steepness > 0:
            return None
        up = slope / steepness
        along = (x_to - x) - up * (up @ (x_to - x))
        length = float(np.linalg.norm(along))
        if length < _ACROSS * np.linalg.norm(x_to - x):
            return None
        step = min(_STEP, length)
        for _ in range(_MOST_HALVINGS + 1):
            press = np.clip((wanted - _strength(felt)) / steepness, -0.5 * step, 0.5 * step)
            there = self.within(x + step / length * along + press * up)
            for _ in range(_CORRECTIONS):
                (now,) = self.feel(there[None])
                share = float(_strength(now)) / wanted
                if _LEAST_FELT < share < _MOST_FELT:
                    if self.possible(there[None])[0]:
                        return there, now
                    break
                correction = np.clip((1.0 - share) * wanted / steepness, -step, step)
                there = self.within(there + correction * up)
            step /= 2
        return None


def straight(x_from: np.ndarray, x_to: np.ndarray) -> np.ndarray:
    """`(n, J)` rad, scaled configurations on the straight way, about 0.06 rad apart."""
    count = 2 + int(np.linalg.norm(x_to - x_from) / _STEP)
    return x_from + np.linspace(0.0, 1.0, count)[:, None] * (x_to - x_from)


def _strength(sensation: np.ndarray) -> np.ndarray:
    return np.linalg.norm(sensation, axis=-1)
