"""What a file of a recording holds, whatever its kind."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pyarrow as pa

from selftouch_drake.experience.recording_error import RecordingError

#: A column of a table, or an array of an archive.
Column: TypeAlias = pa.ChunkedArray | np.ndarray
#: The column that says which episode a row is of.
EPISODE = "episode_index"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Clock:
    """The times of columns that were recorded apart from others, as one topic of a bag.

    Attributes:
        name: of the topic, or of the column of times.
        time_s: `(n,)` s from an origin that all clocks of the file share; NaN where one is missing.
        stamp_s: `(n,)` the same by the clock of the sender; None if it sends no time.
        what: what `time_s` is, in words.
    """

    name: str
    time_s: np.ndarray
    stamp_s: np.ndarray | None = None
    what: str = "the times of arrival"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contents:
    """What a file holds.

    Attributes:
        by_name: each column, by its name.
        clashing: names that several columns with different content have.
        num_broken: number of rows left out because they could not be read.
        notes: what was understood that the reader of the summary should know.
        labels: the name of each number in a row of a column, where the file gives them.
        clocks: the clock of each column that was recorded apart from others.
        evident: for an option, the columns that can be nothing else.
        skipped: names of what was not read, because it holds no numbers or pictures.
    """

    by_name: Mapping[str, Column]
    clashing: frozenset[str] = frozenset()
    num_broken: int = 0
    notes: tuple[str, ...] = ()
    labels: Mapping[str, Sequence[str]] = field(default_factory=dict)
    clocks: Mapping[str, Clock] = field(default_factory=dict)
    evident: Mapping[str, Sequence[str]] = field(default_factory=dict)
    skipped: tuple[str, ...] = ()


def damaged(path: Path, error: Exception) -> RecordingError:
    """The error that says why a file cannot be read."""
    if "allow_pickle" in str(error):
        return RecordingError(f"{path} holds objects of Python; save arrays of numbers")
    reason = " ".join(str(error).split())[:200].rstrip(".") or type(error).__name__
    return RecordingError(f"{path} is damaged ({reason}); write it again")
