"""Bodies that cost nothing: chains of random joints on a made-up skin, and what is no chain.

Each case is drawn from its kind and its seed alone. Postures are moved onto the skin by Newton's
method; kernels are places spread evenly over what was touched, and a touch belongs to the place
that is nearest to it, seen with a little noise. Readings have units, zeros, signs and an order of
their own.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.body_model.chain import places

#: A body: `(n, J)` angles and shifts, and `(n, H)` random numbers, to `(n, 3)` places.
Body = Callable[[np.ndarray, np.ndarray], np.ndarray]

RANGE = 2.0
_NOISE = 0.003  # Of the extent of the skin, on the place that decides the kernel.


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Case:
    """What an agent is given, and whether it may believe in a body.

    Attributes:
        kind: of the case.
        seed: of the case.
        what: in words.
        right: whether joints that turn or slide explain it.
        q: `(n, J)` readings.
        target: `(n,)` kernels.
        place: `(n, 3)` true places; NaN where there are none.
        part: `(K,)` 0 for each kernel.
        slots: `(J,)` which true joint each reading shows.
        unit: `(J,)` of each reading.
        zero: `(J,)` each reading where its true joint is at 0.
        twists: `(L, 6)` true twists of the chain, from the skin on. What is no chain was made from
            them.
        point: `(3,)` the true toucher.
    """

    kind: str
    seed: int
    what: str
    right: bool
    q: np.ndarray
    target: np.ndarray
    place: np.ndarray
    part: np.ndarray
    slots: np.ndarray
    unit: np.ndarray
    zero: np.ndarray
    twists: np.ndarray
    point: np.ndarray


def joints_of(random: np.random.Generator, number: int, slides: int) -> tuple[np.ndarray, ...]:
    """`(J, 6)` twists of a chain and `(3,)` its point."""
    axis = random.standard_normal((number, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    through = random.standard_normal((number, 3))
    twists = np.concatenate([axis, np.cross(through, axis)], axis=1)
    sliding = np.zeros(number, dtype=bool)
    sliding[random.permutation(number)[:slides]] = True
    twists[sliding] = np.concatenate([np.zeros((number, 3)), axis], axis=1)[sliding]
    return twists, random.standard_normal(3)


def planar_joints(random: np.random.Generator, number: int) -> tuple[np.ndarray, ...]:
    """The same for hinges with parallel axes, and a point in a plane across them."""
    axis = np.tile([0.0, 0.0, 1.0], (number, 1))
    through = random.standard_normal((number, 3)) * [1, 1, 0]
    twists = np.concatenate([axis, np.cross(through, axis)], axis=1)
    return twists, random.standard_normal(3) * [1, 1, 0]


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """A closed surface: a ball, an ellipsoid or a box with round edges about a center."""

    center: np.ndarray
    axes: np.ndarray
    power: float

    def depth(self, y: np.ndarray) -> np.ndarray:
        """`(n,)` 0 on the skin, negative inside."""
        z = np.abs((y - self.center) / self.axes)
        return (z**self.power).sum(axis=1) ** (1 / self.power) - 1


def a_skin(body: Body, joints: int, hidden: int, random: np.random.Generator) -> Skin:
    """A skin that the body reaches."""
    q = random.uniform(-RANGE, RANGE, (4000, joints))
    cloud = body(q, random.random((len(q), hidden)))
    center = np.median(cloud, axis=0)
    size = float(np.median(np.linalg.norm(cloud - center, axis=1)))
    shape = int(random.integers(3))
    axes = np.full(3, size) if shape == 0 else size * random.uniform(0.7, 1.2, 3)
    return Skin(center, axes, 4.0 if shape == 2 else 2.0)


def touching(
    body: Body, joints: int, hidden: int, skin: Skin, number: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """`(n, J)` postures on the skin, and `(n, 3)` their places."""
    kept_q: list[np.ndarray] = []
    kept_y: list[np.ndarray] = []
    step = 1e-5
    while sum(map(len, kept_q)) < number:
        q = random.uniform(-RANGE, RANGE, (3 * number, joints))
        luck = random.random((len(q), hidden))
        for _ in range(8):
            depth = skin.depth(body(q, luck))
            slope = np.empty_like(q)
            for joint in range(joints):
                moved = q.copy()
                moved[:, joint] += step
                slope[:, joint] = (skin.depth(body(moved, luck)) - depth) / step
            square = (slope**2).sum(axis=1) + 1e-9
            move = -depth[:, None] * slope / square[:, None]
            q = q + move * np.minimum(1, 0.4 / (np.linalg.norm(move, axis=1) + 1e-12))[:, None]
        y = body(q, luck)
        on = (np.abs(skin.depth(y)) < 1e-3) & (np.abs(q) < RANGE).all(axis=1)
        kept_q.append(q[on])
        kept_y.append(y[on])
    return np.concatenate(kept_q)[:number], np.concatenate(kept_y)[:number]


def kernels_of(y: np.ndarray, kernels: int, random: np.random.Generator) -> np.ndarray:
    """`(n,)` the kernel of each touch: the nearest of K places far from each other."""
    extent = np.linalg.norm(np.ptp(y, axis=0))
    seen = y + _NOISE * extent * random.standard_normal(y.shape)
    anchors, apart = [], np.full(len(y), np.inf)
    for _ in range(kernels):
        anchors.append(seen[apart.argmax()])
        apart = np.minimum(apart, np.linalg.norm(seen - anchors[-1], axis=1))
    return ((seen[:, None] - np.array(anchors)[None]) ** 2).sum(axis=2).argmin(axis=1)


def as_read(q: np.ndarray, random: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Readings with units, signs, zeros and an order of their own; order, units and zeros."""
    joints = q.shape[1]
    unit = 10 ** random.uniform(-2, 2, joints) * random.choice([-1.0, 1.0], joints)
    order = random.permutation(joints)
    zero = random.uniform(-2, 2, joints) * np.abs(unit)
    return q[:, order] * unit[order] + zero[order], order, unit[order], zero[order]


