"""Firm touches as a roadmap: a way over the skin that turns the arm over where it must.

Not every posture of a touch slides into every other: an elbow that is up comes down only where the
arm is straight. The touches that the agent lived are postures of all kinds; steps between near ones
are tried in imagination, once (probabilistic roadmap, Kavraki et al. 1996).
"""

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


class Roadmap:
    """Possible steps between firm touches of one toucher on one part.

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
        possible = self._possible(self._x[pairs[:, 0]], self._x[pairs[:, 1]])
        self._pairs = pairs[possible]
        self._cost = self._costs(self._key, self._pairs)

    def way(self, x_start: np.ndarray, x_goals: np.ndarray) -> np.ndarray | None:
        """A way of possible steps from one touch to the cheapest of others.

        Args:
            x_start: `(J,)` scaled posture.
            x_goals: `(g, J)` likewise.

        Returns:
            `(m, J)` postures close together, on the skin; joints that are not of the reach are
            those of the start. None if there is no way.
        """
        joints, num = self._surface.reach.joints, len(self._key)
        ends = np.repeat(x_start[None], 1 + len(x_goals), axis=0)
        ends[1:, joints] = x_goals[:, joints]
        x = np.concatenate([self._x, ends])
        key = np.concatenate([self._key, self._keys(ends)])
        near = self._tree.query(key[num:], k=min(_JOINED, num))[1]
        own = np.stack([near.ravel(), np.repeat(num + np.arange(len(ends)), near.shape[1])], axis=1)
        own = own[self._possible(x[own[:, 0]], x[own[:, 1]])]
        pairs = np.concatenate([self._pairs, own])
        cost = np.concatenate([self._cost, self._costs(key, own)])
        graph = csr_array((cost, (pairs[:, 0], pairs[:, 1])), shape=(len(x), len(x)))
        total, before = dijkstra(graph, directed=False, indices=num, return_predecessors=True)
        last = num + 1 + int(total[num + 1 :].argmin())
        if not np.isfinite(total[last]):
            return None
        passed = [last]
        while passed[-1] != num:
            passed.append(int(before[passed[-1]]))
        through = x[passed[::-1]]
        through[:, np.delete(np.arange(x.shape[1]), joints)] = np.delete(x_start, joints)
        samples, _ = self._sampled(through[:-1], through[1:])
        on_skin = self._put(np.concatenate(samples))[0]
        on_skin[0] = x_start
        return on_skin

    def _possible(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """`(n,)` bool, straight steps between `(n, J)` postures that can be put onto the skin."""
        found = [np.zeros(0, dtype=bool)]
        for at in range(0, len(start), _AT_ONCE):
            some = slice(at, at + _AT_ONCE)
            samples, straight = self._sampled(start[some], end[some])
            x, off = self._put(np.concatenate(samples))
            ends = np.cumsum([0, *map(len, samples)])
            step = np.linalg.norm(np.diff(x, axis=0, append=x[-1:]), axis=1)
            step[ends[1:] - 1] = 0.0  # from one step to the next
            longest = np.maximum.reduceat(step, ends[:-1])
            farthest = np.maximum.reduceat(off, ends[:-1])
            found.append((longest <= _JUMP * straight) & (farthest <= _OFF))
        return np.concatenate(found)

    def _sampled(self, start: np.ndarray, end: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Samples `(m, J)` of straight steps, and `(n,)` mu between two of them, at least 0.1."""
        length = np.linalg.norm((end - start)[:, self._surface.reach.joints], axis=1)
        count = np.ceil(length / _SAMPLED).astype(int) + 1
        count = np.maximum(count, 2)
        samples = [
            a + np.linspace(0.0, 1.0, num)[:, None] * (b - a)
            for a, b, num in zip(start, end, count, strict=True)
        ]
        return samples, np.maximum(length / (count - 1), 0.1)

    def _put(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Postures `(n, J)` put onto the skin below them, and how far they miss it, in kernels."""
        on_it, normal = self._surface.projected(self._lifter.centres(x))
        x = self._lifter.put(x, on_it, normal, steps=5)
        off = np.einsum("na,na->n", self._lifter.places(x, normal)[0] - on_it, normal)
        return x, np.abs(off) / self._surface.spacing

    def _keys(self, x: np.ndarray) -> np.ndarray:
        """`(n, 3 + L)`: distances of kernels on the skin count as mu in the joints."""
        place = self._surface.projected(self._lifter.centres(x))[0]
        joints = self._surface.reach.joints
        return np.concatenate([place / self._surface.spacing, x[:, joints]], axis=1)

    @staticmethod
    def _costs(key: np.ndarray, pairs: np.ndarray) -> np.ndarray:
        return np.linalg.norm(key[pairs[:, 0]] - key[pairs[:, 1]], axis=1) ** _POWER
