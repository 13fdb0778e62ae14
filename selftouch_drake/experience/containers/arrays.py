"""Arrays: archives of numpy, folders of single arrays, and MATLAB's files."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from selftouch_drake.experience.containers.contents import EPISODE, Column, Contents, damaged
from selftouch_drake.experience.recording_error import RecordingError
from selftouch_drake.files import load_arrays

# The first bytes of MATLAB's files from version 7.3 on, which are HDF5.
_MATLAB_HDF5 = b"MATLAB 7.3"


def read_archive(path: Path) -> Contents:
    """The arrays of an `.npz` archive.

    Raises:
        RecordingError: it holds objects.
        ValueError: it is damaged.
    """
    try:
        return Contents(by_name=load_arrays(path))
    except ValueError as error:
        if "allow_pickle" in str(error):
            raise damaged(path, error) from None
        raise


def read_single_arrays(files: Sequence[Path]) -> Contents:
    """The array of each `.npy` file, by its name without what all begin with, as in `walk1_q`.

    Raises:
        RecordingError: one of them is damaged.
    """
    found: dict[str, Column] = {}
    beginning = ""
    if len(files) > 1:
        least, most = min(path.stem for path in files), max(path.stem for path in files)
        alike = [one == other for one, other in zip(least, most, strict=False)]
        common = least[: alike.index(False)] if False in alike else least
        beginning = common[: common.rfind("_") + 1]
    for path in files:
        try:
            found[path.stem.removeprefix(beginning)] = np.load(path, allow_pickle=False)
        # For truncated, damaged and foreign files, numpy raises a dozen kinds of errors.
        except Exception as error:
            raise damaged(path, error) from None
    return Contents(by_name=found)


def read_matlab(path: Path) -> Contents:
    """The arrays of a MATLAB file; those in one of several structs have names such as `data.q`.

    Raises:
        RecordingError: it is damaged.
    """
    with path.open("rb") as file:
        if file.read(len(_MATLAB_HDF5)) == _MATLAB_HDF5:
            from selftouch_drake.experience.containers.hdf5 import read_hdf5

            return read_hdf5(path, matlab=True)
    from scipy.io import loadmat  # no other run needs it

    try:
        content = loadmat(path, simplify_cells=True)
    # For truncated, damaged and foreign files, scipy raises a dozen kinds of errors.
    except Exception as error:
        raise damaged(path, error) from None
    content = {name: value for name, value in content.items() if not name.startswith("__")}
    while len(content) == 1 and isinstance(inner := next(iter(content.values())), Mapping):
        content = dict(inner)
    if len(content) == 1 and (episodes := _structs(next(iter(content.values())))):
        return Contents(by_name=_one_after_another(path, [_flat(one) for one in episodes]))
    return Contents(by_name=_flat(content))


def _structs(value: Any) -> list[Mapping[str, Any]]:
    """The structs in an array of structs or in a cell array of them; none if it is another."""
    several = list(np.ravel(value)) if isinstance(value, np.ndarray | list) else []
    return several if all(isinstance(one, Mapping) for one in several) else []


def _one_after_another(path: Path, episodes: Sequence[Mapping[str, Column]]) -> dict[str, Column]:
    """The rows of several episodes, with the number of the episode of each row.

    Raises:
        RecordingError: they do not hold the same arrays, with as many rows each.
    """
    first = episodes[0]
    lengths = [
        max((len(array) for array in one.values() if np.ndim(array)), default=0) for one in episodes
    ]
    try:
        found = {name: np.concatenate([one[name] for one in episodes]) for name in first}
    except (KeyError, ValueError):
        found = {}
    if not found or any(len(array) != sum(lengths) for array in found.values()):
        raise RecordingError(
            f"{path} has episodes whose arrays differ in names or rows; save them with one row for "
            "each instant"
        )
    found[EPISODE] = np.repeat(np.arange(len(episodes)), lengths)
    return found


def _flat(content: Mapping[str, Any], under: str = "") -> dict[str, Column]:
    """Arrays by name, those of a mapping within by the names of both."""
    found: dict[str, Column] = {}
    for name, value in content.items():
        if isinstance(value, Mapping):
            found |= _flat(value, f"{under}{name}.")
        else:
            words = isinstance(value, list) and all(isinstance(one, str) for one in value)
            array = np.array(value, dtype=str) if words else np.asarray(value)
            if array.dtype.kind == "O" and all(isinstance(one, str) for one in array.ravel()):
                array = array.astype(str)
            if array.dtype.kind in "fiubUMm":
                found[f"{under}{name}"] = array
    return found
