"""Files that hold joints and skin apart, one for each topic or port: what they hold together."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from selftouch_drake.experience.choice import Choice, Wanted
from selftouch_drake.experience.clocks import times_of
from selftouch_drake.experience.containers.contents import Clock, Column, Contents
from selftouch_drake.experience.recording_error import RecordingError

_OPTIONS = ("--q", "--sensation")


def columns_for(contents: Contents, source: str, wanted: Wanted) -> dict[str, list[str]]:
    """For `--q` and `--sensation`, the columns of a file that hold them, if any do."""
    choice = Choice(contents, source, wanted)
    found = {}
    for option, asked in zip(_OPTIONS, (wanted.q, wanted.sensation), strict=True):
        names: list[str] = []
        for entry in [None] if asked is None else asked.split(","):
            try:
                names += choice.names(option, entry)
            except RecordingError:
                continue
        found[option] = names
    return found


def belonging_together(
    files: Sequence[Path], held: Sequence[dict[str, list[str]]], folder: Path
) -> list[list[int]] | None:
    """Which of some files hold joints and skin of one piece of motion, by the numbers in names.

    Args:
        files: in order.
        held: as in `columns_for`, of each.
        folder: that holds them.

    Returns:
        The places of the files of each piece; None if these are no such files.
    """
    if any(one["--q"] and one["--sensation"] for one in held):
        return None
    useful = [number for number, one in enumerate(held) if one["--q"] or one["--sensation"]]

    if not all(any(one[option] for one in held) for option in _OPTIONS):
        return None
    paths = [str(path.relative_to(folder)) for path in files]
    # A model may have a number too (`ur5_joints_2`), and each recorder may have written the time at
    # which it began into the name of its file.
    for key in (_numbers, lambda path: _numbers(path)[-1:], lambda path: Path(path).parent.parts):
        groups: dict[tuple[str, ...], list[int]] = {}
        for number in useful:
            groups.setdefault(key(paths[number]), []).append(number)
        if all(
            any(held[number][option] for number in group)
            for group in groups.values()
            for option in _OPTIONS
        ):
            return list(groups.values())
    return None


def _numbers(path: str) -> tuple[str, ...]:
    return tuple(re.findall(r"\d+", path))


def side_by_side(files: Sequence[Path], parts: Sequence[Contents], wanted: Wanted) -> Contents:
    """The columns of several files, each with the clock of its file.

    Raises:
        RecordingError: one of them has no times.
    """
    names = [name for part in parts for name in part.by_name]
    by_name: dict[str, Column] = {}
    clocks: dict[str, Clock] = {}
    labels: dict[str, Sequence[str]] = {}
    evident: dict[str, list[str]] = {option: [] for option in _OPTIONS}
    clocked = [_clock(path, part, wanted) for path, part in zip(files, parts, strict=True)]
    origin = min(origin_s for _, origin_s in clocked)
    for path, part, (clock, origin_s) in zip(files, parts, clocked, strict=True):
        clock = replace(clock, time_s=clock.time_s + (origin_s - origin))
        stem = path.stem
        called = {
            name: f"{stem}.{name}" if names.count(name) > 1 else name for name in part.by_name
        }
        by_name |= {called[name]: column for name, column in part.by_name.items()}
        clocks |= dict.fromkeys(called.values(), clock)
        labels |= {called[name]: given for name, given in part.labels.items()}
        for option, chosen in columns_for(part, str(path), wanted).items():
            evident[option] += [called[name] for name in chosen]
    return Contents(
        by_name=by_name,
        clocks=clocks,
        labels=labels,
        evident=evident,
        clashing=frozenset(name for part in parts for name in part.clashing),
        num_broken=sum(part.num_broken for part in parts),
        notes=tuple(dict.fromkeys(note for part in parts for note in part.notes)),
        skipped=tuple(name for part in parts for name in part.skipped),
    )


def _clock(path: Path, contents: Contents, wanted: Wanted) -> tuple[Clock, float]:
    """The clock of a file, and the time at which it shows 0."""
    if contents.clocks:
        return next(iter(contents.clocks.values())), 0.0
    asked = wanted.time if wanted.time in contents.by_name else None
    names, times = times_of(contents, str(path), asked, wanted.time_unit)
    if times is None:
        raise RecordingError(
            f"{path} has no times, and joints and skin are in files of their own; add a column of "
            "times to each"
        )
    what = ", ".join(filter(None, [f"column {names[0]}", times.note]))
    return Clock(name=path.name, time_s=times.time_s, what=what), times.origin_s
