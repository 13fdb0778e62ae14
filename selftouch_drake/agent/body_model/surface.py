"""The skin as the agent imagines it: where a toucher was in firm touches, and ways over it.

The kernels of the paper are points of the skin; with a body model, each touch is a point of its
own. So the skin is known finer than its targets, and a straight way over it is a geodesic.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.asking import kernel_of_rows
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.body_model.reach import Reach
from selftouch_drake.agent.body_model.scene import neighbour_distance
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.compiled import compiled

# Nodes of the surface are this share of the distance between neighbouring kernels apart.
_FINE = 0.5
# Nodes that are joined to each one, unless they are farther than this many times `_FINE` kernels.
_JOINED, _GAP = 10, 4.0
# Nodes whose middle and plane are the surface about one, and those that are blended.
_ABOUT, _BLENDED = 9, 5
# A place is amid the nodes nearest to it if it is nearer to their middle than this share of the
# distance at which nodes have as many. Of 290 plans over three bodies (3,000 touches) those that
# kept contact went to 0.97 at most; where one lost it for long it was beyond 1.8.
_AMID = 0.95
# The middle of neighbours is so many times as far below a bent skin as their planes rise: half of
# that where the skin is round; at an edge planes turn less than the skin. Without it 92 % of plans
# over two cubes (3,000 touches) were perfect, with 0.5 98, with 0.75 99, with 1 99. Points of one
# hand are known roughly, and their planes do not tell: paths of an iCub were 1.19 times the
# shortest with it, and 1.06 without.
_BENT = 0.75
# Rounds in which a way over nodes becomes straight.
_ROUNDS = 25
# Touches of a kernel count as firm above this quantile of their strength.
_FIRM = 0.5
# A surface of fewer nodes is none.
_FEWEST = 12


# No slots: trees are built at first use, and kept.
@dataclass(frozen=True, kw_only=True, eq=False)
class TouchedSurface:
    """A part of the skin as one toucher knows it: n touches, m nodes.

    Places are of the toucher's centre, in the frame of the part's link, the model's unit of length.

    Attributes:
        reach: how the toucher moves over the part.
        row: `(n,)` stored touches of the toucher there, as rows of `kernel_q`.
        place: `(n, 3)` the toucher's centre in each.
        firm: `(n,)` bool, the firmer half of each kernel.
        spacing: the median distance between neighbouring kernels.
        node: `(m, 3)` the surface, evenly spread, where touches are firm.
        normal: `(m, 3)` its outward normals there.
        graph: `(m, m)` distances between neighbouring nodes.
        kernel: `(k,)` the target sensations of its touches whose places are known.
        kernel_place: `(k, 3)` these places.
    """

    reach: Reach
    row: np.ndarray
    place: np.ndarray
    firm: np.ndarray
    spacing: float
    node: np.ndarray
    normal: np.ndarray
    graph: csr_array
    kernel: np.ndarray
    kernel_place: np.ndarray

    def kernel_at(self, at: np.ndarray) -> np.ndarray:
        """`(n,)` the target sensation whose place is nearest to each of `(n, 3)` places."""
        return self.kernel[self._kernels.query(at)[1]]

    @cached_property
    def _kernels(self) -> cKDTree:
        return cKDTree(self.kernel_place)

    @cached_property
    def nodes(self) -> cKDTree:
        """For the nodes near a place."""
        return cKDTree(self.node)

    @cached_property
    def touches(self) -> cKDTree:
        """For the touches near a place."""
        return cKDTree(self.place)

    def projected(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The nearest places on the surface, blended from its planes, and the normals there.

        Args:
            at: `(n, 3)` places near it.
        """
        far, near = self.nodes.query(at, k=min(_BLENDED, len(self.node)))
        place, normal = np.empty((len(at), 3)), np.empty((len(at), 3))
        _project(at, far, near, _FINE * self.spacing, self.node, self.normal, place, normal)
        return place, normal

    def height(self, at: np.ndarray) -> np.ndarray:
        """`(n,)` how high above the surface `(n, 3)` places are, negative below it."""
        on_it, normal = self.projected(at)
        return np.einsum("na,na->n", at - on_it, normal)

    def beyond(self, at: np.ndarray) -> np.ndarray:
        """`(n,)` how far places are beyond where touches were, in distances of kernels; 0 within.

        Within, a place lies amid the nodes nearest to it. Beyond an edge all of them lie on one
        side, and their planes say nothing.

        Args:
            at: `(n, 3)` places on the surface.
        """
        near = self.nodes.query(at, k=min(_BLENDED, len(self.node)))[1]
        off = at - self.node[near].mean(axis=1)
        normal = self.normal[near[:, 0]]
        off -= np.einsum("na,na->n", off, normal)[:, None] * normal
        return np.maximum(np.linalg.norm(off, axis=1) - _AMID * self._gap, 0.0) / self.spacing

    @cached_property
    def _gap(self) -> float:
        """The median distance of a node from the last of as many others as are blended."""
        far = self.nodes.query(self.node, k=min(_BLENDED + 1, len(self.node)))[0]
        return float(np.median(far[:, -1]))

    def way(self, start: np.ndarray, goal: np.ndarray, num: int) -> np.ndarray | None:
        """`(num, 3)` evenly spaced places on a short way over the surface; None if there is none.

        Args:
            start: `(3,)` place at which it begins.
            goal: `(3,)` place at which it ends.
            num: of places.
        """
        first, last = self.nodes.query(np.stack([start, goal]))[1].tolist()
        far, before = dijkstra(self.graph, indices=first, return_predecessors=True)
        if not np.isfinite(far[last]):
            return None
        passed = [last]
        while passed[-1] != first:
            passed.append(int(before[passed[-1]]))
        way = evenly(np.concatenate([[start], self.node[passed[::-1]][1:-1], [goal]]), num)
        for _ in range(_ROUNDS):
            way[1:-1] = 0.5 * way[1:-1] + 0.25 * (way[:-2] + way[2:])
            way[1:-1] = self.projected(way[1:-1])[0]
            way = evenly(way, num)
        return way


