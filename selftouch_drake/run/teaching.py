"""A lesson with a robot: readings are stored as they come, looked at, and answered by steps.

A folder holds `readings.csv`, all lines that came, `lesson.html`, and in the end a run. A lesson
that was stopped goes on where its readings end.
"""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.lesson import Known, Step, ask, known, next_steps
from selftouch_drake.experience.recording_error import RecordingError
from selftouch_drake.files import locked
from selftouch_drake.run.artifacts import load_body_model
from selftouch_drake.run.directory import RunDirectory, RunError
from selftouch_drake.run.imported import Data, imported_experiment, read_data, store
from selftouch_drake.run.streams import Stream, cell

# Fewer lines are no recording yet.
_ROWS = 20
# There is a look at a stream that waits when it has grown by this factor.
_MORE = 1.1
# Seconds after which a stream without new lines is asked again.
_PAUSE_S = 0.5
# A body is asked for again when there are so many times as many touches, and at most this often.
_GROWN, _AT_LEAST = 1.25, 25
# A lesson whose run has no body goes on to so many times as many touches.
_MORE_TOUCHES = 1.5
# Touches of a target sensation in the run that is learned, and bounds of their number.
_PER_TARGET, _TARGETS = 4, (50, 150)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Look:
    """What a lesson knows at one time.

    Attributes:
        known: what is known.
        steps: what to do next; none at the end.
    """

    known: Known
    steps: list[Step]


@dataclass(frozen=True, slots=True, kw_only=True)
class Lesson:
    """A lesson in a folder.

    Attributes:
        folder: of its files.
        how: how its readings are read, as in `read_data`.
        most: touches after which it ends, whatever is known.
        fewest: touches before which it does not end, whatever is known.
        limits: `(2, J)` of the joints, if somebody knows.
        seed: of the search for a body.
    """

    folder: Path
    how: Mapping[str, Any] = field(default_factory=dict)
    most: int = 1500
    fewest: int = 0
    limits: np.ndarray | None = None
    seed: int = 0

    @property
    def readings(self) -> Path:
        """All lines that came."""
        return self.folder / "readings.csv"

    def stored(self) -> bytes:
        """What came before, without a line that was being written when the program ended."""
        if not self.readings.exists():
            return b""
        text = self.readings.read_bytes()
        whole = text[: text.rfind(b"\n") + 1]
        if len(whole) < len(text):
            with self.readings.open("r+b") as file:
                file.truncate(len(whole))
        return whole

    def keep(self, lines: bytes) -> None:
        """Stores lines for good."""
        with self.readings.open("ab") as file:
            file.write(lines)
            file.flush()
            os.fsync(file.fileno())


def teach(
    lesson: Lesson,
    open_stream: Callable[[bytes], Stream],
    say: Callable[[Look], None],
    *,
    every_s: float | None = None,
    patience_s: float = np.inf,
    sleep: Callable[[float], None] = time.sleep,
) -> Look | None:
    """Stores what comes until enough is known, the stream ends, or nothing comes any more.

    Args:
        lesson: in a folder, which may hold an earlier part of it.
        open_stream: makes the stream, from what was stored before.
        say: called with each look.
        every_s: seconds between looks at readings; None for a stream that waits until it is asked
            again: then there is a look when there is a tenth more.
        patience_s: seconds without a new line after which the lesson ends.
        sleep: waits for seconds.

    Returns:
        The last look; None if no touch was found.

    Raises:
        RunError: another program teaches there.
        ValueError: the readings cannot be used; the text says why. They stay stored.
    """
    lesson.folder.mkdir(parents=True, exist_ok=True)
    busy = RunError(f"{lesson.folder} is used by another lesson; wait, or give another --out")
    with locked(lesson.folder, busy):
        stored = lesson.stored()
        stream = open_stream(stored)
        memory, look, waited, unseen, next_look = _Memory(), None, 0.0, bool(stored), 0.0
        num_bytes, seen_bytes = len(stored), 0
        while True:
            lines = stream.lines(look.steps if look is not None else [])
            if lines:
                lesson.keep(lines)
                unseen, waited, num_bytes = True, 0.0, num_bytes + len(lines)
            began, ends = time.monotonic(), lines is None or waited > patience_s
            grown = num_bytes >= _MORE * seen_bytes if every_s is None else began >= next_look
            if unseen and (ends or grown):
                look, unseen, seen_bytes = memory.look(lesson), False, num_bytes
                # Of a long recording a look takes longer: half of the time is for new readings.
                next_look = began + max(every_s or 0.0, 2 * (time.monotonic() - began))
                if look is not None:
                    say(look)
                    if not look.steps or look.known.num_touches >= lesson.most:
                        return look
            if ends:
                return look
            if not lines:
                sleep(_PAUSE_S)
                waited += _PAUSE_S