def moves(body: Body, q: np.ndarray, y: np.ndarray) -> np.ndarray:
    """`(J,)` by how much places move if a joint stands still, rms in shares of the extent."""
    extent = np.linalg.norm(np.ptp(y, axis=0))
    found = []
    for joint in range(q.shape[1]):
        still = q.copy()
        still[:, joint] = np.median(q[:, joint])
        away = body(still, np.zeros((len(q), 0))) - y
        away = away - away.mean(axis=0)
        found.append(np.sqrt((away**2).sum(axis=1).mean()) / extent)
    return np.array(found)


def rigid(twists: np.ndarray, point: np.ndarray) -> Body:
    """A chain of joints."""
    return lambda q, luck: places(q, twists, point)


def soft(twists: np.ndarray, point: np.ndarray, random: np.random.Generator, much: float) -> Body:
    """A chain whose links bend, each with how the links before it stand, as under their weight."""
    joints = len(twists)
    bends, _ = joints_of(random, joints, 0)
    phase = random.uniform(-np.pi, np.pi, joints)
    both = np.stack([twists, bends], axis=1).reshape(-1, 6)

    def body(q: np.ndarray, luck: np.ndarray, amount: float = 1.0) -> np.ndarray:
        bent = amount * np.sin(np.cumsum(q, axis=1) + phase)
        return places(np.stack([q, bent], axis=2).reshape(len(q), -1), both, point)

    # So much of the extent, whatever the links are.
    q = random.uniform(-RANGE, RANGE, (2000, joints))
    stiff = body(q, q, 0.0)
    extent = np.linalg.norm(np.ptp(stiff, axis=0))
    trial = 0.05
    away = body(q, q, trial) - stiff
    away = away - away.mean(axis=0)
    amount = trial * much * extent / np.sqrt((away**2).sum(axis=1).mean())
    return lambda q, luck: body(q, luck, amount)


def rolling(
    twists: np.ndarray, point: np.ndarray, random: np.random.Generator, much: float
) -> Body:
    """A chain with a wheel at its end, which rolls as it likes and touches with its rim."""
    q = random.uniform(-RANGE, RANGE, (2000, len(twists)))
    radius = much * np.linalg.norm(np.ptp(places(q, twists, point), axis=0))
    axes = np.linalg.qr(random.standard_normal((3, 2)))[0]
    wheel = np.concatenate([np.cross(axes[:, 0], axes[:, 1]), np.zeros(3)])
    hub = wheel.copy()
    hub[3:] = np.cross(point, wheel[:3])
    longer = np.concatenate([twists, hub[None]])
    rim = point + radius * axes[:, 0]
    return lambda q, luck: places(np.column_stack([q, 2 * np.pi * luck[:, 0]]), longer, rim)


