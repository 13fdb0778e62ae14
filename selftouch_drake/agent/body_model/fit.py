"""Touches as a fit sees them, hypotheses of a body, and their descent from many starts at once."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from selftouch_drake.agent.body_model.population import TILE, Draws, Ways, descend

#: A way: joints with signs, from the link of the part to that of the toucher.
Way = tuple[tuple[int, int], ...]
#: Maps a function over items in order, as the builtin does; in threads, for instance.
Each = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
#: Degrees of freedom of the Student distribution of a descent: fewer see a body through more wrong
#: labels, more tell bodies apart better. Measured on a cube with 10 and 30 % wrong labels.
TAIL = 3.0
# Members that one call works on: the same bytes whatever the number of threads.
_BLOCK = 8


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Touches of one toucher on one part, kernel by kernel.

    Attributes:
        rows: `(N,)` indices of touches, sorted by kernel.
        offsets: `(K + 1,)` where the kernels begin in `rows`.
        kernel: `(K,)` their target sensations.
    """

    rows: np.ndarray
    offsets: np.ndarray
    kernel: np.ndarray

    @staticmethod
    def of(rows: np.ndarray, target: np.ndarray, least: int = 4) -> "Group":
        """Groups touches.

        Args:
            rows: `(N,)` indices of touches.
            target: `(N,)` their target sensations.
            least: kernels with fewer touches are left out.
        """
        order = np.argsort(target, kind="stable")
        kernel, start, count = np.unique(target[order], return_index=True, return_counts=True)
        kept = count >= least
        pieces = [rows[order[a : a + n]] for a, n in zip(start[kept], count[kept], strict=True)]
        offsets = np.concatenate([[0], np.cumsum(count[kept])]).astype(int)
        joined = np.concatenate(pieces) if pieces else np.zeros(0, dtype=int)
        return Group(joined, offsets, kernel[kept])

    @property
    def num_kernels(self) -> int:
        """Kernels with enough touches."""
        return len(self.kernel)

    def labels(self) -> np.ndarray:
        """`(N,)` number of the kernel of each row, 0 to K - 1."""
        return np.repeat(np.arange(self.num_kernels), np.diff(self.offsets))


@dataclass(frozen=True, slots=True, eq=False)
class Smooth:
    """Touches whose places are a smooth function of their sensations: for few touches.

    Attributes:
        rows: `(N,)` indices of touches.
        precision: `(N, N)` of their places, with the mean taken out.
        alike: `(J,)` how far the readings turn joints, if all turn alike but for one factor, and
            none slides along its axis; NaN for joints that turn as far as they may. None: each
            twist is free.
    """

    rows: np.ndarray
    precision: np.ndarray
    alike: np.ndarray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Bodies:
    """Hypotheses: B bodies, G groups, U touchers, J joints.

    Attributes:
        ways: `[B][G]` ways.
        twists: `(B, J, 6)` for standardised readings.
        points: `(B, U, 3)` of the touchers.
        loss: `(B, G)` criterion; lower is better.
    """

    ways: list[list[Way]]
    twists: np.ndarray
    points: np.ndarray
    loss: np.ndarray

    def __len__(self) -> int:
        return len(self.ways)

    def pick(self, chosen: Sequence[int] | np.ndarray) -> "Bodies":
        """Some of the bodies, copied."""
        return Bodies(
            [list(self.ways[i]) for i in chosen],
            self.twists[chosen].copy(),
            self.points[chosen].copy(),
            self.loss[chosen].copy(),
        )

    def best(self, number: int = 1) -> "Bodies":
        """The bodies with the lowest sum of criteria, best first."""
        return self.pick(np.argsort(self.loss.sum(axis=1), kind="stable")[:number])

    @staticmethod
    def joined(several: Sequence["Bodies"]) -> "Bodies":
        """All bodies of several."""
        return Bodies(
            [ways for bodies in several for ways in bodies.ways],
            np.concatenate([bodies.twists for bodies in several]),
            np.concatenate([bodies.points for bodies in several]),
            np.concatenate([bodies.loss for bodies in several]),
        )


