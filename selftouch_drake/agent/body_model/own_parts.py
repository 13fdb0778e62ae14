"""Own parts: how deep skinned parts and touchers may be in each other, as past postures tell.

The skins that the agent found are also what it must not run into. But soft skins give way, by as
much as a limb is thick, so a touch of two surfaces is no limit. Postures that the agent lived were
possible: parts may be as deep in each other as they have been, at that place of the skin. What has
no skin and touches nothing is not known here.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.depths import Meetings, exceed, push, raise_limits
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.body_model.surface import TouchedSurface
from selftouch_drake.agent.representation.quotient import QuotientRepresentation

# Cells of the grid around a part are this share of the distance between its kernels, and it has at
# most so many.
_CELL, _MOST_CELLS = 0.5, 400_000
# A part is known so far around its kernels, in distances of kernels.
_AROUND = 3.0
# Directions in which a toucher is looked at, and how far, in distances of kernels.
_DIRECTIONS, _FAR = 40, 8.0
# Balls that fill a part, at most.
_BALLS = 48
# Past postures that are looked at, at most, and neighbouring places that share their depths.
_PAST, _SHARED = 8_000, 5
# What is farther from its limit than this, in distances of kernels, is not looked at.
_SEEN = 0.5
# Where nothing has been near, parts may come as near as the first, touchers to each other as the
# second, in distances of kernels.
_UNKNOWN, _UNKNOWN_TOUCHER = -1.0, -4.0
# Two parts say nothing if they are nearer to their limit than this, in distances of kernels, in
# more than this share of past postures, of which so many are looked at.
_NEAR, _ALWAYS, _JUDGED = 0.2, 0.1, 2000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solid:
    """A part of the body as a field of depths: G corners of a grid, K kernels.

    Attributes:
        link: the link that wears it.
        spacing: distance between its kernels, the model's unit of length.
        corner: `(3,)` of the grid, in the frame of the link.
        cell: edge of a cell.
        sides: `(3,)` numbers of corners.
        height: `(G,)` height above the surface at each corner, negative inside; infinite where
            nobody knows.
        kernel: `(G,)` the nearest kernel, by number in `place`.
        place: `(K, 3)` places of the kernels.
        unknown: how deep, in distances of kernels, may be what has never been near.
    """

    link: int
    spacing: float
    corner: np.ndarray
    cell: float
    sides: np.ndarray
    height: np.ndarray
    kernel: np.ndarray
    place: np.ndarray
    unknown: float

    def clear(self) -> np.ndarray:
        """`(G,)` distances to the nearest corner that a ball must reach to count."""
        room = (_SEEN - self.unknown) * self.spacing
        far = distance_transform_edt(self.height.reshape(self.sides) > room)
        return self.cell * far.ravel()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mover:
    """A part or a toucher as what may run into others.

    Attributes:
        link: that carries it.
        balls: `(b, 4)` centres and radii, in the frame of the link.
    """

    link: int
    balls: np.ndarray

    @property
    def around(self) -> np.ndarray:
        """`(4,)` centre and radius of a ball that holds all of them."""
        centre, radius = self.balls[:, :3], self.balls[:, 3]
        middle = (centre.min(axis=0) + centre.max(axis=0)) / 2
        return np.append(middle, (np.linalg.norm(centre - middle, axis=1) + radius).max())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OwnParts:
    """Parts of the body, and how deep they have been in each other.

    Attributes:
        model: poses of the links.
        meetings: what may run into what, and how deep it may be in it, in distances of kernels.
        apart: how much farther than this they stay from each other, likewise.
    """

    model: BodyModel
    meetings: Meetings
    apart: float = 0.0

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
        touchers = np.unique([surface.reach.toucher for surface in surfaces])
        of_hand = model.hand_of_toucher[touchers]
        hands = [touchers[of_hand == hand] for hand in np.unique(of_hand)]
        movers = [_balls(model, surface) for surface in best.values()]
        movers += [_toucher(model, number) for number in touchers]
        solids = [_solid(model, part, surface) for part, surface in best.items()]
        solids += [_round(model, hand, surfaces) for hand in hands]
        q = representation.kernel_q
        poses = model.link_poses(q[:: max(1, len(q) // _PAST)].astype(float))
        meetings = _met(poses, _meetings(model, movers, solids), solids)
        over, _ = _over(meetings, poses[:: max(1, len(poses) // _JUDGED)])
        # What is always near its limit, as neighbouring links and what touches all the time, says
        # nothing.
        kept = np.flatnonzero(np.mean(over > -_NEAR, axis=1) <= _ALWAYS)
        return cls(model=model, meetings=_some(meetings, kept))

    def excess(self, q: np.ndarray) -> np.ndarray:
        """`(n,)` how much deeper than ever own parts are in each other, in distances of kernels.

        Args:
            q: `(n, J)` readings of the joints.

        Returns:
            The worst of all parts; negative where there is room, -inf where nothing can meet.
        """
        if not len(self.meetings.mover):
            return np.full(len(q), -np.inf)
        return _over(self.meetings, self.model.link_poses(q))[0].max(axis=0) + self.apart

    def near(self, q: np.ndarray) -> "OwnParts":
        """Those alone that come near their limits in some of `(n, J)` readings of the joints."""
        if not len(self.meetings.mover):
            return self
        over, _ = _over(self.meetings, self.model.link_poses(q))
        kept = np.flatnonzero(over.max(axis=1) > -_SEEN - self.apart)
        return replace(self, meetings=_some(self.meetings, kept))

    def pushes(self, q: np.ndarray, margin: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What drives own parts away from each other, as least squares have it.

        Args:
            q: `(n, J)` readings of the joints.
            margin: that shall be left to each limit, in distances of kernels.

        Returns:
            `(n,)` sums over all meetings of the square of what is missing to the margin, `(n, J)`
            half of their derivatives by the readings, and `(n, J, J)` products of the derivatives
            of what is missing.
        """
        num, joints = q.shape
        slope, square = np.zeros((num, joints)), np.zeros((num, joints, joints))
        poses = self.model.link_poses(q)
        over, kept = _over(self.meetings, poses)
        missing = np.maximum(over + margin + self.apart, 0.0)
        if missing.any():
            carries = np.zeros((joints + 1, joints), dtype=bool)
            for link in np.flatnonzero(self.model.used).tolist():
                carries[link, self.model.chain(link)] = True
            twists = self.model.twists
            push(self.meetings, poses, twists, carries, missing, kept, slope, square)
        return np.square(missing).sum(axis=0), slope, square


