"""Firm touches as a roadmap: a way over the skin that turns the arm over where it must.

Not every posture of a touch slides into every other: an elbow that is up comes down only where the
arm is straight. The touches that the agent lived are postures of all kinds; steps between near ones
are tried in imagination, once (probabilistic roadmap, Kavraki et al. 1996).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.lift import Lifter

# Touches in the roadmap, and those that each is joined to.
_MOST, _JOINED = 3000, 14
# Distances count with this power: many small steps are better than a leap.
_POWER = 1.5
# mu between samples of a step that is tried.
_SAMPLED = 0.3
# Samples of a step may be so many times as far from each other as if it were straight, and so far
# from the skin, in distances of kernels.
_JUMP, _OFF = 2.5, 0.1
# Steps that are tried at once.
_AT_ONCE = 4000
# What is known of a step.
_UNKNOWN, _IMPOSSIBLE = -1, 0
# Ways that are tried before all steps are, and ways round own parts.
_ROUNDS, _DETOURS = 60, 10
# A step on which own parts are too deep in each other costs so many times as much.
_DEEPER = 10.0


class Roadmap:
    """Possible steps between firm touches of one toucher on one part.

    A step is tried when a way first leads over it, and what came of it is remembered.

    Args:
        lifter: the skin, the toucher and its kinematics.
        x: `(n, J)` scaled postures of its firm touches.
        random: chooses touches if there are too many.
    """

    def __init__(self, lifter: Lifter, x: np.ndarray, random: np.random.Generator) -> None:
        self._lifter, self._surface = lifter, lifter.surface
        self._x = x[np.sort(random.permutation(len(x))[:_MOST])]
        self._key = self._keys(self._x)
        self._tree = cKDTree(self._key)
        near = self._tree.query(self._key, k=min(_JOINED + 1, len(self._key)))[1][:, 1:]
        first = np.repeat(np.arange(len(self._key)), near.shape[1])
        pairs = np.unique(np.sort(np.stack([first, near.ravel()], axis=1), axis=1), axis=0)
        self._steps = _Steps.between(self._key, pairs)

    def way(
        self,
        x_start: np.ndarray,
        x_goals: np.ndarray,
        too_deep: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> np.ndarray | None:
        """A way of possible steps from one touch to the cheapest of others.

        Args:
            x_start: `(J,)` scaled posture.
            x_goals: `(g, J)` likewise.
            too_deep: says of `(n, J)` postures in which of them own parts are too deep in each
                other; where there is a choice the way avoids these.

        Returns:
            `(m, J)` postures close together, on the skin; joints that are not of the reach are
            those of the start. None if there is no way.
        """
        joints, num = self._surface.reach.joints, len(self._key)
        ends = np.repeat(x_start[None], 1 + len(x_goals), axis=0)
        ends[1:, joints] = x_goals[:, joints]
        x = np.concatenate([self._x, ends])
        x[:, np.delete(np.arange(x.shape[1]), joints)] = np.delete(x_start, joints)
        key = np.concatenate([self._key, self._keys(ends)])
        near = self._tree.query(key[num:], k=min(_JOINED, num))[1]
        own = np.stack([near.ravel(), np.repeat(num + np.arange(len(ends)), near.shape[1])], axis=1)
        steps = self._steps.joined(_Steps.between(key, own))
        found = self._clear_way(x, steps, num, too_deep)
        self._steps.possible[:] = steps.possible[: len(self._steps.pairs)]
        return found

    def _clear_way(
        self,
        x: np.ndarray,
        steps: "_Steps",
        start: int,
        too_deep: Callable[[np.ndarray], np.ndarray] | None,
    ) -> np.ndarray | None:
        """The postures of `_possible_way`, by a way round where own parts are too deep."""
        cost, first = steps.cost.copy(), None
        for _ in range(_DETOURS):
            passed = self._possible_way(x, steps, cost, start)
            if passed is None:
                return None
            samples, count, _ = self._sampled(x[passed[:-1]], x[passed[1:]])
            on_skin = self._put(samples)[0]
            on_skin[0] = x[start]
            first = on_skin if first is None else first
            if too_deep is None:
                return first
            deep = too_deep(on_skin)
            if not deep.any():
                return on_skin
            step_of = np.repeat(steps.numbers(passed), count)
            cost[np.unique(step_of[deep])] *= _DEEPER
        return first

    def _possible_way(
        self, x: np.ndarray, steps: "_Steps", cost: np.ndarray, start: int
    ) -> list[int] | None:
        """The cheapest way from a posture to any after it, by number; its steps are possible.

        Fills in which steps are.
        """
        for tried in range(_ROUNDS + 1):
            passed = steps.way(cost, start, len(x))
            if passed is None:
                return None
            own = steps.numbers(passed)
            # If no end is in sight, all are tried at once.
            asked = own if tried < _ROUNDS else np.arange(len(steps.pairs))
            asked = asked[steps.possible[asked] == _UNKNOWN]
            a, b = steps.pairs[asked].T
            steps.possible[asked] = self._possible(x[a], x[b])
            if (steps.possible[own] != _IMPOSSIBLE).all():
                return passed
        return steps.way(cost, start, len(x))

    def _possible(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """`(n,)` bool, straight steps between `(n, J)` postures that can be put onto the skin."""
        found = [np.zeros(0, dtype=bool)]
        for at in range(0, len(start), _AT_ONCE):
            some = slice(at, at + _AT_ONCE)
            samples, count, straight = self._sampled(start[some], end[some])
            x, off = self._put(samples)
            ends = np.cumsum([0, *count])
            step = np.linalg.norm(np.diff(x, axis=0, append=x[-1:]), axis=1)
            step[ends[1:] - 1] = 0.0  # from one step to the next
            longest = np.maximum.reduceat(step, ends[:-1])
            farthest = np.maximum.reduceat(off, ends[:-1])
            found.append((longest <= _JUMP * straight) & (farthest <= _OFF))
        return np.concatenate(found)

    def _sampled(
        self, start: np.ndarray, end: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Samples of n straight steps, one after another, `(m, J)`.

        And `(n,)` how many are of each step, and the mu between two of them, at least 0.1.
        """
        length = np.linalg.norm((end - start)[:, self._surface.reach.joints], axis=1)
        count = np.maximum(np.ceil(length / _SAMPLED).astype(int) + 1, 2)
        step = np.repeat(np.arange(len(count)), count)
        number = np.arange(len(step)) - (np.cumsum(count) - count)[step]
        share = number / (count - 1)[step]
        samples = start[step] + share[:, None] * (end - start)[step]
        return samples, count, np.maximum(length / (count - 1), 0.1)

    def _put(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Postures `(n, J)` put onto the skin below them, and how far they miss it.

        That is in distances of kernels, above it or beyond its edge.
        """
        on_it, normal = self._surface.projected(self._lifter.centres(x))
        # From afar, planes lead beside the surface; from there, onto it.
        on_it, normal = self._surface.projected(on_it)
        x = self._lifter.put(x, on_it, normal, steps=5)
        at = self._lifter.places(x, normal)[0]
        off = np.linalg.norm(at - self._surface.projected(at)[0], axis=1) / self._surface.spacing
        return x, np.maximum(off, self._surface.beyond(at))

    def _keys(self, x: np.ndarray) -> np.ndarray:
        """`(n, 3 + L)`: distances of kernels on the skin count as mu in the joints."""
        place = self._surface.projected(self._lifter.centres(x))[0]
        joints = self._surface.reach.joints
        return np.concatenate([place / self._surface.spacing, x[:, joints]], axis=1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Steps:
    """Steps between touches: E steps.

    Attributes:
        pairs: `(E, 2)` touches by number, the first below the second.
        cost: `(E,)` of each step.
        possible: `(E,)` `_UNKNOWN` until a step was tried, then whether it is possible.
    """

    pairs: np.ndarray
    cost: np.ndarray
    possible: np.ndarray

    @classmethod
    def between(cls, key: np.ndarray, pairs: np.ndarray) -> "_Steps":
        """Steps that nobody tried between touches at `(n, D)` keys."""
        cost = np.linalg.norm(key[pairs[:, 0]] - key[pairs[:, 1]], axis=1) ** _POWER
        return cls(pairs=pairs, cost=cost, possible=np.full(len(pairs), _UNKNOWN, dtype=np.int8))

    def joined(self, other: "_Steps") -> "_Steps":
        """With others after them."""
        return _Steps(
            pairs=np.concatenate([self.pairs, other.pairs]),
            cost=np.concatenate([self.cost, other.cost]),
            possible=np.concatenate([self.possible, other.possible]),
        )

    def way(self, cost: np.ndarray, start: int, num: int) -> list[int] | None:
        """The cheapest way from a touch to any after it, of `num`; None if there is none."""
        kept = self.possible != _IMPOSSIBLE
        first, second = self.pairs[kept].T
        graph = csr_array((cost[kept], (first, second)), shape=(num, num))
        total, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
        last = start + 1 + int(total[start + 1 :].argmin())
        if not np.isfinite(total[last]):
            return None
        passed = [last]
        while passed[-1] != start:
            passed.append(int(before[passed[-1]]))
        return passed[::-1]

    def numbers(self, passed: list[int]) -> np.ndarray:
        """The steps of a way, by number."""
        ends = np.sort(np.stack([passed[:-1], passed[1:]], axis=1), axis=1)
        most = int(self.pairs.max()) + 1
        code, own = self.pairs @ [most, 1], ends @ [most, 1]
        order = np.argsort(code, kind="stable")
        return order[np.searchsorted(code, own, sorter=order)]
