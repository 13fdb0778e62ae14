"""What hypotheses of a body are compared with: recordings, grain and the layout of the body."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from selftouch_drake.agent.body_model.both_sides.descent import Data, descend, losses
from selftouch_drake.agent.body_model.both_sides.grain import Skin, learned_skin
from selftouch_drake.agent.body_model.both_sides.recordings import (
    Layout,
    Recording,
    same_posture,
)

# Touches within so many rad are one posture, whose sensations are averaged; a posture weighs as
# the fourth root of its touches: repeated contacts err alike.
_ONE_POSTURE, _BY_NUMBER = 0.02, 0.25
# Pairs of receptors of each kind that a step looks at, and that an evaluation does.
_DRAWN, _EVALUATED = 128, 4000
# Share of the steps after which the scale of residuals has come down.
_ANNEALED = 0.7


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Population:
    """Hypotheses of a body.

    Attributes:
        rows: `(B, P)` float32, as `descent.py` describes them.
        orders: `(B, J)` column of the readings that turns each joint.
        loss: `(B,)` in hundreds; NaN where nothing has been evaluated.
    """

    rows: np.ndarray
    orders: np.ndarray
    loss: np.ndarray

    def some(self, index: np.ndarray | slice) -> "Population":
        """Some of the hypotheses."""
        return Population(rows=self.rows[index], orders=self.orders[index], loss=self.loss[index])

    def best(self, number: int = 1) -> "Population":
        """The best hypotheses, best first."""
        return self.some(np.argsort(self.loss, kind="stable")[:number])

    def together(self, *others: "Population") -> "Population":
        """These and others."""
        return Population(
            rows=np.concatenate([self.rows, *(other.rows for other in others)]),
            orders=np.concatenate([self.orders, *(other.orders for other in others)]),
            loss=np.concatenate([self.loss, *(other.loss for other in others)]),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """What all problems of one body share.

    Attributes:
        layout: which joints carry what.
        skins: what touches say of each skin.
        points: names of ends that are single points.
        num_joints: columns of the readings.
    """

    layout: Layout
    skins: Mapping[str, Skin]
    points: Sequence[str]
    num_joints: int

    @staticmethod
    def of(recordings: Sequence[Recording], layout: Layout, size: int = 20) -> "Body":
        """Skins are learned from all recordings, whatever is fitted later.

        Args:
            recordings: of the body.
            layout: which joints carry what.
            size: patterns of which the places of a skin are made.
        """
        ends = sorted({end for one in recordings for end in (one.above, one.below)})
        felt = {
            end: [own for one in recordings if (own := one.felt(end)) is not None] for end in ends
        }
        return Body(
            layout=layout,
            skins={end: learned_skin(np.concatenate(felt[end]), size) for end in ends if felt[end]},
            points=[end for end in ends if not felt[end]],
            num_joints=recordings[0].q.shape[1],
        )

    @property
    def ends(self) -> list[str]:
        """All ends: skins, then points."""
        return [*self.skins, *self.points]

    def size(self, end: str) -> int:
        """Number of coefficients of an end."""
        return self.skins[end].basis.shape[1] if end in self.skins else 1

    @property
    def length(self) -> int:
        """Numbers of a hypothesis."""
        return 6 * self.num_joints + 3 * sum(self.size(end) for end in self.ends)

    def axes(self, rows: np.ndarray) -> np.ndarray:
        """`(..., J, 3)` view of the axes of hypotheses; not of unit length."""
        return rows[..., : 3 * self.num_joints].reshape(*rows.shape[:-1], -1, 3)

    def centres(self, rows: np.ndarray) -> np.ndarray:
        """`(..., J, 3)` view of the points on the axes."""
        own = rows[..., 3 * self.num_joints : 6 * self.num_joints]
        return own.reshape(*rows.shape[:-1], -1, 3)

    def slice_of(self, end: str) -> slice:
        """Where the coefficients of an end are in a row."""
        first = 6 * self.num_joints
        for other in self.ends:
            if other == end:
                return slice(first, first + 3 * self.size(end))
            first += 3 * self.size(other)
        raise KeyError(end)

    def coefficients(self, rows: np.ndarray, end: str) -> np.ndarray:
        """`(..., K, 3)` view of the coefficients of an end."""
        return rows[..., self.slice_of(end)].reshape(*rows.shape[:-1], -1, 3)

    def places(self, row: np.ndarray, skin: str) -> np.ndarray:
        """`(n, 3)` places of a skin's receptors, all joints at 0."""
        return self.skins[skin].basis @ self.coefficients(row, skin).astype(float)

    def free(self, ends: Sequence[str] | None = None, joints: Sequence[int] | None = None):
        """`(P,)` whether a number may change: those of some ends and joints; all by default."""
        free = np.zeros(self.length, dtype=bool)
        for end in self.ends if ends is None else ends:
            free[self.slice_of(end)] = True
        for joint in range(self.num_joints) if joints is None else joints:
            free[3 * joint : 3 * joint + 3] = True
            free[3 * (self.num_joints + joint) : 3 * (self.num_joints + joint) + 3] = True
        return free


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Problem:
    """Some recordings of a body.

    Attributes:
        body: its skins and layout.
        recordings: that are fitted.
        data: the same for compiled code.
        random: source of the pairs that are looked at.
    """

    body: Body
    recordings: Sequence[Recording]
    data: Data = field(repr=False)
    random: np.random.Generator

    @staticmethod
    def of(body: Body, recordings: Sequence[Recording], seed: int = 0) -> "Problem":
        """Postures are collapsed, and all arrays laid out."""
        return Problem(
            body=body, recordings=recordings, data=_laid_out(body, recordings),
            random=np.random.default_rng(seed),
        )  # fmt: skip

    @property
    def joints(self) -> list[int]:
        """Joints that any recording needs."""
        return np.flatnonzero(self.data.used).tolist()

    def evaluated(self, rows: np.ndarray, orders: np.ndarray, sigma: float) -> Population:
        """Hypotheses with their losses: always at the same pairs of receptors."""
        draws = self._draws(np.random.default_rng(0), 1, _EVALUATED)[0]
        slopes, parts = np.empty_like(rows), np.empty((len(rows), len(self.recordings)))
        loss = losses(rows, orders, self.data, draws, sigma, slopes, parts)
        return Population(rows=rows, orders=orders, loss=loss)

    def parts(self, population: Population, sigma: float) -> np.ndarray:
        """`(B, R)` loss of each recording for each of its postures."""
        draws = self._draws(np.random.default_rng(0), 1, 1)[0]
        rows = population.rows
        slopes, parts = np.empty_like(rows), np.empty((len(rows), len(self.recordings)))
        losses(rows, population.orders, self.data, draws, sigma, slopes, parts)
        return parts

    def descended(
        self,
        population: Population,
        *,
        steps: int,
        rate: float,
        sigmas: tuple[float, float],
        free: np.ndarray | None = None,
    ) -> Population:
        """Hypotheses moved downhill, and evaluated; in the order in which they came.

        Args:
            population: where to begin.
            steps: of Adam.
            rate: of the first step; it falls to 0 as a cosine.
            sigmas: scale of the residuals, in diameters of a contact, at first and in the end.
            free: `(P,)` whether a number may change; all by default.
        """
        at = np.arange(steps)
        rates = rate / 2 * (1 + np.cos(np.pi * at / steps))
        scale = sigmas[0] * (sigmas[1] / sigmas[0]) ** np.minimum(1, at / (_ANNEALED * steps))
        rows = population.rows.copy()
        free = self.body.free() if free is None else free
        draws = self._draws(self.random, steps, _DRAWN)
        descend(rows, population.orders, self.data, draws, rates, scale, free)
        return self.evaluated(rows, population.orders, sigmas[1])

    def _draws(self, random: np.random.Generator, steps: int, number: int) -> np.ndarray:
        """`(steps, E, 3, number)` pairs of receptors."""
        skins = list(self.body.skins)
        draws = np.zeros((steps, len(self.body.ends), 3, number), dtype=np.int32)
        near, far = 0, 0
        fitted = {end for one in self.recordings for end in (one.above, one.below)}
        for end, name in enumerate(skins):
            skin = self.body.skins[name]
            if name in fitted:
                cumulated = np.cumsum(skin.trust)
                trusted = np.searchsorted(cumulated, random.random((steps, number)))
                draws[:, end, 0] = near + np.minimum(trusted, len(skin.near) - 1)
                draws[:, end, 1] = near + random.integers(len(skin.near), size=(steps, number))
                if len(skin.far):
                    drawn = random.integers(len(skin.far), size=(steps, number))
                    draws[:, end, 2] = far + drawn
            near, far = near + len(skin.near), far + len(skin.far)
        return draws


