"""Random walks in motor space, and who leads a body along them."""

import threading
from bisect import bisect_right
from typing import Protocol

import numpy as np

from selftouch_drake.agent.body import Body, Felt
from selftouch_drake.compiled import compiled

# Nodes by which the pieces of a walk grow, at least; then they double.
_GROWS = 256
# Steps in one batch: large enough for numpy, small in memory.
_BATCH = 4096
#: s of one batch of a timed walk.
BATCH_S = 10.0
# s between two configurations that an agent chooses.
CHOICE_S = 0.02


class RandomWalk:
    """A smooth random walk between joint limits.

    The velocity is a first-order autoregressive process, so successive configurations are close
    and the walk still reaches the whole range. It reflects at the limits: an unbounded walk is
    folded into the range of each joint, which is equivalent because its noise is symmetric.

    Args:
        lower: `(J,)` rad or m, lower limit of each joint.
        upper: `(J,)` rad or m, upper limit of each joint.
        step_size: rad or m per step, standard deviation of the joints' velocity; one for all or
            `(J,)`.
        persistence: share of the velocity that is kept from step to step, 0 to below 1.
        seed: of the walk; the start is uniform between the limits.
    """

    def __init__(
        self,
        *,
        lower: np.ndarray,
        upper: np.ndarray,
        step_size: float | np.ndarray,
        persistence: float,
        seed: np.random.SeedSequence,
    ):
        self._lower = np.asarray(lower, dtype=float)
        self._range = np.asarray(upper, dtype=float) - self._lower
        self._persistence = persistence
        self._innovation = step_size * np.sqrt(1 - persistence**2)
        self._random = np.random.default_rng(seed)
        self._unfolded = self._range * self._random.uniform(size=len(self._lower))
        self._velocity = step_size * self._random.standard_normal(len(self._lower))

    def steps(self, num_steps: int) -> np.ndarray:
        """`(num_steps, J)` the next configurations; the walk does not depend on the chunk size."""
        q = self._random.standard_normal((num_steps, len(self._lower)))
        q *= self._innovation
        _walk(q, self._persistence, self._velocity, self._unfolded, self._lower, self._range)
        return q


@compiled
def _walk(q, persistence, velocity, unfolded, lower, width):
    """Replaces each row of noise by the configuration that the walk then reaches."""
    for n in range(len(q)):
        for j in range(len(velocity)):
            velocity[j] = q[n, j] + persistence * velocity[j]
            unfolded[j] += velocity[j]
            folded = unfolded[j] % (2 * width[j])
            q[n, j] = lower[j] + min(folded, 2 * width[j] - folded)


class StraightPieces:
    """The straight pieces between the nodes of a walk, over time.

    They grow as far as they are asked for, and depend on nothing but the arguments.

    Args:
        walk: at its beginning; nobody else may take steps of it.
        duration: s, of a piece.
        velocity: `(J,)` rad/s or m/s: a piece lasts so many durations that no joint is faster.
    """

    def __init__(self, walk: RandomWalk, *, duration: float, velocity: np.ndarray | None = None):
        self._walk, self._duration, self._velocity = walk, duration, velocity
        self._lock = threading.Lock()
        # `(N,)` s and `(N, J)` of the nodes.
        self._nodes: tuple[list[float], np.ndarray] = [0.0], walk.steps(1)
        # `(2J,)` state at the beginning of each piece, and its rate: lists, in which a controller
        # finds a row in a fifth of the time of an array's.
        self._begin = list[np.ndarray]()
        self._rate = list[np.ndarray]()

    def nodes(self, num_nodes: int) -> np.ndarray:
        """`(num_nodes, J)` rad or m, the first nodes."""
        while len(self._nodes[0]) < num_nodes:
            self._grow(len(self._nodes[0]))
        return self._nodes[1][:num_nodes]

    def at(self, time_s: float) -> np.ndarray:
        """`(2J,)` where the walk is at a time from 0 on, and its rate."""
        times = self._nodes[0]
        while times[-1] <= time_s:
            self._grow(len(times))
            times = self._nodes[0]
        piece = bisect_right(times, time_s) - 1
        state = self._rate[piece] * (time_s - times[piece])
        state += self._begin[piece]
        return state

    def _grow(self, num_known: int) -> None:
        with self._lock:
            times, nodes = self._nodes
            if len(times) > num_known:
                return  # another thread was first
            nodes = np.concatenate([nodes, self._walk.steps(max(_GROWS, len(nodes)))])
            lasting = durations(nodes, self._duration, self._velocity)
            if self._velocity is None:
                ends = self._duration * np.arange(len(nodes))  # which does not drift
            else:
                ends = np.append(0.0, lasting.cumsum())
            rates = np.diff(nodes, axis=0) / np.diff(ends)[:, None]
            self._begin = list(np.hstack([nodes[:-1], rates]))
            self._rate = list(np.hstack([rates, np.zeros_like(rates)]))
            # Last: who finds a node finds its piece.
            self._nodes = ends.tolist(), nodes


