"""Sliding: from one touch to another without letting go, by feel (naive).

Between two configurations that touch, the straight way may leave the skin. The agent does not know
how to bend it. But in any touch it can try which small movements make it feel more, and which less:
along all others it slides. So it goes as straight as it can, and presses on or yields as it feels
less or more than it wants.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse.csgraph import dijkstra

#: Tells what is felt, `(n, S)` N, in `(n, J)` scaled configurations.
Feel = Callable[[np.ndarray], np.ndarray]

#: Tells, `(n,)` bool, which of `(n, J)` scaled configurations the robot can take.
Possible = Callable[[np.ndarray], np.ndarray]

#: rad, how far it goes at a time, and how far it tries to either side. Of 51 steps of 2 rad between
#: touches of a forearm, nine joints of which matter, 86 % are slid along; of straight ones, 12 %.
_STEP = 0.06
_TRIAL = 0.01

#: Goes at a time of which it gives up, as a multiple of those of the straight way, and at least.
_MOST_DETOUR, _LEAST_GOES = 4, 30

#: What is wanted is between what is felt at the ends, but no less than this share of the stronger;
#: what is felt may be off by these factors.
_FIRM = 0.6
_LEAST_FELT, _MOST_FELT = 0.3, 3.0

# If less than this share of the way is along the skin, it gives up.
_ACROSS = 1e-3

# rad, rounding error of stored float32 configurations.
_SAME = 1e-5

# Straight ways that are looked at for a detour, before it gives up.
_MOST_CHECKS = 300

# Halvings of a step that loses touch, and corrections of each, before it gives up.
_MOST_HALVINGS, _CORRECTIONS = 5, 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Slides:
    """Ways from one touch to another that were slid along.

    N slides through M configurations of J joints in all, scaled (rad).

    Attributes:
        ends: `(N, 2, J)` from where and to where.
        offsets: `(N + 1,)` slide n passes rows `offsets[n]:offsets[n + 1]`.
        x: `(M, J)` the touching configurations that it passes.
        node: `(M,)` the kernel that is felt in each.
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
        """Refuses what are no slides of so many joints and kernels.

        Raises:
            ValueError: the text names the array.
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
                raise ValueError(f"slide_{name} is not an array of slides")
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
        """One slide more: from where, to where, and what it passes."""
        return Slides(
            ends=np.concatenate([self.ends, np.stack([x_from, x_to])[None]]),
            offsets=np.append(self.offsets, self.offsets[-1] + len(x)),
            x=np.concatenate([self.x, x]),
            node=np.concatenate([self.node, node]),
        )

    def between(self, x_from: np.ndarray, x_to: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What is passed between two configurations: `(m, J)` rad and `(m,)` kernels.

        Joints that do not move on a slide may be anywhere; m is 0 where no slide is known.
        """
        ends = np.stack([x_from, x_to])
        moved = self.ends[:, 0] != self.ends[:, 1]
        off = np.where(moved, np.abs(self.ends - ends).max(axis=1), np.abs(x_to - x_from))
        known = np.flatnonzero(off.max(axis=1, initial=0.0) < _SAME)
        if not len(known):
            return self.x[:0], self.node[:0]
        rows = slice(*self.offsets[known[-1] : known[-1] + 2])
        return np.where(moved[known[-1]], self.x[rows], x_from), self.node[rows]

    def all_between(self, x_from: np.ndarray, x_to: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `between`, with the slides that mend a part of a slide."""
        passed, felt = self.between(x_from, x_to)
        if not len(passed):
            return passed, felt
        way = [x_from, *passed, x_to]
        parts = [self.between(*ends) for ends in pairwise(way)]
        x = [x for (mend, _), at in zip(parts, way[1:], strict=True) for x in (*mend, at)]
        node = [n for (_, mend), at in zip(parts, [*felt, -1], strict=True) for n in (*mend, at)]
        return np.array(x[:-1]), np.array(node[:-1])

    def within(self, lower: np.ndarray, upper: np.ndarray) -> Slides:
        """Those that pass nothing below `lower` or above `upper` `(J,)`."""
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


@dataclass(frozen=True, slots=True, eq=False)
class Slider:
    """Slides by feel.

    Attributes:
        feel: what is felt in a configuration.
        possible: whether the robot can take it.
        lower: `(J,)` rad, scaled, of the joints.
        upper: `(J,)` rad, likewise.
    """

    feel: Feel
    possible: Possible
    lower: np.ndarray
    upper: np.ndarray

    def slide(self, x_from: np.ndarray, x_to: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Goes from one touching configuration to another, by the joints that are not the same.

        Args:
            x_from: `(J,)` rad, scaled.
            x_to: `(J,)` rad, scaled.

        Returns:
            `(M, J)` rad, the touching configurations in between, some 0.06 rad apart, and `(M, S)`
            N, what is felt there; None if the way is lost.
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
        """A way through the air, over some configurations, on which the robot can be everywhere.

        The shortest one is looked at, what is impossible of it is struck out, and so on (lazy
        probabilistic roadmap, Bohlin and Kavraki 2000).

        Args:
            x_from: `(J,)` rad, scaled.
            x_to: `(J,)` rad, scaled.
            over: `(n, J)` rad, scaled, that it may go over.

        Returns:
            `(m, J)` those it goes over, at least one; None if no way was found.
        """
        x = np.concatenate([x_from[None], over, x_to[None]])
        length = np.linalg.norm(x[:, None] - x, axis=2)
        goal = len(x) - 1
        length[0, goal] = length[goal, 0] = 0.0  # no edge: the straight way is no detour
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
        """`(J,)` N/rad, by how much more is felt along each joint at `(J,)` x, or along some."""
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
        """`(..., J)` the nearest that the joints can take."""
        return x.clip(self.lower, self.upper)

    def _go(
        self, x: np.ndarray, x_to: np.ndarray, felt: np.ndarray, wanted: float, joints: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """The next configuration, and what is felt there."""
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
    """`(n, J)` rad, scaled, the straight way, some 0.06 rad apart."""
    count = 2 + int(np.linalg.norm(x_to - x_from) / _STEP)
    return x_from + np.linspace(0.0, 1.0, count)[:, None] * (x_to - x_from)


def _strength(sensation: np.ndarray) -> np.ndarray:
    return np.linalg.norm(sensation, axis=-1)
