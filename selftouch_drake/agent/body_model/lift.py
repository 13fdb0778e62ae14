"""From a way over the skin to a motion of the joints: inverse kinematics, smooth as a whole."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.linalg import solveh_banded

from selftouch_drake.agent.body_model.own_parts import OwnParts
from selftouch_drake.agent.body_model.reach import Reach
from selftouch_drake.agent.body_model.surface import TouchedSurface

# Tolerances of the toucher's place across and along the skin, in distances of kernels.
_ACROSS, _ALONG = 0.05, 0.2
# A posture touches the skin if its toucher is nearer to it than this, in distances of kernels.
_NEAR = 1.5
# It presses the skin if it is no higher above firm touches than this, likewise.
_HIGH = 0.3
# Steps of damped least squares that put a posture onto its place, and from there onto the next.
_PUT, _FOLLOWED = 8, 3
# Steps of Gauss-Newton over the whole motion, each at most so long, mu.
_SMOOTHED, _MOST = 15, 0.5
# A step that does not pay is halved so often; when one gains less than this share, the motion is
# smooth.
_HALVED, _GAIN = 4, 0.01
# Weight of squared acceleration beside squared speed, per knot and mu, and squared errors of the
# place in their tolerances.
_ACCELERATION = 20.0
# Own parts keep this from their limits, in distances of kernels, with this tolerance.
_MARGIN, _APART = 0.2, 0.1
# The end is held more tightly than the way, by this factor, for so many knots.
_TIGHT, _END = 2.0, 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkinWay:
    """A way over the skin for one toucher: T knots.

    Attributes:
        place: `(T, 3)` where the toucher's centre shall be.
        normal: `(T, 3)` outward normals of the skin there.
        across: tolerance across the skin, the model's unit of length.
        along: tolerance along it.
    """

    place: np.ndarray
    normal: np.ndarray
    across: float
    along: float

    def higher(self, by: np.ndarray) -> "SkinWay":
        """The way, `(T,)` higher above the skin."""
        return replace(self, place=self.place + by[:, None] * self.normal)

    def ending(self, end: np.ndarray) -> "SkinWay":
        """The way with `(3,)` another last place."""
        return replace(self, place=np.concatenate([self.place[:-1], end[None]]))

    def weight(self) -> np.ndarray:
        """`(T, 3, 3)` roots of the weights of errors of the place."""
        across = np.einsum("ta,tb->tab", self.normal, self.normal)
        root = across / self.across + (np.eye(3) - across) / self.along
        root[-_END:] *= _TIGHT
        return root


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lifter:
    """Lifts ways over one part of the skin to the joints of one toucher.

    Postures are scaled, mu, over the joints of the reach alone where it says `(…, L)`.

    Attributes:
        surface: the skin and the toucher.
        scale: `(J,)` mu per unit of each joint's reading.
        lower: `(J,)` lowest scaled posture.
        upper: `(J,)` highest scaled posture.
        pressure: how much deeper than firm touches ways are, in distances of kernels.
    """

    surface: TouchedSurface
    scale: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    pressure: float = 0.0

    @property
    def reach(self) -> Reach:
        """The kinematics."""
        return self.surface.reach

    def over(self, place: np.ndarray) -> SkinWay:
        """A way over the skin through `(T, 3)` places on the surface."""
        spacing = self.surface.spacing
        normal = self.surface.projected(place)[1]
        return SkinWay(
            place=place - self.pressure * spacing * normal,
            normal=normal,
            across=_ACROSS * spacing,
            along=_ALONG * spacing,
        )

    def touches(self, x: np.ndarray) -> bool:
        """Whether the toucher is at the skin in a posture `(J,)`."""
        far = self.surface.nodes.query(self.centres(x[None]))[0][0]
        return bool(far < _NEAR * self.surface.spacing)

    def presses(self, x: np.ndarray) -> bool:
        """Whether the toucher is as deep as in touches, in a posture `(J,)`."""
        return self.touches(x) and self.above(x) < _HIGH

    def above(self, x: np.ndarray) -> float:
        """How much higher than in firm touches the toucher is, in distances of kernels.

        Args:
            x: `(J,)` scaled posture.
        """
        return float(self.surface.height(self.centres(x[None]))[0]) / self.surface.spacing

    def places(self, x: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `Reach.places`, at `(n, J)` x; derivatives are per mu."""
        place, by_q = self.reach.places(x / self.scale, normal)
        return place, by_q / self.scale[self.reach.joints]

    def centres(self, x: np.ndarray) -> np.ndarray:
        """`(n, 3)` the toucher's places at `(n, J)` x, where it touches the skin or is near it."""
        place, _ = self.places(x, np.zeros((len(x), 3)))
        if self.reach.shape.any():
            place, _ = self.places(x, self.surface.projected(place)[1])
        return place

    def put(
        self, x: np.ndarray, place: np.ndarray, normal: np.ndarray, *, steps: int = _PUT
    ) -> np.ndarray:
        """As `Reach.put`, at `(n, J)` x."""
        limits = self.lower / self.scale, self.upper / self.scale
        q = self.reach.put(x / self.scale, place, normal, limits, scale=self.scale, steps=steps)
        return q * self.scale

    def blended(self, x_start: np.ndarray, x_goal: np.ndarray, way: SkinWay) -> np.ndarray:
        """`(n, T, J)` motions from one posture to n others, each put onto the way.

        Args:
            x_start: `(J,)`.
            x_goal: `(n, J)`.
            way: over the skin.
        """
        number, num = len(x_goal), len(way.place)
        share = np.linspace(0.0, 1.0, num)[None, :, None]
        x = x_start + share * (x_goal - x_start)[:, None]
        flat = self.put(
            x.reshape(-1, len(x_start)),
            np.tile(way.place, (number, 1)),
            np.tile(way.normal, (number, 1)),
        )
        x = flat.reshape(number, num, -1)
        x[:, 0] = x_start
        return x

    def followed(self, x_start: np.ndarray, way: SkinWay) -> np.ndarray:
        """`(T, J)` the motion from a posture that follows the way step by step."""
        limits = self.lower / self.scale, self.upper / self.scale
        q_start, place, normal = x_start / self.scale, way.place[1:], way.normal[1:]
        q = self.reach.follow(q_start, place, normal, limits, scale=self.scale, steps=_FOLLOWED)
        return np.concatenate([x_start[None], q * self.scale])

    def smoothed(
        self,
        x: np.ndarray,
        way: SkinWay,
        own_parts: OwnParts | None = None,
        *,
        held: bool = False,
    ) -> np.ndarray:
        """`(T, J)` a motion like `(T, J)` x, as smooth and short as tolerances allow.

        The first posture stays.

        Args:
            x: the motion.
            way: over the skin.
            own_parts: they are driven apart where they are too near to their limits.
            held: whether the last posture stays as well.
        """
        x, joints = x.copy(), self.reach.joints
        num, length = len(x), len(joints)
        lower, upper = self.lower[joints], self.upper[joints]
        root, rough = way.weight(), roughness(num, acceleration=_ACCELERATION)
        bands = roughness_bands(rough, length)

        def state(x: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
            """The cost, half of its derivatives `(T, L)`, and their own, but for roughness."""
            at, by_x = self.places(x, way.normal)
            error = np.einsum("tab,tb->ta", root, at - way.place)
            slope = np.einsum("tab,tbl->tal", root, by_x)
            own = x[:, joints]
            pull = rough @ own
            cost = float(np.sum(error**2) + np.sum(own * pull))
            pull += np.einsum("tal,ta->tl", slope, error)
            square = np.einsum("tal,tam->tlm", slope, slope)
            if own_parts is not None:
                apart, by_q, by_qs = own_parts.pushes(x / self.scale, _MARGIN)
                scale = self.scale[joints]
                cost += float(apart.sum()) / _APART**2
                pull += by_q[:, joints] / scale / _APART**2
                square += by_qs[:, joints][:, :, joints] / np.outer(scale, scale) / _APART**2
            return cost, pull, square

        cost, pull, square = state(x)
        for _ in range(_SMOOTHED):
            system = with_blocks(bands, square)
            # What is given leaves the system: the first posture, and the last if it is held.
            free = slice(1, num - held)
            own = system[:, length * free.start : length * free.stop]
            step = -solveh_banded(own, pull[free].ravel(), lower=True).reshape(-1, length)
            step *= min(1.0, _MOST / max(np.abs(step).max(), 1e-12))
            for _ in range(_HALVED):
                trial = x.copy()
                trial[free, joints] = np.clip(x[free, joints] + step, lower, upper)
                found = state(trial)
                if found[0] < cost:
                    break
                step *= 0.5
            else:
                break
            gained = cost - found[0]
            x, (cost, pull, square) = trial, found
            if gained < _GAIN * cost:
                break
        return x


@lru_cache(maxsize=32)
def roughness(num: int, *, acceleration: float) -> np.ndarray:
    """`(T, T)` what squared speed and acceleration, so much weighed, of T knots make of them."""
    speed = np.diff(np.eye(num), axis=0)
    bend = np.diff(np.eye(num), 2, axis=0)
    return speed.T @ speed + acceleration * bend.T @ bend


def roughness_bands(rough: np.ndarray, length: int) -> np.ndarray:
    """`(3 L, T L)` lower bands of what `(T, T)` roughness makes of each of L joints."""
    bands = np.zeros((3 * length, len(rough) * length))
    for off in range(3):
        repeated = np.repeat(np.diag(rough, -off), length)
        bands[off * length, : len(repeated)] = repeated
    return bands


def with_blocks(bands: np.ndarray, square: np.ndarray) -> np.ndarray:
    """Lower bands to which `(T, L, L)` blocks of each knot are added."""
    system, (num, length, _) = bands.copy(), square.shape
    for off in range(length):
        diagonal = np.zeros((num, length))
        diagonal[:, : length - off] = np.diagonal(square, off, 1, 2)
        system[off] += diagonal.ravel()
    return system