def durations(path: np.ndarray, duration: float, velocity: np.ndarray | None) -> np.ndarray:
    """`(n - 1,)` s of the pieces of a path `(n, J)`: whole durations, so that no joint is faster.

    Without `(J,)` velocities, one duration each.
    """
    if velocity is None:
        return np.full(len(path) - 1, duration)
    needs = (np.abs(np.diff(path, axis=0)) / velocity).max(axis=1)
    return duration * np.ceil(needs / duration).clip(1.0)


class Joints(Protocol):
    """Joints that babble: a body has them, and a robot.

    Attributes:
        lower: `(J,)` lower limits, in the body's own units; infinite where a joint has none.
        upper: `(J,)` upper limits.
    """

    @property
    def lower(self) -> np.ndarray:
        """As above."""
        ...

    @property
    def upper(self) -> np.ndarray:
        """As above."""
        ...


def walk_range(body: Joints) -> tuple[np.ndarray, np.ndarray]:
    """`(J,)` and `(J,)`: where a body babbles, one turn where a joint has no limits."""
    start = np.where(np.isfinite(body.upper), body.upper - 2 * np.pi, -np.pi)
    start = np.where(np.isfinite(body.lower), body.lower, start)
    return start, np.where(np.isfinite(body.upper), body.upper, start + 2 * np.pi)


def strides(body: Joints, step_size: float) -> np.ndarray:
    """`(J,)` the step of each joint, in the body's units, if a revolute one steps `step_size` rad.

    A body may say in `unit` `(J,)` how far each joint moves where a revolute one turns by a radian;
    if it does not, the range of each joint counts as a turn.
    """
    lower, upper = walk_range(body)
    return step_size * np.asarray(getattr(body, "unit", (upper - lower) / (2 * np.pi)))


class Walker:
    """Leads a body along paths: in time, s per step, if it cannot jump or is to be `timed`."""

    def __init__(self, body: Body, *, timed: bool, step_duration: float):
        self.body = body
        self.timed = timed or not body.jumps
        self._step_duration = step_duration
        #: Number of steps after which a walk looks at what it felt.
        self.batch = max(1, round(BATCH_S / step_duration)) if self.timed else _BATCH
        self._at: np.ndarray | None = None

    def begin_at(self, q: np.ndarray) -> None:
        """The next path begins at `(J,)` q."""
        self._at = q

    def walk(self, path: np.ndarray, duration: float | None = None) -> Felt:
        """Passes `(n, J)` configurations, each in a duration in s, by default that of a step."""
        duration = duration or self._step_duration
        if not self.timed:
            # What is felt is that of the stored, that is the rounded, configurations.
            return self.body.feel(path.astype(np.float32))
        if self._at is not None:
            path = np.concatenate([self._at[None], path])
        self._at = path[-1]
        if len(path) < 2:
            return self.body.feel(path)
        if self.body.jumps:
            return self.body.follow(duration * np.arange(len(path)), path).felt()
        steps = durations(path, duration, self.body.velocity)
        followed = self.body.follow(np.append(0.0, steps.cumsum()), path)
        # Where it begins has been felt before.
        return followed.felt().of_rows(np.flatnonzero(followed.time_s > 0.0))