def random_twists(random: np.random.Generator, *shape: int) -> np.ndarray:
    """Turns about random axes through random points, one unit of angle per standard deviation."""
    axis = random.standard_normal((*shape, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    through = random.standard_normal((*shape, 3))
    return np.concatenate([axis, np.cross(through, axis)], axis=-1)


def random_bodies(
    ways: list[list[Way]], num_joints: int, num_touchers: int, random: np.random.Generator
) -> Bodies:
    """Bodies with the given ways, and twists and points at random."""
    return Bodies(
        ways,
        random_twists(random, len(ways), num_joints),
        random.standard_normal((len(ways), num_touchers, 3)),
        np.full((len(ways), len(ways[0])), np.inf),
    )


def chain_way(order: Iterable[int]) -> Way:
    """The way along a chain of joints, all passed forwards."""
    return tuple((int(joint), 1) for joint in order)


@dataclass(frozen=True, slots=True, kw_only=True)
class Descent:
    """How to descend.

    Attributes:
        steps: of Adam.
        rate: of the first step.
        kernels: drawn from each group at each step.
        members: drawn from each kernel.
        tail: degrees of freedom of the Student distribution; 0: Gaussian.
    """

    steps: int = 300
    rate: float = 0.03
    kernels: int = 40
    members: int = 10
    tail: float = TAIL


def draw(
    q: np.ndarray,
    groups: Sequence[Group],
    how: Descent,
    random: np.random.Generator,
    weight: np.ndarray | None = None,
) -> Draws:
    """Draws kernels and members for each step; a kernel with few members gives some twice.

    Args:
        q: `(J, R)` float32 standardised readings.
        groups: G groups of touches.
        how: numbers of steps, kernels and members.
        random: source of randomness.
        weight: `(G,)` of each group; 1 by default.
    """
    most = min(how.kernels, max(group.num_kernels for group in groups))
    padded = -(-most * how.members // TILE) * TILE
    rows = np.zeros((how.steps, len(groups), padded), dtype=np.int32)
    number = np.array([min(most, group.num_kernels) for group in groups])
    for index, group in enumerate(groups):
        chance = random.random((how.steps, group.num_kernels))
        picked = np.argsort(chance, axis=1)[:, : number[index], None]
        count, start = np.diff(group.offsets)[picked], group.offsets[:-1][picked]
        # Members of a kernel in an order of their own, cut at a random place.
        shuffled = group.rows[np.lexsort((random.random(len(group.rows)), group.labels()))]
        first = (random.random(count.shape) * count).astype(int)
        chosen = shuffled[start + (first + np.arange(how.members)) % count]
        flat = chosen.reshape(how.steps, -1)
        rows[:, index, : flat.shape[1]] = flat
    weights = np.ones(len(groups)) if weight is None else np.array(weight, dtype=float)
    return Draws(q, rows, number, np.int64(how.members), weights, np.zeros(0))


def draw_all(q: np.ndarray, groups: Sequence[Smooth], how: Descent) -> Draws:
    """All of few touches at each step.

    Args:
        q: `(J, R)` float32 standardised readings.
        groups: of touches; the first says which joints turn alike.
        how: numbers of steps.
    """
    number = np.array([len(group.rows) for group in groups])
    rows = np.zeros((how.steps, len(groups), -(-number.max() // TILE) * TILE), dtype=np.int32)
    for index, group in enumerate(groups):
        rows[:, index, : len(group.rows)] = group.rows
    precision = np.concatenate([group.precision.ravel() for group in groups])
    alike = np.zeros(0) if groups[0].alike is None else np.nan_to_num(groups[0].alike, nan=0.0)
    return Draws(q, rows, number, np.int64(1), np.ones(len(groups)), precision, alike=alike)


def descended(
    q: np.ndarray,
    groups: Sequence[Group | Smooth],
    bodies: Bodies,
    how: Descent,
    seed: int,
    *,
    touchers: Sequence[int] | None = None,
    weight: np.ndarray | None = None,
    fixed: Sequence[int] = (),
    each: Each = map,
) -> Bodies:
    """Bodies after a descent, with the criterion that each reached.

    Args:
        q: `(J, R)` float32 standardised readings.
        groups: G groups of touches, all of kernels or all of few touches.
        bodies: where to start; left as they are.
        how: steps and sizes.
        seed: of the draws.
        touchers: `(G,)` toucher of each group; the first by default.
        weight: `(G,)` of each group; 1 by default.
        fixed: joints whose twists stay as they are; with any, points do too.
        each: maps blocks of bodies; the result does not depend on it.
    """
    kernels = [group for group in groups if isinstance(group, Group)]
    smooth = [group for group in groups if isinstance(group, Smooth)]
    if smooth:
        draws = draw_all(q, smooth, how)
    else:
        draws = draw(q, kernels, how, np.random.default_rng(seed), weight)
    draws = draws._replace(fixed=np.array(fixed, dtype=np.int64))
    toucher = np.zeros(len(groups)) if touchers is None else np.array(touchers)
    toucher = toucher.astype(np.int64)

    work = partial(_descended, draws, toucher, how)
    starts = range(0, len(bodies), _BLOCK)
    blocks = [bodies.pick(np.arange(k, min(k + _BLOCK, len(bodies)))) for k in starts]
    return Bodies.joined(list(each(work, blocks)))


def _descended(draws: Draws, toucher: np.ndarray, how: Descent, bodies: Bodies) -> Bodies:
    """A block of bodies after a descent; it may have come from another process.

    What comes from there cannot be written, and to the compiler that is another type of array.
    """
    if not draws.q.flags.writeable:
        arrays = {name: each for name, each in draws._asdict().items() if each.ndim}
        draws = draws._replace(**{name: each.copy(order="K") for name, each in arrays.items()})
    bodies = bodies.pick(np.arange(len(bodies)))
    ways = packed(bodies.ways, toucher.copy())
    loss = descend(draws, ways, bodies.twists, bodies.points, how.rate, how.tail)
    return replace(bodies, loss=np.where(np.isfinite(loss), loss, np.inf))


def packed(ways: list[list[Way]], toucher: np.ndarray) -> Ways:
    """Ways as arrays."""
    longest = max(len(way) for of_body in ways for way in of_body)
    shape = (len(ways), len(ways[0]), longest)
    joint, sign = np.zeros(shape, dtype=np.int64), np.ones(shape, dtype=np.float32)
    length = np.zeros(shape[:2], dtype=np.int64)
    for b, of_body in enumerate(ways):
        for g, way in enumerate(of_body):
            length[b, g] = len(way)
            for k, (j, s) in enumerate(way):
                joint[b, g, k], sign[b, g, k] = j, s
    return Ways(joint, sign, length, toucher)
