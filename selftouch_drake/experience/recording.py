"""Reads recordings of other robots: tables with named columns, as the robot's own tools write them.

A recording is a Parquet, CSV or NPZ file, or a folder of files of one kind. Folders in the layout
of LeRobot (`meta/info.json`, `data/`) are understood.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from selftouch_drake.experience.columns import RecordingError
from selftouch_drake.experience.recorded_file import Recording, Wanted, read_file

_KINDS = (".parquet", ".csv", ".npz")


def read_recording(
    source: Path,
    *,
    q: str | None = None,
    sensation: str | None = None,
    time: str | None = None,
    rows: Sequence[str] = (),
    delimiter: str | None = None,
) -> Recording:
    """Reads a file, or a folder of files of one kind.

    Args:
        source: a Parquet, CSV or NPZ file, or a folder; in LeRobot's layout the files under `data`
            are read.
        q: the columns of motor configurations, with an array or a number in each row, as names
            separated by commas or as a pattern (`joint_*`), in the order of their numbers. By
            default the first of `Q_NAMES` that exists. In an archive, the arrays of `NAMES_OF` name
            the joints and receptors, and arrays may be transposed.
        sensation: the columns of raw readings, likewise; by default the first of `SENSATION_NAMES`.
        time: the column of seconds; by default the first of `TIME_NAMES` that exists, if any.
        rows: conditions, as `COLUMN=VALUE` or `COLUMN=VALUE,VALUE`; rows that meet all are read.
        delimiter: between the columns of text; by default the one that the first line has most of.

    Raises:
        FileNotFoundError: the source does not exist.
        RecordingError: a column does not exist, shapes disagree, or no row is complete.
        ValueError: a file is damaged.
    """
    files = _files(source)
    wanted = Wanted(
        q=q,
        sensation=sensation,
        time=time,
        rows=rows,
        delimiter=delimiter,
        named=_lerobot_names(source),
    )
    parts = [read_file(path, wanted, number) for number, path in enumerate(files)]
    _require_one_robot(files, parts)
    joined = _joined(parts)
    if rows and not joined.num_rows:
        raise RecordingError(f"--rows is {', '.join(rows)}; no row of {source} is so: correct it")
    if not len(joined.q):
        raise RecordingError(
            f"{source} has no complete row: in each of {joined.num_rows} a number is missing; "
            "record q and sensation in the same row"
        )
    return joined


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
    return replace(
        parts[0],
        q=np.concatenate([part.q for part in parts]),
        readings=np.concatenate([part.readings for part in parts]),
        time_s=np.concatenate(times) if len(times) == len(parts) else None,
        piece=np.concatenate([part.piece for part in parts]),
        num_rows=sum(part.num_rows for part in parts),
        num_incomplete=sum(part.num_incomplete for part in parts),
        choices=choices,
    )


def _files(source: Path) -> list[Path]:
    """The files of a recording, in order."""
    if source.is_file():
        if source.suffix.lower() not in _KINDS:
            raise RecordingError(f"{source} is not a parquet, csv or npz file; convert it to one")
        return [source]
    if not source.is_dir():
        raise FileNotFoundError(f"{source} does not exist; give a file or a folder")
    folder = source / "data" if (source / "meta" / "info.json").is_file() else source
    found = [path for path in sorted(folder.rglob("*")) if path.suffix.lower() in _KINDS]
    kinds = sorted({path.suffix.lower() for path in found})
    if not found:
        raise RecordingError(f"{folder} holds no parquet, csv or npz file; give another folder")
    if len(kinds) > 1:
        raise RecordingError(f"{folder} holds files of kinds {', '.join(kinds)}; give one kind")
    return found


def _lerobot_names(source: Path) -> dict[str, list[str]]:
    """LeRobot's names for the numbers of each column, where it has any."""
    file = source / "meta" / "info.json"
    if not file.is_file():
        return {}
    try:
        features = json.loads(file.read_text(encoding="utf-8"))["features"]
        names = {name: feature.get("names") for name, feature in features.items()}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise RecordingError(f"{file} is damaged; write it again") from None
    found = {}
    for name, given in names.items():
        # Some versions have a list, others a mapping with one list in it.
        given = next(iter(given.values()), None) if isinstance(given, dict) else given
        if isinstance(given, list):
            found[name] = [str(one) for one in given]
    return found
