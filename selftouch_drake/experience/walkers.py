"""Leads a body along walks, and keeps what it feels."""

from __future__ import annotations

import numpy as np

from selftouch_drake.agent.body import Body, Felt

# Steps in one batch: large enough for numpy, small in memory.
_BATCH = 4096
# s of one batch of a timed walk, and between two configurations that an agent chooses.
_BATCH_S, CHOICE_S = 10.0, 0.02


def walk_range(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """`(J,)` and `(J,)`: where a body babbles, one turn where a joint has no limits."""
    start = np.where(np.isfinite(body.upper), body.upper - 2 * np.pi, -np.pi)
    start = np.where(np.isfinite(body.lower), body.lower, start)
    return start, np.where(np.isfinite(body.upper), body.upper, start + 2 * np.pi)


def strides(body: Body, step_size: float) -> np.ndarray:
    """`(J,)` the step of each joint, in the body's units.

    A body may say in `unit` `(J,)` how far each joint moves where a revolute one turns by a radian;
    if it does not, the range of each joint counts as a turn.

    Args:
        body: the body.
        step_size: rad, of a revolute joint.
    """
    lower, upper = walk_range(body)
    return step_size * np.asarray(getattr(body, "unit", (upper - lower) / (2 * np.pi)))


class Walker:
    """Leads a body along paths.

    A body that cannot jump is led in time, and so is any other whose walk takes time.

    Args:
        body: the body.
        timed: whether it moves in time even if it can jump.
        step_duration: s per step of a walk in time.
    """

    def __init__(self, body: Body, *, timed: bool, step_duration: float):
        self.body = body
        self.timed = timed or not body.jumps
        self._step_duration = step_duration
        #: Number of steps after which a walk looks at what it felt.
        self.batch = max(1, round(_BATCH_S / step_duration)) if self.timed else _BATCH
        self._at: np.ndarray | None = None

    def begin_at(self, q: np.ndarray) -> None:
        """The next path begins at `(J,)` q."""
        self._at = q

    def walk(self, path: np.ndarray) -> Felt:
        """Passes the `(n, J)` steps of a walk."""
        return self._go(path, self._step_duration)

    def choose(self, path: np.ndarray) -> Felt:
        """Passes `(n, J)` configurations that the agent chose."""
        return self._go(path, CHOICE_S)

    def _go(self, path: np.ndarray, duration: float) -> Felt:
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
        # No joint is asked to be faster than it may.
        needs = (np.abs(np.diff(path, axis=0)) / self.body.velocity).max(axis=1)
        steps = duration * np.ceil(needs / duration).clip(1.0)
        followed = self.body.follow(np.append(0.0, steps.cumsum()), path)
        # Where it begins has been felt before.
        return followed.felt().of_rows(np.flatnonzero(followed.time_s > 0.0))
