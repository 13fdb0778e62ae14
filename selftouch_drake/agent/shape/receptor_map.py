"""Where the receptors are, from a thousand touches (naive).

Of each touch, the joint positions are known, and which receptors feel it. Receptors that feel the
same touches are near each other. Where few receptors feel a touch, joint positions help: touches at
similar joints are near each other too, if the joints show the place. Both give distances along the
skin between neighbours. These give a layout, as for kernels, and unfolding refines it where the
skin can be laid out flat.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from selftouch_drake.agent.shape.alignment import align
from selftouch_drake.agent.shape.recovery import LEAST_MARGIN
from selftouch_drake.agent.shape.unfolding import unfold
from selftouch_drake.quotient.alpha import flat
from selftouch_drake.quotient.dimension import LEAST_KERNELS
from selftouch_drake.quotient.graph import connected_edges, neighbour_edges
from selftouch_drake.quotient.holes import Topology, neighbour_spacings, topology
from selftouch_drake.quotient.layout import curvature_corrected_mds
from selftouch_drake.quotient.paths import geodesics

#: A receptor that felt fewer touches is left out; below the second number it is in doubt.
LEAST_FELT, FEW_FELT = 5, 20

#: Receptors whose touches have at least this cosine are of one part. Two arms that touch a body and
#: each other, 1,000 touches: 0.1 to 0.4 find the three skins, 0.05 joins them.
_ALIKE = 0.2

#: Fewest receptors of a part that are laid out.
_LEAST_RECEPTORS = 8

#: Joints tell the place of a touch if they explain this share of what is felt, on touches left out.
#: A Nao: 0.5 to 0.7. An arm with joints to spare, which touches a cube, a torus: 0.1.
_LEAST_EXPLAINED = 0.3

#: Weight of the squares in the regression on products of joints.
_RIDGE = 3.0

#: A part is flat if a third dimension divides what a layout leaves unexplained by less than this:
#: 1.2 to 2.6 on patches of a Nao, 35 and more on a torus and a cube.
_FLAT = 6.0

#: Iterations of unfolding: to compare dimensions, to the end, and from the end with other touches.
_TRIAL, _FULL, _AGAIN = 60, 150, 40

#: Resampled sets of touches from which error bars follow, and blocks of successive touches that are
#: drawn together: these are alike.
_NUM_RESAMPLED, _NUM_BLOCKS = 20, 20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MappedPart:
    """A part of the skin.

    Attributes:
        receptors: `(m,)` numbers of its receptors, ascending.
        flat: whether it was laid out in a plane.
        topology: components, loops and voids; None if they cannot be found.
        num_pieces: pieces that no shared touch joins; joint positions alone say how they lie.
    """

    receptors: np.ndarray
    flat: bool
    topology: Topology | None
    num_pieces: int

    @property
    def holes_are_sure(self) -> bool:
        """Whether components, loops and voids can be trusted; not of a few receptors."""
        enough = len(self.receptors) >= LEAST_KERNELS
        return enough and self.topology is not None and self.topology.margin >= LEAST_MARGIN


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReceptorMap:
    """Places of S receptors, each part in a pose of its own, which may be mirrored.

    Attributes:
        positions: `(S, 3)` in spacings, the median distance to the six nearest of a part; the third
            is 0 on a flat part; NaN where a receptor was left out.
        error: `(S,)` spacings, standard deviation of the distance from the place: when touches are
            drawn again and, on a flat part, between it and a layout in space; NaN likewise.
        part: `(S,)` number of the part, -1 where a receptor was left out.
        felt: `(S,)` number of touches that each receptor felt.
        explained: share of what is felt that joint positions predict, on touches left out.
        parts: the parts, largest first.
        doubts: what cannot be trusted, a line each.
    """

    positions: np.ndarray
    error: np.ndarray
    part: np.ndarray
    felt: np.ndarray
    explained: float
    parts: tuple[MappedPart, ...]
    doubts: tuple[str, ...]


def map_receptors(
    q: np.ndarray,
    sensation: np.ndarray,
    names: Sequence[str],
    *,
    progress: Callable[[float], None] = lambda fraction: None,
) -> ReceptorMap:
    """Lays out receptors from `(n, J)` motor configurations and `(n, S)` sensations, touches all.

    A receptor is active where its sensation is above 0. Names are S, for doubts; progress is
    called with the fraction done.

    Raises:
        ValueError: fewer than eight receptors felt five touches or more.
    """
    active = (np.asarray(sensation) > 0).astype(float)
    felt = active.sum(axis=0).astype(int)
    known = np.flatnonzero(felt >= LEAST_FELT)
    if len(known) < _LEAST_RECEPTORS:
        raise ValueError(
            f"{len(known)} receptors felt {LEAST_FELT} touches or more; record touches until at "
            f"least {_LEAST_RECEPTORS} did"
        )
    both, explained = _with_joints(active[:, known], np.asarray(q, dtype=float))
    label = connected_components(_cosines(both) >= _ALIKE)[1]
    pieces = connected_components(_cosines(active[:, known]) >= _ALIKE)[1]
    order = np.argsort(-np.bincount(label), kind="stable").tolist()
    groups = [g for n in order if len(g := np.flatnonzero(label == n)) >= _LEAST_RECEPTORS]
    positions, error = np.full((len(felt), 3), np.nan), np.full(len(felt), np.nan)
    part, parts = np.full(len(felt), -1), []
    for number, group in enumerate(groups):
        rows = np.flatnonzero(active[:, known[group]].any(axis=1))
        lay_out = _Layout(active[np.ix_(rows, known[group])], q[rows], explained)
        places, is_flat, bent = lay_out.places()
        flattened = np.pad(places, ((0, 0), (0, 3 - places.shape[1])))
        between = np.square(align(bent, flattened) - flattened).sum(axis=1).mean()
        scale = np.median(neighbour_spacings(places, 6))
        deviations = []
        for again in range(_NUM_RESAMPLED):
            rng = np.random.default_rng([0, number, again])
            blocks = np.array_split(np.arange(len(rows)), _NUM_BLOCKS)
            drawn = [blocks[n] for n in rng.integers(_NUM_BLOCKS, size=_NUM_BLOCKS)]
            moved = lay_out.again(places, is_flat, np.concatenate(drawn))
            deviations.append(np.square(align(moved, places) - places).sum(axis=1))
            progress((number + (again + 1) / _NUM_RESAMPLED) / len(groups))
        inside = known[group]
        positions[inside] = 0.0
        positions[inside, : places.shape[1]] = (places - places.mean(axis=0)) / scale
        error[inside] = np.sqrt(np.mean(deviations, axis=0) + between) / scale
        part[inside] = number
        parts.append(
            MappedPart(
                receptors=inside,
                flat=is_flat,
                topology=None if flat(places) else topology(places),
                num_pieces=len(np.unique(pieces[group])),
            )
        )
    return ReceptorMap(
        positions=positions,
        error=error,
        part=part,
        felt=felt,
        explained=explained,
        parts=tuple(parts),
        doubts=tuple(_doubts(parts, part, felt, explained, names)),
    )


class _Layout:
    """Layouts of one part from all its touches, and from touches drawn again."""

    def __init__(self, active: np.ndarray, q: np.ndarray, explained: float) -> None:
        self.active, self.q, self.explained = active, q, explained
        self.by_joints = _joint_predictor(q)[0] if explained >= _LEAST_EXPLAINED else None

    def places(self) -> tuple[np.ndarray, bool, np.ndarray]:
        """`(m, 2)` places if the part is flat, else `(m, 3)`; whether it is; `(m, 3)` as if not."""
        start = {d: self._geodesic(np.arange(len(self.q)), d) for d in (2, 3)}
        bent, plane = (unfold(self.active, start[d], self.by_joints, _TRIAL)[1] for d in (3, 2))
        if plane > _FLAT * bent:
            return start[3], False, start[3]
        return unfold(self.active, start[2], self.by_joints, _FULL)[0], True, start[3]

    def again(self, places: np.ndarray, is_flat: bool, rows: np.ndarray) -> np.ndarray:
        """The layout from other touches; receptors that none of them feels stay where they are."""
        if not is_flat:
            return self._geodesic(rows, 3)
        active, by_joints = self.active[rows], self.by_joints
        if by_joints is not None:
            by_joints = _joint_predictor(self.q[rows])[0]
        there = active.any(axis=0)
        moved = places.copy()
        unfolded, _ = unfold(active[:, there], places[there], by_joints, _AGAIN)
        moved[there] = align(unfolded, places[there])
        return moved

    def _geodesic(self, rows: np.ndarray, dimension: int) -> np.ndarray:
        both, _ = _with_joints(self.active[rows], self.q[rows], self.explained)
        distance = np.arccos(np.clip(_cosines(both), -1.0, 1.0))
        edges = connected_edges(neighbour_edges(distance), distance)
        # Receptors that feel exactly the same touches are not at one place.
        along = geodesics(edges, np.maximum(distance[tuple(edges.T)], 1e-3), len(distance))
        return curvature_corrected_mds(edges, along, dimension).positions


def _joint_predictor(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`(n, n)` ridge regression on joints and their products, and `(n,)` leverages."""
    moving = q[:, np.ptp(q, axis=0) > 0]
    scaled = (moving - moving.mean(axis=0)) / moving.std(axis=0)
    i, j = np.triu_indices(scaled.shape[1])
    features = np.concatenate([scaled, scaled[:, i] * scaled[:, j]], axis=1)
    features -= features.mean(axis=0)
    features /= np.maximum(features.std(axis=0), 1e-9)
    basis, size, _ = np.linalg.svd(features, full_matrices=False)
    kept = size**2 / (size**2 + _RIDGE)
    return (basis * kept) @ basis.T, np.square(basis) @ kept


