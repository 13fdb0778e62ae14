"""Wraps a body that others wrote, believes nothing of it, and counts the time that it needs."""

import ctypes
import queue
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import AbstractContextManager
from typing import Any, TypeVar

import numpy as np

from selftouch_drake.agent.body import Body, BodyError, Felt, Followed
from selftouch_drake.experiment import shown

Result = TypeVar("Result")

#: Fewest receptors from which anything can be learned.
_FEWEST_RECEPTORS = 4

#: Configurations per call of a body that jumps. A body that travels gets one per call, so that a
#: time-out is that of one posture.
_AT_ONCE = 256

#: A simulator may need this many times the duration of a motion before it counts as hanging.
_SLOWEST = 3.0

#: Seconds within which an interrupted call must end, and `rest` and `close` must return.
_GRACE_S = 5.0

#: A joint that is further from where it says that it has gone, as a share of its range, is in
#: another unit.
_ELSEWHERE = 0.5


class UnrestWarning(UserWarning):
    """A body could not be brought to rest."""


class Worker:
    """Makes calls in a thread of its own, so that one that hangs can be given up."""

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self._calls: queue.SimpleQueue[tuple[Callable[[], Any], Future]] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, args=(self._calls,), daemon=True)
        self._thread.start()

    @staticmethod
    def _work(calls: queue.SimpleQueue) -> None:
        while True:
            call, future = calls.get()
            try:
                future.set_result(call())
            except BaseException as error:
                future.set_exception(error)

    def call(self, call: Callable[[], Result], what: str, timeout_s: float) -> Result:
        """Returns what `call` returns; `what` names it in errors.

        On Ctrl-C, and after the time-out, the call gets a KeyboardInterrupt too.

        Raises:
            BodyError: it raised an error, or did not return in time.
        """
        future: Future[Result] = Future()
        self._calls.put((call, future))
        try:
            return future.result(timeout_s)
        except BaseException as error:
            if not future.done():
                self._interrupt(future)
            elif isinstance(error, BodyError) or not isinstance(error, (Exception, SystemExit)):
                raise
            elif future.exception() is error:
                raise BodyError(f"{what} raised {_said(error)}") from error
            if not isinstance(error, TimeoutError):
                raise
        raise BodyError(
            f"{what} did not return in {timeout_s:.3g} s; check the connection, or raise timeout_s"
        ) from None

    def _interrupt(self, future: Future) -> None:
        """Ends the call if it is Python's; the next calls are made in another thread."""
        ctypes.pythonapi.PyThreadState_SetAsyncExc(
            ctypes.c_ulong(self._thread.ident or 0), ctypes.py_object(KeyboardInterrupt)
        )
        waited_until = time.monotonic() + _GRACE_S
        while not future.done() and time.monotonic() < waited_until:
            time.sleep(0.01)
        self._begin()