class _Memory:
    """The last body model, and from how many touches it was found."""

    def __init__(self) -> None:
        self._model: BodyModel | None = None
        self._asked = 0

    def look(self, lesson: Lesson) -> Look | None:
        """Reads all that is stored; None if there is no touch in it yet."""
        if lesson.readings.read_bytes().count(b"\n") < _ROWS:
            return None
        try:
            data = read_data(lesson.readings, **lesson.how)
        except RecordingError:
            raise
        except ValueError:
            return None  # nothing was touched yet
        q, sensation = data.felt.q[: lesson.most], data.felt.sensation[: lesson.most]
        names, number = data.recording.joints, len(q)
        if number >= max(_GROWN * self._asked, self._asked + _AT_LEAST) or number == lesson.most:
            self._model, self._asked = ask(q, sensation, names, seed=lesson.seed), number
        reach = lesson.limits
        if reach is None:
            every = data.recording.q.astype(float)
            reach = np.stack([every.min(axis=0), every.max(axis=0)])
        found = known(q, sensation, names, data.recording.receptors, reach, self._model)
        steps = next_steps(found)
        if not steps and number < lesson.fewest:
            steps = [Step(text=f"go on: {lesson.fewest} touches make a better run")]
        return Look(known=found, steps=steps)


def teach_and_learn(
    lesson: Lesson,
    open_stream: Callable[[bytes], Stream],
    say: Callable[[Look], None],
    progress: Callable[[float, str], None],
    **timing: Any,
) -> tuple[Look | None, RunDirectory | None]:
    """Teaches, makes a run, and goes on if its body is rejected, as that of too few touches may be.

    Arguments and errors are as in `teach` and `take_home`.

    Returns:
        The last look, if there was a touch; the run, if a body was accepted.
    """
    while True:
        look = teach(lesson, open_stream, say, **timing)
        if look is None or not look.known.accepted:
            return look, None
        run = take_home(lesson, progress)
        # A lesson that has more to say ended because the stream did.
        ends = look.steps or look.known.num_touches >= lesson.most
        if ends or _is_accepted(load_body_model(run)):
            return look, run
        lesson = replace(lesson, fewest=int(_MORE_TOUCHES * look.known.num_touches))


def _is_accepted(model: BodyModel) -> bool:
    """Whether each part is whose touches were explained: of those by hands the other side's are."""
    accepted = model.accepted_by_part
    return bool(accepted.any() and accepted[model.num_touches > 0].all())


def columns_of(joint_names: Sequence[str]) -> dict[str, str]:
    """How readings of joints with these names are read, if no other program wrote them."""
    cells = [cell(name) for name in joint_names]
    span = cells[0] if len(cells) == 1 else f"{cells[0]}..{cells[-1]}"
    return {"q": span, "sensation": "taxel_*", "time": "none"}


def take_home(lesson: Lesson, progress: Callable[[float, str], None]) -> RunDirectory:
    """Makes a run of the readings of a lesson, and learns from it.

    Raises:
        ValueError: it cannot be learned from them.
    """
    from selftouch_drake.run.stages import has_learned, has_modelled, learn

    data: Data = read_data(lesson.readings, **lesson.how)
    number = int(np.clip(len(data.felt.rows) // _PER_TARGET, *_TARGETS))
    overrides = {"name": lesson.folder.name, "representation": {"num_targets": number}}
    experiment = imported_experiment(data, overrides=overrides)
    # Of a lesson that went on, there is another run beside the first one.
    run = RunDirectory.create(lesson.folder / f"run_{len(data.felt.rows)}", experiment)
    with run.writing():
        if not run.free.exists():
            store(run, data)
        if not (has_learned(run) and has_modelled(run)):
            learn(run, progress)
    return run