def _meetings(model: BodyModel, movers: list[Mover], solids: list[Solid]) -> Meetings:
    """All movers and solids that a joint can move to each other; limits are below all depths."""
    pairs = [
        (i, j)
        for i, mover in enumerate(movers)
        for j, solid in enumerate(solids)
        if _moves(model, mover.link, solid.link)
    ]
    mover, solid = np.array(pairs, dtype=int).reshape(-1, 2).T
    places = np.array([len(solids[j].place) for j in solid], dtype=int)
    return Meetings(
        mover=mover,
        solid=solid,
        mover_link=np.array([movers[i].link for i in mover], dtype=int),
        solid_link=np.array([solids[j].link for j in solid], dtype=int),
        balls=np.concatenate([np.zeros((0, 4)), *(one.balls for one in movers)]),
        first_ball=np.cumsum([0, *(len(one.balls) for one in movers)]),
        around=np.array([one.around for one in movers]).reshape(-1, 4),
        corner=np.array([one.corner for one in solids]).reshape(-1, 3),
        cell=np.array([one.cell for one in solids], dtype=float),
        sides=np.array([one.sides for one in solids], dtype=int).reshape(-1, 3),
        height=np.concatenate([np.zeros(0), *(one.height for one in solids)]),
        clear=np.concatenate([np.zeros(0), *(one.clear() for one in solids)]),
        place=np.concatenate([np.zeros(0, dtype=int), *(one.kernel for one in solids)]),
        grids=np.cumsum([0, *(len(one.height) for one in solids)])[:-1],
        limits=np.full(places.sum(), -np.inf),
        first_limit=np.cumsum([0, *places])[:-1],
        unit=np.array([solids[j].spacing for j in solid], dtype=float),
    )


