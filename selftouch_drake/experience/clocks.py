"""The times of a file: which columns hold them, and for which other columns they stand."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from selftouch_drake.experience.columns import numbers_in
from selftouch_drake.experience.containers.contents import Clock, Column, Contents
from selftouch_drake.experience.recording_error import RecordingError
from selftouch_drake.experience.times import Times, in_seconds, joined_counts
from selftouch_drake.experience.units import plain_form
from selftouch_drake.experience.usual_names import TIME_NAMES, at_a_usual_end, of_usual_name

# Endings of the names of two columns that hold one time: whole seconds, and nanoseconds.
_STAMPS = (("secs", "nsecs"), ("sec", "nanosec"), ("sec", "nsec"))
_TIME_WORD = re.compile(r"(^|_)(t|times?|timestamps?|stamps?|clock)(_s|_ns|_us|_ms)?(_|$)")
# Share of the steps of a clock that go forwards.
_COUNTS_UP = 0.9
# Words for joints, and for the skin, in the names of their times.
_OF_JOINTS = re.compile(r"(^|_)(q|qpos|joints?|arm|robot|encoders?|motors?|pos|positions?)(_|$)")
_OF_SKIN = re.compile(r"(^|_)(touch|tactile|skin|taxels?|pressure|sensors?|readings?)(_|$)")


def times_of(
    contents: Contents,
    source: str,
    asked: str | None,
    unit: str | None,
    joints: np.ndarray | None = None,
) -> tuple[list[str], Times | None]:
    """The columns of times of a table, and the times, if there are any.

    Args:
        contents: of the file.
        source: the file, as errors call it.
        asked: the column that the user names, which must exist; None for one with a usual name.
        unit: as in `read_recording`.
        joints: `(n, J)` motor configurations of the same rows, if there are any.

    Raises:
        RecordingError: these are no times, or their unit cannot be known.
    """
    columns = contents.by_name
    if asked is not None:
        names = [asked]
    else:
        names = (of_usual_name(columns, TIME_NAMES) or at_a_usual_end(columns, TIME_NAMES))[:1]
        if not names:
            forms = {plain_form(name): name for name in columns}
            ends = ("stamp_secs", "stamp_sec", "secs", "sec")
            names = [name for form, name in forms.items() if form.endswith(ends)][:1]
        names = names or _only_clock(columns)
    if not names:
        return [], None
    (name,) = names
    what = f"column {name} of {source}"
    for whole, rest in _STAMPS:
        sibling = f"{name[: -len(whole)]}{rest}"
        if name.endswith(whole) and sibling in columns:
            both = [
                numbers_in(columns[one], f"column {one} of {source}") for one in (name, sibling)
            ]
            stamps = joined_counts(*both)
            what = f"columns {name} and {sibling} of {source}"
            return [name, sibling], in_seconds(stamps, name, what, "ns")
    if joints is not None and _length(columns[name]) != len(joints):
        joints = None
    return names, in_seconds(columns[name], name, what, unit, joints)


def _only_clock(columns: Mapping[str, Column]) -> list[str]:
    """The column with time in its name that counts up, if it is the only one: `ros_time`."""
    found = []
    for name, column in columns.items():
        if not _TIME_WORD.search(plain_form(name)) or not _is_narrow(column):
            continue
        try:
            steps = np.diff(numbers_in(column, name).astype(float).ravel())
        except RecordingError:
            continue
        if len(steps) and np.mean(steps > 0) > _COUNTS_UP:
            found.append(name)
    return found if len(found) == 1 else []


def own_clocks(
    contents: Contents, source: str, joints: Sequence[str], skin: Sequence[str], unit: str | None
) -> dict[str, Clock]:
    """The clocks of columns whose file has times for joints and others for the skin.

    Raises:
        RecordingError: these are no times, or their unit cannot be known.
    """
    if contents.clocks:
        return dict(contents.clocks)
    columns = contents.by_name
    rows_q, rows_skin = len(columns[joints[0]]), len(columns[skin[0]])
    candidates = [
        name
        for name, column in columns.items()
        if _TIME_WORD.search(plain_form(name)) and np.ndim(column) <= 2 and _is_narrow(column)
    ]
    shared = of_usual_name(columns, TIME_NAMES)[:1]
    if rows_q == rows_skin and shared and len(columns[shared[0]]) == rows_q:
        return {}
    of_q = _clock_for(joints[0], rows_q, candidates, columns, _OF_JOINTS)
    of_skin = _clock_for(skin[0], rows_skin, candidates, columns, _OF_SKIN)
    if of_q is None or of_skin is None or of_q == of_skin:
        return {}
    found: dict[str, Clock] = {}
    times = [
        in_seconds(columns[name], name, f"column {name} of {source}", unit)
        for name in (of_q, of_skin)
    ]
    origin = min(one.origin_s for one in times)
    for name, one, taken in zip((of_q, of_skin), times, (joints, skin), strict=True):
        what = ", ".join(filter(None, [f"column {name}", one.note]))
        clock = Clock(name=name, time_s=one.time_s + (one.origin_s - origin), what=what)
        found |= dict.fromkeys(taken, clock)
    return found


def _is_narrow(column: Column) -> bool:
    shape = np.shape(column) if isinstance(column, np.ndarray) else (len(column),)
    return len(shape) == 1 or 1 in shape


def _clock_for(
    column: str,
    num_rows: int,
    candidates: Sequence[str],
    columns: Mapping[str, Column],
    words: re.Pattern[str],
) -> str | None:
    """The one column of times that stands for a column, by its name and length; None if none."""

    def score(name: str) -> int:
        form = plain_form(name)
        own = set(plain_form(column).split("_"))
        shared = len(own & set(form.split("_")))
        return 2 * shared + bool(words.search(form))

    fitting = [name for name in candidates if _length(columns[name]) == num_rows]
    best = max(map(score, fitting), default=0)
    first = [name for name in fitting if score(name) == best]
    if best == 0:
        # Only one has as many rows.
        return fitting[0] if len(fitting) == 1 else None
    return first[0] if len(first) == 1 else None


def _length(column: Column) -> int:
    return max(np.shape(column)) if isinstance(column, np.ndarray) else len(column)
