"""Own parts: how deep skinned parts and touchers may be in each other, as past postures tell.

The skins that the agent found are also what it must not run into. But soft skins give way, by as
much as a limb is thick, so a touch of two surfaces is no limit. Postures that the agent lived were
possible: parts may be as deep in each other as they have been, at that place of the skin. What has
no skin and touches nothing is not known here.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.body_model.surface import TouchedSurface
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.compiled import compiled, inner

# Cells of the grid around a part are this share of the distance between its kernels, and it has at
# most so many.
_CELL, _MOST_CELLS = 0.5, 400_000
# A part is known so far around its kernels, in distances of kernels.
_AROUND = 3.0
# Directions in which a toucher is looked at, and how far, in distances of kernels.
_DIRECTIONS, _FAR = 40, 8.0
# Balls that fill a part, at most.
_BALLS = 24
# Past postures that are looked at, at most, and neighbouring places that share their depths.
_PAST, _SHARED = 8_000, 5
# Where nothing has been near, parts may come as near as the first, touchers to each other as the
# second, in distances of kernels.
_UNKNOWN, _UNKNOWN_TOUCHER = -1.0, -4.0
# Two parts say nothing if they are nearer to their limit than this, in distances of kernels, in
# more than this share of past postures, of which so many are looked at.
_NEAR, _ALWAYS, _JUDGED = 0.2, 0.1, 2000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solid:
    """A part of the body as a field of depths: G cells, K kernels.

    Attributes:
        link: the link that wears it.
        spacing: distance between its kernels, the model's unit of length.
        corner: `(3,)` of the grid, in the frame of the link.
        cell: edge of a cell.
        sides: `(3,)` numbers of cells.
        height: `(G,)` height above the surface at each corner of a cell, negative inside; infinite
            where nobody knows.
        kernel: `(G,)` the nearest kernel, by number in `place`.
        place: `(K, 3)` places of the kernels.
    """

    link: int
    spacing: float
    corner: np.ndarray
    cell: float
    sides: np.ndarray
    height: np.ndarray
    kernel: np.ndarray
    place: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Balls:
    """A part or a toucher as what may run into others: balls in the frame of its link."""

    link: int
    centre: np.ndarray
    radius: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OwnParts:
    """Parts of the body, and how deep they have been in each other.

    Attributes:
        model: poses of the links.
        meetings: what may run into which part.
        limits: for each of `meetings`, `(K,)` the deepest that was possible at each kernel.
    """

    model: BodyModel
    meetings: tuple[tuple[Balls, Solid], ...]
    limits: tuple[np.ndarray, ...]

    @classmethod
    def of(
        cls,
        model: BodyModel,
        representation: QuotientRepresentation,
        surfaces: list[TouchedSurface],
    ) -> "OwnParts":
        """Learns from past postures how deep parts may be in each other.

        Args:
            model: accepted where there are surfaces.
            representation: its stored configurations were possible.
            surfaces: as of `touched_surfaces`.
        """
        best = dict[int, TouchedSurface]()
        for surface in surfaces:
            known = best.get(surface.reach.part)
            if known is None or len(surface.node) > len(known.node):
                best[surface.reach.part] = surface
        solids = {part: _solid(model, part, surface) for part, surface in best.items()}
        movers = [_balls(model, surface) for surface in best.values()]
        touchers = sorted({surface.reach.toucher for surface in surfaces})
        movers += [_toucher(model, number) for number in touchers]
        rounds = [_round(model, number, surfaces) for number in touchers]
        meetings = tuple(
            (mover, solid)
            for mover in movers
            for solid in (*solids.values(), *rounds)
            if _moves(model, mover.link, solid.link)
        )
        q = representation.kernel_q
        every = max(1, len(q) // _PAST)
        poses = model.link_poses(q[::every].astype(float))
        limits = []
        for mover, solid in meetings:
            deepest = np.full(len(solid.place), -np.inf)
            _raise(*_arguments(poses, mover, solid), deepest)
            near = cKDTree(solid.place).query(solid.place, k=min(_SHARED, len(deepest)))[1]
            shared = deepest[near.reshape(len(deepest), -1)].max(axis=1)
            unknown = _UNKNOWN_TOUCHER if solid in rounds else _UNKNOWN
            limits.append(np.maximum(shared, unknown * solid.spacing))
        own = cls(model=model, meetings=meetings, limits=tuple(limits))
        return own._informative(poses[:: max(1, len(poses) // _JUDGED)])

    def _informative(self, poses: np.ndarray) -> "OwnParts":
        """Without meetings that are always near their limit, as those of neighbouring links."""
        kept = [
            np.mean(_over(poses, *meeting, limit) > -_NEAR) <= _ALWAYS
            for meeting, limit in zip(self.meetings, self.limits, strict=True)
        ]
        return replace(
            self,
            meetings=tuple(one for one, keep in zip(self.meetings, kept, strict=True) if keep),
            limits=tuple(one for one, keep in zip(self.limits, kept, strict=True) if keep),
        )

    def excess(self, q: np.ndarray) -> np.ndarray:
        """`(n,)` how much deeper than ever own parts are in each other, in distances of kernels.

        Args:
            q: `(n, J)` readings of the joints.

        Returns:
            The worst of all parts; negative where there is room, -inf where nothing can meet.
        """
        worst = np.full(len(q), -np.inf)
        if not self.meetings:
            return worst
        poses = self.model.link_poses(q)
        for meeting, limit in zip(self.meetings, self.limits, strict=True):
            np.maximum(worst, _over(poses, *meeting, limit), out=worst)
        return worst


def _moves(model: BodyModel, link: int, other: int) -> bool:
    back, there = model.between(link, other)
    return bool(back or there)


def _solid(model: BodyModel, part: int, surface: TouchedSurface) -> Solid:
    """The field of depths of a part, as the toucher that knows it best has it."""
    spacing = surface.spacing
    lower = surface.node.min(axis=0) - _AROUND * spacing
    size = surface.node.max(axis=0) + _AROUND * spacing - lower
    cell = max(_CELL * spacing, float(np.cbrt(size.prod() / _MOST_CELLS)))
    sides = np.ceil(size / cell).astype(int) + 1
    at = np.stack(np.meshgrid(*map(np.arange, sides), indexing="ij"), axis=-1).reshape(-1, 3)
    place = lower + cell * at
    on_it, normal = surface.projected(place)
    height = np.einsum("na,na->n", place - on_it, normal)
    far = surface.nodes.query(place)[0]
    # Beyond an edge of a patch its planes say nothing.
    inside = _thickness(surface).max()
    height[far > max(_AROUND * spacing, 1.2 * inside)] = np.inf
    return Solid(
        link=int(model.part_link[part]),
        spacing=spacing,
        corner=lower,
        cell=cell,
        sides=sides,
        height=height,
        kernel=cKDTree(surface.kernel_place).query(place)[1],
        place=surface.kernel_place,
    )


def _round(model: BodyModel, toucher: int, surfaces: list[TouchedSurface]) -> Solid:
    """The field of depths of a toucher: a ball whose surface is its centre, in some directions."""
    spacing = max(s.spacing for s in surfaces if s.reach.toucher == toucher)
    centre = model.toucher_place[toucher]
    # Directions spread evenly (a Fibonacci sphere).
    number = np.arange(_DIRECTIONS) + 0.5
    up = 1.0 - 2.0 * number / _DIRECTIONS
    turn = np.pi * (1.0 + np.sqrt(5.0)) * number
    flat = np.sqrt(1.0 - up**2)
    direction = np.stack([np.cos(turn) * flat, np.sin(turn) * flat, up], axis=1)
    half = round(_FAR / _CELL)
    sides = np.full(3, 2 * half + 1)
    cell = _CELL * spacing
    at = np.stack(np.meshgrid(*map(np.arange, sides), indexing="ij"), axis=-1).reshape(-1, 3)
    away = cell * (at - half)
    return Solid(
        link=int(model.toucher_link[toucher]),
        spacing=spacing,
        corner=centre - half * cell,
        cell=cell,
        sides=sides,
        height=np.linalg.norm(away, axis=1),
        kernel=(away @ direction.T).argmax(axis=1),
        place=centre + spacing * direction,
    )


def _thickness(surface: TouchedSurface) -> np.ndarray:
    """`(m,)` radius of the largest ball below each node that has no other node inside."""
    away = surface.node[None] - surface.node[:, None]
    below = -np.einsum("mka,ma->mk", away, surface.normal)
    square = np.square(away).sum(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.where(below > 1e-9, square / (2 * below), np.inf)
    # A flat patch has no other side.
    most = 0.5 * float(np.linalg.norm(surface.node.std(axis=0)))
    return np.minimum(radius.min(axis=1), most)


def _balls(model: BodyModel, surface: TouchedSurface) -> Balls:
    """Balls that fill a part, spread below its surface."""
    # Nodes are in the order of the cells of a grid: every so many are spread over all of them.
    rows = np.linspace(0, len(surface.node) - 1, min(_BALLS, len(surface.node))).astype(int)
    radius = _thickness(surface)[rows]
    return Balls(
        link=int(model.part_link[surface.reach.part]),
        centre=surface.node[rows] - radius[:, None] * surface.normal[rows],
        radius=radius,
    )


def _toucher(model: BodyModel, number: int) -> Balls:
    return Balls(
        link=int(model.toucher_link[number]),
        centre=model.toucher_place[number][None],
        radius=np.zeros(1),
    )


def _over(poses: np.ndarray, mover: Balls, solid: Solid, limit: np.ndarray) -> np.ndarray:
    """`(n,)` how much deeper than its limits one is in the other, in distances of kernels."""
    over = np.full(len(poses), -np.inf)
    _exceed(*_arguments(poses, mover, solid), limit, over)
    return over / solid.spacing


def _arguments(poses: np.ndarray, mover: Balls, solid: Solid) -> tuple[np.ndarray, ...]:
    """What compiled code takes, of `(n, J + 1, 4, 4)` poses of the links."""
    return (
        np.ascontiguousarray(poses[:, mover.link, :3]),
        np.ascontiguousarray(poses[:, solid.link, :3]),
        mover.centre,
        mover.radius,
        solid.corner,
        np.array([solid.cell]),
        solid.sides,
        solid.height,
        solid.kernel,
    )


@inner
def _depth(mover, wearer, centre, radius, corner, cell, sides, height, kernel):
    """Depth of a ball below a surface, and the kernel that it is next to; -inf where unknown."""
    place = np.empty(3)
    for axis in range(3):
        place[axis] = mover[axis, 3] - wearer[axis, 3]
        for other in range(3):
            place[axis] += mover[axis, other] * centre[other]
    at = np.empty(3)
    for axis in range(3):
        own = 0.0
        for other in range(3):
            own += wearer[other, axis] * place[other]
        at[axis] = (own - corner[axis]) / cell[0]
        if at[axis] < 0.0 or at[axis] >= sides[axis] - 1:
            return -np.inf, 0
    low0, low1, low2 = int(at[0]), int(at[1]), int(at[2])
    f0, f1, f2 = at[0] - low0, at[1] - low1, at[2] - low2
    total = 0.0
    for corner_of in range(8):
        i, j, k = corner_of >> 2, (corner_of >> 1) & 1, corner_of & 1
        weight = (f0 if i else 1 - f0) * (f1 if j else 1 - f1) * (f2 if k else 1 - f2)
        total += weight * height[((low0 + i) * sides[1] + low1 + j) * sides[2] + low2 + k]
    near = int(at[0] + 0.5) * sides[1] * sides[2] + int(at[1] + 0.5) * sides[2] + int(at[2] + 0.5)
    return radius - total, kernel[near]


@compiled
def _raise(mover, wearer, centre, radius, corner, cell, sides, height, kernel, deepest):
    for i in range(len(mover)):
        for ball in range(len(centre)):
            depth, at = _depth(
                mover[i], wearer[i], centre[ball], radius[ball], corner, cell, sides, height, kernel
            )
            if depth > deepest[at]:
                deepest[at] = depth


@compiled
def _exceed(mover, wearer, centre, radius, corner, cell, sides, height, kernel, limit, over):
    for i in range(len(mover)):
        for ball in range(len(centre)):
            depth, at = _depth(
                mover[i], wearer[i], centre[ball], radius[ball], corner, cell, sides, height, kernel
            )
            if depth - limit[at] > over[i]:
                over[i] = depth - limit[at]