def _laid_out(body: Body, recordings: Sequence[Recording]) -> Data:
    layout, ends = body.layout, body.ends
    fitted = {end for one in recordings for end in (one.above, one.below)}
    ways = [layout.joints(end) for end in ends]
    used = np.zeros(body.num_joints, dtype=bool)
    for one in recordings:
        used[layout.between(one)] = True
    collapsed = [collapse(body, one) for one in recordings]
    begin = np.cumsum([0, *(len(q) for q, *_ in collapsed)])
    sizes = np.array([body.size(end) for end in ends])
    share = np.zeros((2, sizes.max(), begin[-1]), dtype=np.float32)
    for first, (_, above, below, _) in zip(begin, collapsed, strict=False):
        for side, own in enumerate((above, below)):
            share[side, : own.shape[1], first : first + len(own)] = own.T
    q = np.concatenate([q for q, *_ in collapsed])
    skins = [body.skins.get(end) for end in ends]
    number = np.array(
        [len(body.skins[end].basis) if {end} & fitted & {*body.skins} else 0 for end in ends]
    )
    basis = np.zeros((len(ends), sizes.max(), max(1, number.max())), dtype=np.float32)
    for end, skin in enumerate(skins):
        if skin is not None and number[end]:
            basis[end, : sizes[end], : number[end]] = skin.basis.T
    way = np.zeros((len(ends), max(1, *(len(own) for own in ways))), dtype=np.int64)
    for row, joints in zip(way, ways, strict=True):
        row[: len(joints)] = joints
    known = list(body.skins.values())
    return Data(
        cos=np.ascontiguousarray(np.cos(q).T, dtype=np.float32),
        sin=np.ascontiguousarray(np.sin(q).T, dtype=np.float32),
        share=share,
        weight=np.concatenate([weight for *_, weight in collapsed]).astype(np.float32),
        begin=begin,
        ends=np.array([[ends.index(one.above), ends.index(one.below)] for one in recordings]),
        way=way,
        length=np.array([len(own) for own in ways]),
        offset=np.array([body.slice_of(end).start for end in ends]),
        size=sizes,
        basis=basis,
        number=number,
        near=np.concatenate([skin.near for skin in known]).astype(np.int32),
        spacing=np.log(np.concatenate([skin.spacing for skin in known])).astype(np.float32),
        far=np.concatenate([skin.far for skin in known]).astype(np.int32).reshape(-1, 2),
        used=used,
    )


def shares(skins: Mapping[str, Skin], one: Recording) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of a recording's touches that both ends can tell: rows, and mean basis above and below."""
    told = np.ones(len(one.q), dtype=bool)
    both = []
    for end in (one.above, one.below):
        felt = one.felt(end)
        if felt is None:
            both.append(np.ones((len(one.q), 1)))
            continue
        share, felt_any = skins[end].shares(felt)
        both.append(share)
        told &= felt_any
    rows = np.flatnonzero(told)
    return rows, both[0][rows], both[1][rows]


def collapse(body: Body, one: Recording) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Postures of a recording: `(n, J)` readings, mean shares above and below, and weights."""
    rows, above, below = shares(body.skins, one)
    q = one.q[rows]
    label = same_posture(q[:, body.layout.between(one)], _ONE_POSTURE)
    number = np.bincount(label).astype(float)
    mean = np.zeros((len(number), len(label)))
    mean[label, np.arange(len(label))] = 1 / number[label]
    weight = number**_BY_NUMBER
    return mean @ q, mean @ above, mean @ below, weight / weight.mean()
