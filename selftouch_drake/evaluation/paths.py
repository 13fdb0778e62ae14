"""How much longer a path is on the skin than the shortest way along the skin.

Both are measured twice: in the agent's own lengths, and on the surface of the true skin.
"""

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.evaluation.shape import LEAST_SINGLE
from selftouch_drake.experience.store import Contacts
from selftouch_drake.geometry.geodesics import surface_paths
from selftouch_drake.geometry.receptors import ReceptiveFields
from selftouch_drake.lazy import trimesh
from selftouch_drake.quotient.links import link_lengths
from selftouch_drake.quotient.paths import geodesics

#: m, strides in which a path on the true skin is measured. Centres of pressure jump by a millimetre
#: from one sample to the next; in strides of 3 mm, paths on a torus are 5 % longer.
STRIDE = 0.01

#: The same for the agent, in spacings of its targets: it knows a touch by its kernel alone.
_OWN_STRIDE = 2.0


def in_strides(count: int, apart: Callable[[int, np.ndarray], np.ndarray], stride: float) -> float:
    """Length of a path through `count` places, measured as with a pair of dividers.

    From each place it goes to the first one that is at least a stride away, and at last to the end.
    So noise that is small against the stride adds nothing.

    Args:
        count: number of places.
        apart: from a place and `(n,)` others, by number, to their `(n,)` distances.
        stride: in the unit of the distances.
    """
    length, here = 0.0, 0
    while here < count - 1:
        distance = apart(here, np.arange(here + 1, count))
        beyond = distance >= stride
        step = int(beyond.argmax()) if beyond.any() else len(distance) - 1
        length, here = length + float(distance[step]), here + 1 + step
    return length


class OwnPaths:
    """Measures paths in the agent's own lengths: how unlike neighbouring target sensations are."""

    def __init__(self, representation: QuotientRepresentation):
        edges, self._targets = representation.edges, representation.target_sensations
        length = link_lengths(self._targets, edges)
        self._along = geodesics(edges, length, len(self._targets))

    def over_shortest(self, felt: np.ndarray) -> float | None:
        """The length of a path, felt as `(n, S)` N, over the shortest one, 1 or more.

        None if it ends on another part of the body, or in the sensation in which it began.
        """
        touched = felt[felt.any(axis=1)]
        if not len(touched):
            return None
        kernel = (touched @ self._targets.T).argmax(axis=1)
        shortest = self._along[kernel[0], kernel[-1]]
        length = in_strides(
            len(kernel), lambda i, others: self._along[kernel[i], kernel[others]], _OWN_STRIDE
        )
        known = np.isfinite(length) and 0.0 < shortest < np.inf
        return max(length / float(shortest), 1.0) if known else None


class TruePaths:
    """Measures paths on the surfaces of the true skins, given by their receptive fields."""

    def __init__(self, fields: Sequence[ReceptiveFields]):
        self._fields = fields

    def over_shortest(self, contacts: Contacts) -> float | None:
        """The length of a path of n contacts over the shortest one between its ends, 1 or more.

        Places are those of the surface above the centres of pressure. None if the path changes the
        skin, or what touches it; if it touches several places at once; or if it hardly moves.
        """
        pairs = np.stack([contacts.skin, contacts.toucher])
        touches = np.diff(contacts.offsets)
        single = np.mean(touches[touches > 0] == 1) if pairs.size else 0.0
        if single < LEAST_SINGLE or (pairs != pairs[:, :1]).any():
            return None
        skin = int(contacts.skin[0])
        at = self._on_surface(skin, contacts.p_LC)[0]
        shortest = self.shortest(skin, contacts.p_LC[[0, -1]])
        if shortest is None or not (along := _length(shortest)) > STRIDE:
            return None
        length = in_strides(
            len(at), lambda i, others: np.linalg.norm(at[others] - at[i], axis=1), STRIDE
        )
        return max(length / along, 1.0)

    def shortest(self, skin: int, p_LE: np.ndarray) -> np.ndarray | None:
        """`(n, 3)` m, the shortest way on the surface of a skin; None if there is none.

        Args:
            skin: its number.
            p_LE: `(2, 3)` m, places near the surface, in its frame: start and end of the way.
        """
        ends, corners = self._on_surface(skin, p_LE)
        vertices = self._fields[skin].vertices
        to_corner = np.linalg.norm(vertices[corners] - ends[:, None], axis=2)
        along, before = dijkstra(self._lines[skin], indices=corners[0], return_predecessors=True)
        total = to_corner[0][:, None] + along[:, corners[1]] + to_corner[1]
        first, last = np.unravel_index(total.argmin(), total.shape)
        if not np.isfinite(total[first, last]):
            return None
        passed = [int(corners[1, last])]
        while passed[-1] != corners[0, first]:
            passed.append(int(before[first, passed[-1]]))
        return np.concatenate([ends[:1], vertices[passed[::-1]], ends[1:]])

    def _on_surface(self, skin: int, p_LQ: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`(n, 3)` m, places on the surface below others, and `(n, 3)` the vertices round each."""
        corners, parts = self._fields[skin].parts_at(p_LQ)
        return np.einsum("nv,nvi->ni", parts, self._fields[skin].vertices[corners]), corners

    @cached_property
    def _lines(self) -> list[csr_matrix]:
        """Graphs of straight lines on the skins."""
        surfaces = ((field.vertices, field.faces) for field in self._fields)
        return [surface_paths(trimesh.Trimesh(*surface, process=False)) for surface in surfaces]


def _length(path: np.ndarray) -> float:
    """m, of a polyline `(n, 3)`."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
