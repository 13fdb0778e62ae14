"""Firm touches as a graph: a way over the skin that turns the arm on its way where it must."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

# Touches in the graph, and those that each is joined to.
_MOST, _JOINED = 4000, 14
# Distances count with this power: many small steps are better than a leap.
_POWER = 1.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PostureGraph:
    """Some firm touches of one toucher on one part, and steps between them.

    Attributes:
        chosen: `(n,)` the touches, as rows of the arrays it was made of.
        key: `(n, 3 + L)` where they are on the skin and in the joints, one in the unit of the
            other.
        graph: `(n, n)` the cost of steps.
    """

    chosen: np.ndarray
    key: np.ndarray
    graph: csr_array

    @classmethod
    def of(cls, place: np.ndarray, x: np.ndarray, random: np.random.Generator) -> "PostureGraph":
        """Joins touches that are near in place and posture.

        Args:
            place: `(n, 3)` places on the skin, in a unit such that 1 is as far as 1 mu of joints.
            x: `(n, L)` scaled postures, mu.
            random: chooses touches if there are too many.
        """
        chosen = np.sort(random.permutation(len(place))[:_MOST])
        key = np.concatenate([place[chosen], x[chosen]], axis=1)
        far, near = cKDTree(key).query(key, k=min(_JOINED + 1, len(key)))
        first = np.repeat(np.arange(len(key)), near.shape[1] - 1)
        cost = far[:, 1:].ravel() ** _POWER
        graph = csr_array((cost, (first, near[:, 1:].ravel())), shape=(len(key), len(key)))
        return cls(chosen=chosen, key=key, graph=csr_array(graph.maximum(graph.T)))

    def way(self, start: np.ndarray, goals: np.ndarray) -> np.ndarray:
        """`(m,)` touches from the one nearest to a start to the cheapest of some goals.

        Args:
            start: `(3 + L,)` as a row of `key`.
            goals: `(g, 3 + L)` likewise.

        Returns:
            Rows of the arrays that the graph was made of; none where no steps lead.
        """
        tree = cKDTree(self.key)
        first = int(tree.query(start)[1])
        last = np.unique(tree.query(goals)[1])
        cost, before = dijkstra(self.graph, indices=first, return_predecessors=True)
        end = int(last[cost[last].argmin()])
        if not np.isfinite(cost[end]):
            return self.chosen[:0]
        passed = [end]
        while passed[-1] != first:
            passed.append(int(before[passed[-1]]))
        return self.chosen[passed[::-1]]