def _with_joints(
    active: np.ndarray, q: np.ndarray, explained: float | None = None
) -> tuple[np.ndarray, float]:
    """What is felt, and below it what joints predict to be felt, if they tell the place.

    Also returns the share that they explain on touches left out, unless it is given.
    """
    by_joints, leverage = _joint_predictor(q)
    centred = active - active.mean(axis=0)
    found = by_joints @ centred
    if explained is None:
        missed = (centred - found) / np.maximum(1.0 - leverage, 1e-3)[:, None]
        explained = float(1.0 - np.square(missed).mean() / np.square(centred).mean())
    if explained < _LEAST_EXPLAINED:
        return active, explained
    predicted = np.maximum(found + active.mean(axis=0), 0.0)
    return np.concatenate([active, predicted]), explained


def _cosines(felt: np.ndarray) -> np.ndarray:
    """`(S, S)` cosines between the columns of what is felt; 0 where nothing is."""
    norm = np.maximum(np.linalg.norm(felt, axis=0), 1e-12)
    return (felt / norm).T @ (felt / norm)


def _doubts(
    parts: Sequence[MappedPart],
    part: np.ndarray,
    felt: np.ndarray,
    explained: float,
    names: Sequence[str],
) -> list[str]:
    def listed(which: np.ndarray) -> str:
        some = ", ".join(names[n] for n in np.flatnonzero(which)[:5])
        return f"{which.sum()} receptors ({some}{', ...' if which.sum() > 5 else ''})"

    found = []
    if (silent := felt < LEAST_FELT).any():
        found.append(f"{listed(silent)} felt fewer than {LEAST_FELT} touches and were left out")
    if (seldom := (part >= 0) & (felt < FEW_FELT)).any():
        found.append(f"{listed(seldom)} felt fewer than {FEW_FELT} touches")
    if (alone := (part < 0) & ~silent).any():
        found.append(f"{listed(alone)} share too few touches with others and were left out")
    for number, one in enumerate(parts):
        if one.num_pieces > 1:
            how = "from joint positions alone" if explained >= _LEAST_EXPLAINED else "hardly"
            found.append(
                f"part {number} is in {one.num_pieces} pieces that no touch joins: how they lie to "
                f"each other is known {how}"
            )
        if not one.holes_are_sure:
            found.append(f"the holes of part {number} are not sure")
    return found
