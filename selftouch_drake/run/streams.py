"""Where the readings of a lesson come from: a CSV that grows, a body that moves, a callback.

Each stream gives whole lines of CSV, with the header first, and is asked again and again.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from selftouch_drake.agent.body import Body, Felt
from selftouch_drake.agent.lesson import Step

# Postures of a walk that a body is asked for at once, the share of a joint's range that a step
# takes, and how much of the last step goes on in the next one.
_BATCH, _STRIDE, _PERSISTENCE = 100, 0.024, 0.9
# A walk begins at a touch so often, else anywhere; one that a body must travel goes on.
_FROM_TOUCH = 0.5


class StreamError(ValueError):
    """A stream cannot be used; the text says what to do."""


class Stream(Protocol):
    """Gives readings."""

    def lines(self, steps: Sequence[Step]) -> bytes | None:
        """Whole lines of CSV that are new; empty if none are yet, None if no more will come.

        Args:
            steps: what to do next, for who can.
        """
        ...


class GrowingFile:
    """A CSV that another program writes; it may stop, lag, or begin again.

    Args:
        path: of the file; it may not be there yet.
        stored: what was read of it before. If the file does not begin with that, it was begun
            anew, and all of it is new.
    """

    def __init__(self, path: Path, stored: bytes = b""):
        self._path, self._at = path, 0
        self._header = stored.split(b"\n", 1)[0]
        if stored and path.exists():
            with path.open("rb") as file:
                if file.read(len(stored)) == stored:
                    self._at = len(stored)

    def lines(self, steps: Sequence[Step] = ()) -> bytes:
        """As of `Stream`.

        Raises:
            StreamError: the file was begun anew with another header.
        """
        if not self._path.exists():
            return b""
        if self._path.stat().st_size < self._at:
            self._at = 0
        with self._path.open("rb") as file:
            file.seek(self._at)
            new = file.read()
        # A line that is being written is left for the next time.
        new = new[: new.rfind(b"\n") + 1]
        if not new:
            return b""
        if self._at == 0 and self._header:
            header, _, rest = new.partition(b"\n")
            if header.rstrip() != self._header.rstrip():
                raise StreamError(
                    f"{self._path} begins again with other columns; give another --out"
                )
            self._at = len(new)
            return rest
        if not self._header:
            self._header = new.split(b"\n", 1)[0]
        self._at += len(new)
        return new


class Callback:
    """A function that gives `(q, readings)` rows; None when there are no more.

    Args:
        read: called with the steps to do next; returns `(n, J)` joints and `(n, S)` raw readings,
            of n new rows, 0 or more.
        joint_names: J.
        has_header: whether the header was stored before.
    """

    def __init__(
        self,
        read: Callable[[Sequence[Step]], tuple[np.ndarray, np.ndarray] | None],
        joint_names: Sequence[str],
        has_header: bool = False,
    ):
        self._read, self._names, self._has_header = read, list(joint_names), has_header

    def lines(self, steps: Sequence[Step] = ()) -> bytes | None:
        """As of `Stream`.

        Raises:
            StreamError: shapes are wrong, or a number is not finite.
        """
        rows = self._read(steps)
        if rows is None:
            return None
        q, readings = (np.asarray(part, dtype=float) for part in rows)
        shapes = q.ndim == readings.ndim == 2 and len(q) == len(readings)
        if not shapes or q.shape[1] != len(self._names):
            raise StreamError(
                f"the callback returned q of shape {q.shape} and readings of shape "
                f"{readings.shape}; return (n, {len(self._names)}) and (n, receptors)"
            )
        finite = np.isfinite(q).all(axis=1) & np.isfinite(readings).all(axis=1)
        text = ""
        if not self._has_header:
            text = ",".join([*map(cell, self._names), *taxel_names(readings.shape[1])]) + "\n"
            self._has_header = True
        table = np.concatenate([q, readings], axis=1)[finite]
        text += "".join(",".join(f"{v:.7g}" for v in row) + "\n" for row in table)
        return text.encode()


class MovingBody:
    """A body that walks at random, near what it touched, and further with joints little seen.

    Args:
        body: that moves itself.
        seed: of its walk.
        has_header: whether the header was stored before.
    """

    def __init__(self, body: Body, seed: int = 0, has_header: bool = False):
        self._body, self._random = body, np.random.default_rng(seed)
        self._at = (np.asarray(body.lower) + np.asarray(body.upper)) / 2
        self._touches: list[np.ndarray] = []
        self._rows = Callback(self._walk, body.joint_names, has_header)

    def lines(self, steps: Sequence[Step] = ()) -> bytes | None:
        """As of `Stream`."""
        return self._rows.lines(steps)

    def _walk(self, steps: Sequence[Step]) -> tuple[np.ndarray, np.ndarray]:
        felt = self._body.feel(self._postures([joint for step in steps for joint in step.joints]))
        there = np.flatnonzero(felt.reached)
        if len(there):
            self._at = felt.q[there[-1]]
        self._remember(felt.of_rows(there))
        return felt.q[there], felt.sensation[there]

    def _postures(self, joints: Sequence[int]) -> np.ndarray:
        lower, upper = np.asarray(self._body.lower), np.asarray(self._body.upper)
        span = upper - lower
        if self._body.jumps:
            near = self._touches and self._random.random() < _FROM_TOUCH
            self._at = (
                self._touches[self._random.integers(len(self._touches))]
                if near
                else self._random.uniform(lower, upper)
            )
        stride = _STRIDE * span
        stride[list(joints)] *= 2.0
        velocity, q, found = np.zeros(len(span)), self._at, []
        for _ in range(_BATCH):
            noise = stride * self._random.normal(size=len(span))
            velocity = _PERSISTENCE * velocity + noise * np.sqrt(1 - _PERSISTENCE**2)
            q = q + velocity
            # Reflected at the limits.
            out = (q < lower) | (q > upper)
            velocity = np.where(out, -velocity, velocity)
            q = np.clip(q, lower, upper)
            found.append(q)
        return np.array(found)

    def _remember(self, felt: Felt) -> None:
        # Raw readings have a resting level; what stands far above it was a touch.
        rest = np.median(felt.sensation, axis=0) if len(felt.q) else 0.0
        strength = (felt.sensation - rest).max(axis=1, initial=0.0)
        if len(strength) and strength.max() > 0:
            self._touches.append(felt.q[int(strength.argmax())])


def taxel_names(number: int) -> list[str]:
    """Names of the columns of readings that have no names of their own."""
    return [f"taxel_{n}" for n in range(number)]


def cell(name: str) -> str:
    """A name without what would end its cell."""
    return "".join("_" if sign in ',"\n;' else sign for sign in name)
