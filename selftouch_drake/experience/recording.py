"""Reads recordings of other robots, as the robots' own tools write them.

A recording is a file of one of the kinds `KINDS`, or a folder of files of one kind. Folders in the
layout of LeRobot (`meta/info.json`, `data/`), of ROS 2's bags and of YARP's logs are understood.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from selftouch_drake.experience.choice import Wanted
from selftouch_drake.experience.containers.contents import Contents
from selftouch_drake.experience.containers.kinds import read_columns
from selftouch_drake.experience.containers.lerobot import lerobot_names
from selftouch_drake.experience.recorded import Recording
from selftouch_drake.experience.recorded_file import recorded
from selftouch_drake.experience.recorded_folder import files_of
from selftouch_drake.experience.recording_error import RecordingError
from selftouch_drake.experience.side_by_side import (
    belonging_together,
    columns_for,
    side_by_side,
)
from selftouch_drake.experience.times import SECONDS_IN
from selftouch_drake.experiment import shown


def read_recording(
    source: Path,
    *,
    q: str | None = None,
    sensation: str | None = None,
    time: str | None = None,
    time_unit: str | None = None,
    rows: Sequence[str] = (),
    delimiter: str | None = None,
) -> Recording:
    """Reads a file, or a folder of files of one kind.

    Args:
        source: a file of one of the `KINDS`, or a folder; in LeRobot's layout the files under
            `data` are read. In a folder of `.npy` files, those that differ only in the name of the
            array (`walk1_q.npy`, `walk1_touch.npy`) belong together; and so do files of which some
            hold joints and others the skin, by the numbers in their names.
        q: the columns of motor configurations, with an array or a number in each row, as names
            separated by commas, as FIRST..LAST, or as a pattern (`joint_*`), in the order of their
            numbers; in bags, topics. By default the first of `Q_NAMES` that exists, or topics that
            can be nothing else. In an archive, the arrays of `NAMES_OF` name the joints and
            receptors, and arrays may be transposed.
        sensation: the columns of raw readings, likewise; by default the first of `SENSATION_NAMES`.
        time: the column of times or dates; by default the first of `TIME_NAMES` that exists, if
            any; "none" for no time.
        time_unit: s, ms, us or ns; by default what the name, the numbers or the speeds say.
        rows: conditions, as `COLUMN=VALUE` or `COLUMN=VALUE,VALUE`; rows that meet all are read.
        delimiter: between the columns of text; by default the one that the first line has most of.

    Raises:
        FileNotFoundError: the source does not exist.
        RecordingError: a column does not exist, shapes disagree, or no row is complete.
        ValueError: a file is damaged.
    """
    if time_unit not in (None, *SECONDS_IN):
        raise RecordingError(
            f"--time-unit is {shown(time_unit)}; give one of {', '.join(SECONDS_IN)}"
        )
    files, notes = files_of(source)
    wanted = Wanted(
        q=q,
        sensation=sensation,
        time=time,
        time_unit=time_unit,
        rows=rows,
        delimiter=delimiter,
        named=lerobot_names(source),
    )
    sources, parts = _read(source, files, wanted)
    parts = [_in_order_of(parts[0], part) for part in parts]
    _require_one_robot(sources, parts)
    joined = _joined(parts)
    joined = replace(joined, notes=tuple(dict.fromkeys([*notes, *joined.notes])))
    if rows and not joined.num_rows:
        raise RecordingError(f"--rows is {', '.join(rows)}; no row of {source} is so: correct it")
    if not len(joined.q):
        raise RecordingError(
            f"{source} has no complete row: in each of {joined.num_rows} a number is missing; "
            "record q and sensation in the same row"
        )
    return joined


def _read(
    source: Path, files: Sequence[Sequence[Path]], wanted: Wanted
) -> tuple[list[Path], list[Recording]]:
    """Each piece of a recording, and the file or folder that it is from."""
    first = read_columns(files[0], wanted.delimiter)
    if len(files) > 1 and not all(columns_for(first, str(files[0][0]), wanted).values()):
        contents = [first, *(read_columns(group, wanted.delimiter) for group in files[1:])]
        parts = _read_apart(source, [group[0] for group in files], contents, wanted)
        if parts:
            return [source] * len(parts), parts
    sources = [group[0] if len(group) == 1 else group[0].parent for group in files]
    parts = []
    for number, (group, path) in enumerate(zip(files, sources, strict=True)):
        contents_of_file = read_columns(group, wanted.delimiter) if number else first
        parts.append(recorded(contents_of_file, path, wanted, number))
    return sources, parts


def _read_apart(
    source: Path, paths: Sequence[Path], contents: Sequence[Contents], wanted: Wanted
) -> list[Recording]:
    """The pieces of a recording whose files hold joints or skin; none if these are not such."""
    held = [columns_for(one, str(path), wanted) for one, path in zip(contents, paths, strict=True)]
    groups = belonging_together(paths, held, source)
    if groups is None:
        return []
    others = [path for path, one in zip(paths, held, strict=True) if not any(one.values())]
    note = f"{len(others)} files hold neither joints nor skin: left out"
    notes = (f"{note}, as {others[0].relative_to(source)}",) if others else ()
    parts = []
    for number, places in enumerate(groups):
        joined = side_by_side(
            [paths[place] for place in places], [contents[place] for place in places], wanted
        )
        part = recorded(joined, source, _found_already(wanted, joined), number)
        parts.append(replace(part, notes=(*notes, *part.notes)))
    return parts


def _found_already(wanted: Wanted, joined: Contents) -> Wanted:
    """The same wishes, with the columns that each file was found to have."""
    evident = joined.evident
    return replace(
        wanted,
        q=None if wanted.q is None else ",".join(evident["--q"]),
        sensation=None if wanted.sensation is None else ",".join(evident["--sensation"]),
        time="none" if wanted.time == "none" else None,
    )


def _in_order_of(first: Recording, part: Recording) -> Recording:
    """A part whose joints and receptors are in the order of the first, if they have its names."""
    found = part
    for what, array in (("joints", "q"), ("receptors", "readings")):
        names, own = getattr(first, what), getattr(part, what)
        if own != names and len(set(names)) == len(names) and sorted(own) == sorted(names):
            columns = [own.index(name) for name in names]
            found = replace(found, **{what: names, array: getattr(found, array)[:, columns]})
    return found


def _require_one_robot(files: Sequence[Path], parts: Sequence[Recording]) -> None:
    """Raises a `RecordingError` if joints or receptors of some files differ."""
    first = parts[0]
    for path, part in zip(files, parts, strict=True):
        for what in ("joints", "receptors"):
            if getattr(part, what) != getattr(first, what):
                raise RecordingError(
                    f"{path} has {len(getattr(part, what))} {what}, but {files[0]} has "
                    f"{len(getattr(first, what))}, or their names differ; import recordings of one "
                    "robot at a time"
                )


def _joined(parts: Sequence[Recording]) -> Recording:
    """All rows of several recordings of one robot; without times if one of them has none."""
    times = [part.time_s for part in parts if part.time_s is not None]
    choices = {
        name: tuple(sorted({value for part in parts for value in part.choices.get(name, ())}))
        for name in parts[0].choices
    }
    first_rows = np.cumsum([0, *(part.num_read for part in parts)])
    return replace(
        parts[0],
        row=np.concatenate(
            [part.row + first for part, first in zip(parts, first_rows, strict=False)]
        ),
        num_read=int(first_rows[-1]),
        q=np.ascontiguousarray(np.concatenate([part.q for part in parts])),
        readings=np.ascontiguousarray(np.concatenate([part.readings for part in parts])),
        time_s=np.concatenate(times) if len(times) == len(parts) else None,
        piece=np.concatenate([part.piece for part in parts]),
        num_rows=sum(part.num_rows for part in parts),
        num_incomplete=sum(part.num_incomplete for part in parts),
        choices=choices,
        notes=tuple(note for part in parts for note in part.notes),
        time_from=parts[0].time_from if len(times) == len(parts) else "",
        num_gaps=sum(part.num_gaps for part in parts),
    )
