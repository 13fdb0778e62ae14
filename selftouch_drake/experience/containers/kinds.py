"""The kinds of files that are read, by the ending of their names.

A new kind is a module beside this one that returns `Contents`, and a line in `read_columns`.
"""

from collections.abc import Sequence
from pathlib import Path

from selftouch_drake.experience.containers.arrays import (
    read_archive,
    read_matlab,
    read_single_arrays,
)
from selftouch_drake.experience.containers.contents import Contents
from selftouch_drake.experience.containers.hdf5 import read_hdf5
from selftouch_drake.experience.containers.ros import read_bag
from selftouch_drake.experience.containers.tables import read_arrow, read_text
from selftouch_drake.experience.containers.yarp import is_yarp_log, read_yarp

#: Endings of tables as text. The last ones are read if nothing else is there.
TEXT_KINDS = (".csv", ".tsv", ".csv.gz", ".tsv.gz")
LOOSE_TEXT_KINDS = (".txt", ".dat")
#: Endings of files that hold topics of ROS.
BAG_KINDS = (".bag", ".mcap", ".db3")
#: Endings of all files that are read.
KINDS = (
    *(".parquet", ".feather", ".arrow", *TEXT_KINDS, *LOOSE_TEXT_KINDS),
    *(".npz", ".npy", ".mat", ".h5", ".hdf5", *BAG_KINDS),
)
KINDS_TEXT = "csv, tsv, parquet, feather, npz, npy, mat, hdf5, bag or mcap"
#: What to do about files of other kinds.
HINTS = {
    **dict.fromkeys((".xlsx", ".xls", ".ods"), "save it as csv"),
    **dict.fromkeys((".pkl", ".pickle"), "save its arrays as npz"),
    **dict.fromkeys((".jsonl", ".json"), "write it as csv or parquet"),
    **dict.fromkeys((".log",), "rename it to .csv, if it is a table"),
    **dict.fromkeys((".gz", ".zip", ".zst", ".xz", ".7z", ".active"), "unpack or reindex it"),
}


def kind_of(path: Path) -> str:
    """The ending of a file, in small letters; with the one before it if that is packed."""
    endings = [ending.lower() for ending in path.suffixes[-2:]]
    return "".join(endings) if "".join(endings) in KINDS else path.suffix.lower()


def is_rosbag_folder(path: Path) -> bool:
    """Whether a folder is a bag of ROS 2: it has a page of metadata beside its files."""
    return (path / "metadata.yaml").is_file() and any(
        kind_of(file) in BAG_KINDS or file.suffix == ".zstd" for file in path.iterdir()
    )


def read_columns(files: Sequence[Path], delimiter: str | None) -> Contents:
    """All columns of a file, or of several `.npy` files that hold one array each.

    The delimiter is as in `read_recording`.

    Raises:
        RecordingError: a file is damaged, or the delimiter is more than one character.
        ValueError: an archive is damaged.
    """
    path, kind = files[0], kind_of(files[0])
    if path.is_dir() or kind in BAG_KINDS:
        return read_bag(path)
    if is_yarp_log(path):
        return read_yarp(path)
    if kind == ".npy":
        return read_single_arrays(files)
    if kind == ".npz":
        return read_archive(path)
    if kind == ".mat":
        return read_matlab(path)
    if kind in (".h5", ".hdf5"):
        return read_hdf5(path)
    if kind in (*TEXT_KINDS, *LOOSE_TEXT_KINDS):
        return read_text(path, delimiter)
    return read_arrow(path)
