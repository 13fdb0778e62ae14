"""HDF5 files: the data sets of all groups, by their paths; and MATLAB's files from 7.3 on."""

import re
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from selftouch_drake.experience.containers.contents import EPISODE, Column, Contents, damaged
from selftouch_drake.experience.recording_error import RecordingError

if TYPE_CHECKING:
    import h5py

# More numbers in a row than a skin has: a picture.
_PICTURE = 20_000
# Groups of one form each, of which every one holds a piece of motion: `demo_0`, `episode_12`.
_EPISODE = re.compile(r"(demo|episode|ep|traj|trajectory|trial|rollout|run|walk|take|session)_?\d+")
# Attributes that name the numbers in a row of a data set.
_LABELS = ("names", "joint_names", "labels", "columns", "column_names", "receptor_names")


def read_hdf5(path: Path, *, matlab: bool = False) -> Contents:
    """The data sets of a file, by their paths; episodes in groups of their own one after another.

    MATLAB writes axes the other way round, and text as numbers.

    Raises:
        RecordingError: it is damaged, h5py is not installed, or pandas wrote it.
    """
    try:
        import h5py
    except ImportError:
        raise RecordingError(
            f"{path} needs h5py to be read: pip install 'selftouch-drake[hdf5]', or save its "
            "arrays as npz"
        ) from None
    arrays: dict[str, np.ndarray] = {}
    labels: dict[str, Sequence[str]] = {}
    skipped: list[str] = []

    def visit(name: str, item: Any) -> None:
        if "pandas_type" in item.attrs:
            raise RecordingError(f"{path} is written by pandas.to_hdf; write it by to_parquet")
        if not isinstance(item, h5py.Dataset) or "#refs#" in name:
            return
        named = _labels_of(item)
        for key, array in _read(item, name, matlab=matlab).items():
            arrays[key] = array
            if named and array.ndim == 2 and array.shape[1] == len(named):
                labels[key] = named
        if not any(key == name or key.startswith(f"{name}.") for key in arrays):
            skipped.append(name)

    try:
        with h5py.File(path, "r") as file:
            file.visititems(visit)
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        if isinstance(error, RecordingError):
            raise
        raise damaged(path, error) from None
    by_name, apart = _episodes_joined(path, arrays)
    short = {_without_episode(name): label for name, label in labels.items()}
    return Contents(
        by_name=by_name,
        labels={name: label for name, label in (labels | short).items() if name in by_name},
        skipped=tuple(dict.fromkeys([*map(_without_episode, skipped), *apart])),
    )


def _read(item: "h5py.Dataset", name: str, *, matlab: bool) -> dict[str, np.ndarray]:
    """The arrays of a data set: one, one for each field of a table, or none."""
    if item.shape is None or np.prod(item.shape[1:], dtype=float) > _PICTURE:
        return {}
    if item.dtype.names:
        table = item[()]
        return {
            f"{name}.{field}": table[field]
            for field in item.dtype.names
            if table[field].dtype.kind in "fiubS"
        }
    if isinstance((item.dtype.metadata or {}).get("vlen"), np.dtype):
        rows = [np.ravel(row) for row in np.ravel(item[()])]
        # Arrays of one length each, although they might differ.
        alike = len({len(row) for row in rows}) == 1
        return {name: np.stack(rows)} if alike and rows[0].dtype.kind in "fiub" else {}
    if item.dtype.kind in "OS":
        words = [_word(one) for one in np.ravel(item[()]).tolist()]
        return {} if None in words else {name: np.array(words, dtype=str)}
    if item.dtype.kind not in "fiub":
        return {}
    array = item[()]
    if not matlab:
        return {name: np.asarray(array)}
    kind = item.attrs.get("MATLAB_class", b"")
    if kind == b"char":
        return {name: np.array("".join(map(chr, np.ravel(array, order="F").tolist())))}
    array = np.asarray(array).T
    # MATLAB has no arrays of one axis.
    return {name: array.ravel() if 1 in array.shape and array.ndim == 2 else array}


def _word(value: object) -> str | None:
    if isinstance(value, bytes):
        return value.decode("utf-8", errors="replace")
    return value if isinstance(value, str) else None


def _labels_of(item: "h5py.Dataset") -> list[str]:
    """The names of the numbers in a row that the attributes of a data set give, if they do."""
    for key in _LABELS:
        given = item.attrs.get(key)
        if isinstance(given, np.ndarray) and given.ndim == 1 and given.dtype.kind in "OSU":
            return [_word(one) or str(one) for one in given.tolist()]
    return []


def _without_episode(name: str) -> str:
    """A path without the group of its episode, and without those around it."""
    parts = name.split("/")
    at = [number for number, part in enumerate(parts[:-1]) if _EPISODE.fullmatch(part.lower())]
    return "/".join(parts[at[-1] + 1 :]) if at else name


def _episode_of(name: str) -> list[tuple[int, str]]:
    """What comes before the part of a path that all episodes share, in the order of numbers."""
    beginning = name.removesuffix(_without_episode(name))
    return [
        (int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", beginning)
    ]


def _episodes_joined(
    path: Path, arrays: Mapping[str, np.ndarray]
) -> tuple[dict[str, Column], list[str]]:
    """Arrays by name; those of several episodes one after another, with the number of each row.

    Returns:
        The arrays, and the names of those that do not have a row for each instant of each episode.
    """
    inside = [name for name in arrays if _without_episode(name) != name]
    if not inside:
        return dict(arrays), []
    inside.sort(key=_episode_of)
    episodes = [
        {_without_episode(name): arrays[name] for name in names}
        for _, names in groupby(inside, key=_episode_of)
    ]
    shared = [name for name in episodes[0] if all(name in episode for episode in episodes)]
    found: dict[str, Column] = {name: array for name, array in arrays.items() if name not in inside}
    lengths = []
    for episode in episodes:
        rows = [len(episode[name]) for name in shared if episode[name].ndim]
        lengths.append(max(set(rows), key=rows.count) if rows else 0)
    for name in shared:
        parts = [episode[name] for episode in episodes]
        if {part.shape[1:] for part in parts} != {parts[0].shape[1:]} or not parts[0].ndim:
            raise RecordingError(
                f"{path} has another number of {name} in some episodes; import recordings of one "
                "robot at a time"
            )
        if [len(part) for part in parts] == lengths:
            found[name] = np.concatenate(parts)
    if EPISODE not in found:
        found[EPISODE] = np.repeat(np.arange(len(episodes)), lengths)
    every = dict.fromkeys(name for episode in episodes for name in episode)
    return found, [name for name in every if name not in found]