def touched_surfaces(
    model: BodyModel, representation: QuotientRepresentation
) -> list[TouchedSurface]:
    """The surfaces of all parts of an accepted model, for each toucher that knows them."""
    kernel = kernel_of_rows(representation)
    found = []
    for part in np.flatnonzero(model.accepted_by_part).tolist():
        on_part = model.kernel_part[kernel] == part
        for toucher in range(len(model.toucher_link)):
            reach = Reach.of(model, part, toucher)
            rows = np.flatnonzero(on_part & (model.kernel_toucher == toucher))
            if reach is None or not len(rows):
                continue
            hand = model.hand_of_toucher[toucher]
            bent = _BENT if np.count_nonzero(model.hand_of_toucher == hand) == 1 else 0.0
            surface = _surface(model, representation, reach, rows, kernel[rows], bent)
            if surface is not None:
                found.append(surface)
    return found


def _surface(
    model: BodyModel,
    representation: QuotientRepresentation,
    reach: Reach,
    rows: np.ndarray,
    kernel: np.ndarray,
    bent: float,
) -> TouchedSurface | None:
    """The surface of a part as `(n,)` touches of `(n,)` kernels by one toucher know it.

    It is raised by so much, as `_smooth` says.
    """
    known = np.unique(kernel)
    known = known[np.isfinite(model.kernel_place[known]).all(axis=1)]
    if len(known) < 3:
        return None
    kernel_place = model.kernel_place[known]
    spacing = neighbour_distance(kernel_place)
    outward = model.kernel_normal[kernel]
    place = reach.places(representation.kernel_q[rows].astype(float), outward)[0]
    firm = _firm(representation.kernel_strength[rows], kernel)
    node, at = _thinned(place[firm], _FINE * spacing)
    if len(node) < _FEWEST:
        return None
    nodes = cKDTree(node)
    far, near = nodes.query(node, k=min(_JOINED + 1, len(node)))
    # Kernels know which side is outside.
    side = np.zeros_like(node)
    np.add.at(side, at, np.nan_to_num(outward[firm]))
    node, normal = _smooth(node, near[:, : _ABOUT + 1], side[near].sum(axis=1), bent)
    joined = far[:, 1:] <= _GAP * _FINE * spacing
    first = np.repeat(np.arange(len(node)), joined.sum(axis=1))
    second = near[:, 1:][joined]
    length = np.linalg.norm(node[first] - node[second], axis=1)
    graph = csr_array((length, (first, second)), shape=(len(node), len(node)))
    return TouchedSurface(
        reach=reach,
        row=rows,
        place=place,
        firm=firm,
        spacing=spacing,
        node=node,
        normal=normal,
        graph=csr_array(graph.maximum(graph.T)),
        kernel=known,
        kernel_place=kernel_place,
    )