class CheckedBody(AbstractContextManager):
    """A `Body` whose answers are what they should be, or a `BodyError` says what is wrong.

    All its calls are made in one thread, which is not the caller's. If the body has a method
    `rest`, or `close`, they are called at the end.

    Args:
        body: of a user.
        name: of the body in errors; by default the name of its class.
        timeout_s: s after which the feeling of a posture counts as hanging; a motion may take three
            times its duration longer.
        worker: in whose thread the body was made; by default, a new one.

    Attributes:
        robot_s: s of the body's own time so far, or of the clock if it keeps none; 0 for a body
            that jumps.

    Raises:
        BodyError: a method or an array is missing, or has the wrong shape or values.
    """

    def __init__(
        self,
        body: Body,
        *,
        name: str | None = None,
        timeout_s: float = 60.0,
        worker: Worker | None = None,
    ):
        self.name, self._timeout_s = name or type(body).__name__, timeout_s
        self._body, self._worker = body, worker or Worker()
        for method in ("feel", "follow"):
            if not callable(getattr(body, method, None)):
                raise BodyError(
                    f"{self.name} has no method {method}; write one, as "
                    "selftouch_drake.agent.body.Body describes it"
                )
        self.joint_names: Sequence[str] = self._names()
        self.lower, self.upper = self._limits("lower"), self._limits("upper")
        self.velocity, self.acceleration = self._limits("velocity"), self._limits("acceleration")
        for joint, name in enumerate(self.joint_names):
            self._check_joint(joint, name)
        self.num_receptors = self._number_of_receptors()
        self.jumps = self._attribute("jumps")
        if not isinstance(self.jumps, (bool, np.bool_)):
            raise self._wrong(
                f"jumps is {shown(self.jumps)}; give True if any posture may be asked for next, or "
                "False if it must be travelled to"
            )
        self.robot_s = 0.0

    def feel(self, q: np.ndarray) -> Felt:
        """As in `Body`; what is beyond the limits is felt at the limit, and not reached.

        Raises:
            BodyError: the body raised an error, did not return in time, or returned what it must
                not.
        """
        q = np.asarray(q, dtype=float).reshape(-1, len(self.joint_names))
        asked = q.clip(self.lower, self.upper)
        beyond = (np.abs(asked - q) > 1e-6 * (self.upper - self.lower)).any(axis=1)
        size = _AT_ONCE if self.jumps else 1
        parts = [self._feel(asked[first : first + size]) for first in range(0, len(q), size)]
        nothing = np.empty((0, self.num_receptors))
        return Felt(
            q=np.concatenate([np.empty_like(q[:0]), *(part.q for part in parts)]),
            sensation=np.concatenate([nothing, *(part.sensation for part in parts)]),
            reached=np.concatenate([~beyond[:0], *(part.reached for part in parts)]) & ~beyond,
        )

    def follow(self, time_s: np.ndarray, q: np.ndarray) -> Followed:
        """As in `Body`; the times of what was measured need not be those that were asked for.

        Raises:
            BodyError: as in `feel`.
        """
        time_s, q = np.asarray(time_s, dtype=float), np.asarray(q, dtype=float)
        asked = q.clip(self.lower, self.upper)
        limit = self._timeout_s + _SLOWEST * float(np.ptp(time_s))
        found = self._call("follow", limit, time_s.copy(), asked)
        times = self._array("follow", found, "time_s", (-1,))
        if not len(times) or (np.diff(times) < 0).any():
            raise self._wrong(
                f"follow returned time_s {shown(times.tolist())}; give seconds from the start of "
                "the motion, ascending"
            )
        return Followed(
            time_s=times,
            q=self._array("follow", found, "q", (len(times), len(self.joint_names))),
            sensation=self._array("follow", found, "sensation", (len(times), self.num_receptors)),
        )

    def close(self) -> None:
        """Leaves the body at rest, and lets go of it.

        Warns:
            UnrestWarning: it could not be brought to rest.
        """
        for method in ("rest", "close"):
            if callable(call := getattr(self._body, method, None)):
                try:
                    self._worker.call(call, f"{self.name}.{method}", _GRACE_S)
                except BodyError as error:
                    warnings.warn(f"{error}; look after it", UnrestWarning, stacklevel=2)

    def __exit__(self, *_: object) -> None:
        self.close()

    def _feel(self, asked: np.ndarray) -> Felt:
        found = self._call("feel", self._timeout_s, asked.copy())
        felt = Felt(
            q=self._array("feel", found, "q", asked.shape),
            sensation=self._array("feel", found, "sensation", (len(asked), self.num_receptors)),
            reached=self._array("feel", found, "reached", (len(asked),)).astype(bool),
        )
        away = np.abs(felt.q - asked) * felt.reached[:, None]
        for row, joint in np.argwhere(away > _ELSEWHERE * (self.upper - self.lower)).tolist():
            raise self._wrong(
                f"feel says that {self.joint_names[joint]} reached {asked[row, joint]:.4g}, and "
                f"that it is at {felt.q[row, joint]:.4g}; give q in the unit of lower and upper, "
                "or reached False"
            )
        return felt

    def _call(self, method: str, timeout_s: float, *arguments: np.ndarray) -> Any:
        began, own = time.monotonic(), getattr(self._body, "robot_s", None)
        call = getattr(self._body, method)
        found = self._worker.call(lambda: call(*arguments), f"{self.name}.{method}", timeout_s)
        if not self.jumps:
            lived = time.monotonic() - began if own is None else self._body.robot_s - own  # type: ignore[attr-defined]
            self.robot_s += float(lived)
        return found

    def _attribute(self, name: str) -> Any:
        """An attribute of the body, which may be a property that asks a device."""
        missing = object()
        call = lambda: getattr(self._body, name, missing)  # noqa: E731
        found = self._worker.call(call, f"{self.name}.{name}", self._timeout_s)
        if found is missing:
            raise self._wrong(
                f"{name} is missing; set it, as selftouch_drake.agent.body.Body describes it"
            )
        return found

    def _names(self) -> tuple[str, ...]:
        """The names of the joints."""
        names = self._attribute("joint_names")
        listed = () if isinstance(names, str) or not isinstance(names, Sequence) else tuple(names)
        are_texts = all(isinstance(name, str) for name in listed)
        if not listed or not are_texts or len(set(listed)) < len(listed):
            raise self._wrong(f"joint_names is {shown(names)}; give a list of different names")
        return listed

    def _number_of_receptors(self) -> int:
        number = self._attribute("num_receptors")
        if not isinstance(number, (int, np.integer)) or number < _FEWEST_RECEPTORS:
            raise self._wrong(
                f"num_receptors is {shown(number)}; give a whole number, at least "
                f"{_FEWEST_RECEPTORS}"
            )
        return int(number)

    def _check_joint(self, joint: int, name: str) -> None:
        """Raises a `BodyError` if the limits of a joint leave it no motion."""
        low, high = self.lower[joint], self.upper[joint]
        if not low < high:
            raise self._wrong(
                f"lower of {name} is {low:g}, and upper {high:g}; give the smaller one as lower"
            )
        for limit in ("velocity", "acceleration"):
            if not (most := getattr(self, limit)[joint]) > 0:
                raise self._wrong(f"{limit} of {name} is {most:g}; give a number above 0")

    def _limits(self, name: str) -> np.ndarray:
        """`(J,)` limits of the joints, read-only."""
        value, num_joints = self._attribute(name), len(self.joint_names)
        limits = _numbers(value)
        if limits is None or limits.shape != (num_joints,):
            raise self._wrong(
                f"{name} is {shown(value)}; give one number for each of {num_joints} joints"
            )
        for joint, limit in zip(self.joint_names, limits, strict=True):
            if not np.isfinite(limit):
                raise self._wrong(f"{name} of {joint} is {limit}; give a finite number")
        limits.flags.writeable = False
        return limits

    def _array(self, method: str, found: Any, name: str, shape: tuple[int, ...]) -> np.ndarray:
        """An array of what a method returned; -1 stands for any length."""
        if not hasattr(found, name):
            kind = "Felt" if method == "feel" else "Followed"
            raise self._wrong(
                f"{method} returned {shown(found)}, without {name}; return a "
                f"selftouch_drake.agent.body.{kind}"
            )
        numbers, wanted = _numbers(getattr(found, name)), _shape_text(shape)
        if numbers is None:
            raise self._wrong(
                f"{method} returned {name} {shown(getattr(found, name))}; return numbers of shape "
                f"{wanted}"
            )
        fits = len(shape) == numbers.ndim and all(
            length in (-1, given) for length, given in zip(shape, numbers.shape, strict=True)
        )
        if not fits:
            raise self._wrong(
                f"{method} returned {name} of shape {numbers.shape}; return {wanted}, each time"
            )
        if not np.isfinite(numbers).all():
            where = tuple(np.argwhere(~np.isfinite(numbers))[0].tolist())
            raise self._wrong(
                f"{method} returned {name} with {numbers[where]} at {list(where)}; return the last "
                "good reading, or reached False"
            )
        return numbers

    def _wrong(self, text: str) -> BodyError:
        return BodyError(f"{self.name}: {text}")


def _numbers(value: Any) -> np.ndarray | None:
    """Real numbers as floats; None if it is anything else."""
    try:
        array = np.asarray(value)
    except (ValueError, TypeError):
        return None
    return array.astype(float) if array.dtype.kind in "fiub" else None


def _shape_text(shape: tuple[int, ...]) -> str:
    """A shape as Python writes it, with T for any length."""
    lengths = ", ".join("T" if length < 0 else str(length) for length in shape)
    return f"({lengths},)" if len(shape) == 1 else f"({lengths})"


def _said(error: BaseException) -> str:
    """An error in one line, with the place in the user's own file."""
    last = traceback.extract_tb(error.__traceback__)[-1:]
    place = "".join(f" (line {frame.lineno} of {frame.filename})" for frame in last)
    return f"{type(error).__name__}: {' '.join(str(error).split())}{place}"
