"""What is left out of the files of a robot, told once and in few lines."""

import functools
import multiprocessing
import re
import warnings
from collections import Counter
from pathlib import Path

from selftouch_drake.robot.facts import Parsed

# Lines about one robot; more of them are counted.
_MOST_LINES = 8
# What Drake says of elements that change no pose, no limit and no motion.
_WITHOUT_EFFECT = re.compile(
    r"camera element|safety_controller|calibration|specular|shadow|torsional and rolling friction"
    r"|zero effort limit"
)


class ModelWarning(UserWarning):
    """Something that a model file says is left out."""


def warn_of_models(parsed: Parsed) -> None:
    """Warns of what Drake logged, and of what this program left out, once per process.

    Processes that another one started say nothing: the first one does.
    """
    if multiprocessing.parent_process() is not None:
        return
    told = Counter(_in_one_line(line) for line in parsed.logged if not _WITHOUT_EFFECT.search(line))
    for _, facts in parsed.models:
        told.update(f"{facts.path.name}: {note}" for note in facts.notes)
        # A robot whose loops are closed comes this far only if its joints are named.
        told.update(f"{facts.path.name}: {loop} is left out" for loop in facts.loops)
    lines = [text if number == 1 else f"{text} ({number} times)" for text, number in told.items()]
    for line in lines[:_MOST_LINES]:
        _warn_once(line)
    if (more := len(lines) - _MOST_LINES) > 0:
        _warn_once(f"and {more} more of the kind in the model")


def _in_one_line(line: str) -> str:
    """A line of Drake's log with the name of the file alone, which a copy of it has too."""
    text = " ".join(line.split())
    if found := re.match(r"(.*?):(\d+): (?:warning|error): (.*)", text):
        place, _, message = found.groups()
        return f"{Path(place).name}: {message}"
    return text


@functools.cache
def _warn_once(text: str) -> None:
    warnings.warn(text, ModelWarning, stacklevel=4)