def _smooth(
    node: np.ndarray, near: np.ndarray, side: np.ndarray, bent: float
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes on planes through their neighbours, raised where the skin is bent, and the normals.

    Args:
        node: `(m, 3)` rough places.
        near: `(m, k)` neighbours of each, itself among them.
        side: `(m, 3)` directions that look outside; zeros where nobody knows.
        bent: how far their middle is below the skin, for what the planes of neighbours rise.
    """
    about = node[near]
    middle = about.mean(axis=1)
    off = about - middle[:, None]
    normal = np.linalg.eigh(np.einsum("mka,mkb->mab", off, off))[1][:, :, 0]
    # Where nobody knows, the outside is away from the middle.
    known = np.any(side != 0, axis=1, keepdims=True)
    side = np.where(known, side, node - node.mean(axis=0))
    normal *= np.where(np.einsum("ma,ma->m", normal, side) < 0, -1.0, 1.0)[:, None]
    # Where the skin is bent the middle lies below it.
    turned = normal[near] - normal[:, None]
    below = bent * np.einsum("mka,mka->mk", off, turned).mean(axis=1)
    above = np.einsum("ma,ma->m", node - middle, normal)
    return node - (above - below)[:, None] * normal, normal


def _firm(strength: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """`(n,)` bool, touches that are among the firmer of their kernel; kernels ascend."""
    firm = np.zeros(len(kernel), dtype=bool)
    ends = np.flatnonzero(np.diff(kernel, prepend=-1, append=-1))
    for start, end in pairwise(ends):
        own = strength[start:end]
        firm[start:end] = own >= np.quantile(own, _FIRM)
    return firm


def _thinned(place: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """`(m, 3)` means of the places that share a cell of a grid, and `(n,)` the mean of each."""
    corner = np.floor((place - place.min(axis=0)) / cell).astype(np.int64)
    sides = corner.max(axis=0) + 1
    _, at, count = np.unique(
        np.ravel_multi_index(tuple(corner.T), tuple(sides)),
        return_inverse=True,
        return_counts=True,
    )
    total = np.zeros((len(count), 3))
    np.add.at(total, at, place)
    return total / count[:, None], at


def evenly(way: np.ndarray, num: int) -> np.ndarray:
    """`(num, D)` points at equal distances along a `(n, D)` polyline."""
    points = np.empty((num, way.shape[1]))
    _evenly(np.ascontiguousarray(way), points)
    return points


@compiled
def _evenly(way, points):
    """Fills in what `evenly` gives."""
    length = np.empty(len(way))
    length[0] = 0.0
    for i in range(1, len(way)):
        square = 0.0
        for axis in range(way.shape[1]):
            square += (way[i, axis] - way[i - 1, axis]) ** 2
        length[i] = length[i - 1] + math.sqrt(square)
    step, last = np.int64(0), len(points) - 1
    for number in range(len(points)):
        at = length[-1] * number / last
        while step < len(way) - 2 and length[step + 1] < at:
            step += 1
        own = length[step + 1] - length[step]
        share = min((at - length[step]) / own, 1.0) if own > 0.0 else 0.0
        for axis in range(way.shape[1]):
            points[number, axis] = way[step, axis] + share * (way[step + 1, axis] - way[step, axis])


@compiled
def _project(at, far, near, reach, node, normal, place, blended):
    """Fills in what `TouchedSurface.projected` gives, of `(n, k)` near nodes and how far they are.

    Nodes count less the farther they are, by a normal distribution of this reach.
    """
    weight = np.empty(near.shape[1])
    for i in range(len(at)):
        total = 0.0
        for k in range(len(weight)):
            off = far[i, k] / reach
            # Far from all, the nearest counts.
            weight[k] = math.exp(-0.5 * off * off) + 1e-9 / (1e-9 + far[i, k])
            total += weight[k]
        size = 0.0
        for axis in range(3):
            blended[i, axis] = 0.0
            for k in range(len(weight)):
                blended[i, axis] += weight[k] / total * normal[near[i, k], axis]
            size += blended[i, axis] ** 2
        size = math.sqrt(size)
        for axis in range(3):
            nearest = normal[near[i, 0], axis]
            blended[i, axis] = blended[i, axis] / size if size > 1e-6 else nearest
        above = 0.0
        for k in range(len(weight)):
            for axis in range(3):
                off = at[i, axis] - node[near[i, k], axis]
                above += weight[k] / total * off * blended[i, axis]
        for axis in range(3):
            place[i, axis] = at[i, axis] - above * blended[i, axis]
