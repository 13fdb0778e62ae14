"""What is left out of the files of a robot, told once and in few lines."""

import functools
import multiprocessing
import re
import warnings
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

from selftouch_drake.robot.facts import ModelFacts

# Lines about one robot; more of them are counted.
_MOST_LINES = 8
# What Drake says of elements that change no pose, no limit and no motion.
_WITHOUT_EFFECT = re.compile(
    r"camera element|safety_controller|calibration|specular|shadow|torsional and rolling friction"
    r"|zero effort limit"
)


class ModelWarning(UserWarning):
    """Something that a model file says is left out."""


def warn_of_model(logged: Iterable[str], facts: Mapping[str, ModelFacts]) -> None:
    """Warns of what Drake logged, and of what this program left out, once per process.

    Processes that another one started say nothing: the first one does.
    """
    if multiprocessing.parent_process() is not None:
        return
    told = Counter[str]()
    for line in logged:
        if not _WITHOUT_EFFECT.search(line):
            told[_in_one_line(line, facts)] += 1
    for each in facts.values():
        told.update(f"{each.path.name}: {note}" for note in each.notes)
    lines = [text if number == 1 else f"{text} ({number} times)" for text, number in told.items()]
    for line in lines[:_MOST_LINES]:
        _warn_once(line)
    if (more := len(lines) - _MOST_LINES) > 0:
        _warn_once(f"and {more} more of the kind in the model")


def _in_one_line(line: str, facts: Mapping[str, ModelFacts]) -> str:
    """A line of Drake's log with the name of the author's file, and without the line's number."""
    text = " ".join(line.split())
    if found := re.match(r"(.*?):(\d+): (?:warning|error): (.*)", text):
        place, _, message = found.groups()
        return f"{facts[place].path.name if place in facts else Path(place).name}: {message}"
    return text


@functools.cache
def _warn_once(text: str) -> None:
    warnings.warn(text, ModelWarning, stacklevel=4)