def smooth(joints: int, random: np.random.Generator) -> Body:
    """A smooth map that knows no joints: sines of random directions in motor space."""
    waves = 0.9 * random.standard_normal((joints, 40))
    phase = random.uniform(-np.pi, np.pi, 40)
    size = random.standard_normal((40, 3)) / np.sqrt(40)
    return lambda q, luck: np.sin(q @ waves + phase) @ size


#: Kinds of what is no body, with what is given to each.
WRONG = {
    "mixed": "readings that mix joints, q + a sin(2 q')",
    "missing": "a joint left out that moves places by 5 % and more",
    "soft": "links that bend",
    "rolling": "a wheel that rolls at the end",
    "swapped": "labels permuted between places for half of the postures",
    "shuffled": "sensations shuffled between rows",
    "noise": "readings and labels at random",
    "smooth": "a smooth map that knows no joints",
    "crowded": "touches that crowd: each kernel one posture, places at random",
    "crowded_two": "the same with two postures for each kernel",
    "pose": "labels from a clustering of motor space itself",
}


#: The fewest joints of a kind, and how many numbers of joints there are.
JOINTS = {"short": (2, 2), "planar": (3, 3), "missing": (4, 5), "mixed": (4, 5)}


def case(kind: str, seed: int, *, touches: int = 0, kernels: int = 300) -> Case:
    """The case of a kind and a seed.

    Args:
        kind: `right`, `short`, `planar` or one of `WRONG`.
        seed: it decides the number of joints, too.
        touches: how many; 8,000 by default.
        kernels: how many.
    """
    kinds = ["right", "short", "planar", *WRONG]
    random = np.random.default_rng([seed, kinds.index(kind)])
    # A line needs fewer places than a surface.
    kernels = kernels // 3 if kind == "planar" else kernels
    least, kinds_of = JOINTS.get(kind, (4, 6))
    joints = least + seed % kinds_of
    number = touches or 8000
    slides = int(random.integers(0, 2 if joints < 4 else 3))
    if kind == "planar":
        twists, point = planar_joints(random, joints)
    else:
        twists, point = joints_of(random, joints, slides)
    body, hidden, amount = rigid(twists, point), 0, 0.0
    if kind == "soft":
        amount = float(random.choice([0.06, 0.1, 0.15]))
        body = soft(twists, point, random, amount)
    elif kind == "rolling":
        amount, hidden = float(random.choice([0.06, 0.1, 0.15])), 1
        body = rolling(twists, point, random, amount)
    elif kind == "smooth":
        body = smooth(joints, random)
    skin = a_skin(body, joints, hidden, random)
    q, y = touching(body, joints, hidden, skin, number, random)
    target = kernels_of(y, kernels, random)
    if kind == "mixed":
        amount = float(random.choice([0.1, 0.2, 0.3]))
        q = q + amount * np.sin(2 * q[:, ::-1])
    elif kind == "missing":
        much = moves(body, q, y)
        enough = np.flatnonzero(much >= 0.05)
        out = int(enough[much[enough].argmin()])
        amount, q = float(much[out]), np.delete(q, out, axis=1)
    elif kind == "swapped":
        other = random.permutation(kernels)
        half = q[:, 0] > np.median(q[:, 0])
        target = np.where(half, other[target], target)
    elif kind == "shuffled":
        target = random.permutation(target)
    elif kind == "noise":
        q, target = random.uniform(-1, 1, q.shape), random.integers(0, kernels, len(q))
    elif kind in ("crowded", "crowded_two"):
        postures = 1 if kind == "crowded" else 2
        at = random.uniform(-RANGE, RANGE, (kernels, postures, joints))
        target = random.integers(0, kernels, len(q))
        q = at[target, random.integers(0, postures, len(q))]
        q = q + 0.05 * random.standard_normal(q.shape)
    elif kind == "pose":
        target = kernels_of(q, kernels, random)
    readings, order, unit, zero = as_read(q, random)
    right = kind not in WRONG
    size = f" ({amount:.2f})" if amount else ""
    return Case(
        kind=kind, seed=seed, what=f"{q.shape[1]} joints, {WRONG.get(kind, 'a chain')}{size}",
        right=right, q=readings, target=target, place=y, part=np.zeros(kernels, dtype=int),
        slots=order, unit=unit, zero=zero, twists=twists, point=point,
    )  # fmt: skip