def _met(poses: np.ndarray, meetings: Meetings, solids: list[Solid]) -> Meetings:
    """With the deepest of past postures as limits; neighbouring places share theirs."""
    limits = meetings.limits.copy()
    raise_limits(meetings, poses, limits)
    shared = []
    for number, first in zip(meetings.solid, meetings.first_limit, strict=True):
        solid = solids[number]
        deepest = limits[first : first + len(solid.place)]
        near = cKDTree(solid.place).query(solid.place, k=min(_SHARED, len(deepest)))[1]
        deepest = deepest[near.reshape(len(deepest), -1)].max(axis=1)
        shared.append(np.maximum(deepest, solid.unknown * solid.spacing))
    return meetings._replace(limits=np.concatenate([np.zeros(0), *shared]))


def _some(meetings: Meetings, kept: np.ndarray) -> Meetings:
    """Some of the meetings, by number."""
    each = ("mover", "solid", "mover_link", "solid_link", "first_limit", "unit")
    return meetings._replace(**{name: getattr(meetings, name)[kept] for name in each})


def _over(meetings: Meetings, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`(M, n)` how much deeper than its limit each meeting is, in distances of kernels, and where.

    The second is `kept` of `exceed`.
    """
    over = np.empty((len(meetings.mover), len(poses)))
    kept = np.empty((*over.shape, 2, 3))
    exceed(meetings, poses, over, kept)
    return over, kept


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
    height = surface.height(place)
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
        unknown=_UNKNOWN,
    )


def _round(model: BodyModel, hand: np.ndarray, surfaces: list[TouchedSurface]) -> Solid:
    """The field of depths of a hand: balls whose surfaces are their centres, in some directions."""
    spacing = max(s.spacing for s in surfaces if s.reach.toucher in hand)
    centre = model.toucher_place[hand]
    # Directions spread evenly (a Fibonacci sphere).
    number = np.arange(_DIRECTIONS) + 0.5
    up = 1.0 - 2.0 * number / _DIRECTIONS
    turn = np.pi * (1.0 + np.sqrt(5.0)) * number
    flat = np.sqrt(1.0 - up**2)
    direction = np.stack([np.cos(turn) * flat, np.sin(turn) * flat, up], axis=1)
    half = round(_FAR / _CELL)
    cell = _CELL * spacing
    corner = centre.min(axis=0) - half * cell
    sides = np.ceil(np.ptp(centre, axis=0) / cell).astype(int) + 2 * half + 1
    at = np.stack(np.meshgrid(*map(np.arange, sides), indexing="ij"), axis=-1).reshape(-1, 3)
    at = corner + cell * at
    height, nearest = cKDTree(centre).query(at)
    towards = ((at - centre[nearest]) @ direction.T).argmax(axis=1)
    return Solid(
        link=int(model.toucher_link[hand[0]]),
        spacing=spacing,
        corner=corner,
        cell=cell,
        sides=sides,
        height=height,
        kernel=_DIRECTIONS * nearest + towards,
        place=(centre[:, None] + spacing * direction).reshape(-1, 3),
        unknown=_UNKNOWN_TOUCHER,
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


def _balls(model: BodyModel, surface: TouchedSurface) -> Mover:
    """Balls that fill a part, spread below its surface."""
    # Nodes are in the order of the cells of a grid: every so many are spread over all of them.
    rows = np.linspace(0, len(surface.node) - 1, min(_BALLS, len(surface.node))).astype(int)
    radius = _thickness(surface)[rows]
    centre = surface.node[rows] - radius[:, None] * surface.normal[rows]
    return Mover(
        link=int(model.part_link[surface.reach.part]),
        balls=np.column_stack([centre, radius]),
    )


def _toucher(model: BodyModel, number: int) -> Mover:
    return Mover(
        link=int(model.toucher_link[number]),
        balls=np.append(model.toucher_place[number], 0.0)[None],
    )
