"""The files of a recording: which of a folder count, and which belong together."""

from pathlib import Path

from selftouch_drake.experience.containers.kinds import (
    BAG_KINDS,
    HINTS,
    KINDS,
    KINDS_TEXT,
    LOOSE_TEXT_KINDS,
    TEXT_KINDS,
    is_rosbag_folder,
    kind_of,
)
from selftouch_drake.experience.containers.lerobot import is_lerobot
from selftouch_drake.experience.containers.yarp import is_yarp_log
from selftouch_drake.experience.recording_error import RecordingError
from selftouch_drake.experience.units import plain_form
from selftouch_drake.experience.usual_names import (
    Q_NAMES,
    SENSATION_NAMES,
    TIME_NAMES,
    in_order_of_numbers,
)
from selftouch_drake.files import content_digest


def files_of(source: Path) -> tuple[list[list[Path]], list[str]]:
    """The files of a recording, in order, single arrays of one piece of motion together; and notes.

    Raises:
        FileNotFoundError: the source does not exist.
        RecordingError: it is no recording, or holds files of several kinds.
    """
    if source.is_file():
        kind = kind_of(source)
        if kind == ".npy":
            raise RecordingError(
                f"{source} holds one array; give the folder that holds those of joints and skin"
            )
        if kind not in KINDS:
            remedy = HINTS.get(kind, "convert it to one")
            raise RecordingError(f"{source} is not a {KINDS_TEXT} file; {remedy}")
        return [[source]], []
    if not source.is_dir():
        raise FileNotFoundError(f"{source} does not exist; give a file or a folder")
    if is_rosbag_folder(source):
        return [[source]], []
    folder = source / "data" if is_lerobot(source) else source
    found, notes = _found_in(folder)
    kinds = sorted({_kind(path) for path in found})
    if not found:
        others = {path.suffix.lower() for path in folder.rglob("*") if path.is_file()} & {*HINTS}
        remedy = HINTS[min(others)] if others else "give another folder"
        raise RecordingError(f"{folder} holds no {KINDS_TEXT} file; {remedy}")
    if len(kinds) > 1 and not {*kinds} <= {*TEXT_KINDS}:
        raise RecordingError(f"{folder} holds files of kinds {', '.join(kinds)}; give one kind")
    if kinds == [".npy"]:
        return _grouped(found), notes
    contents = {path: path if path.is_dir() else content_digest(path) for path in found}
    first_of = {contents[path]: path for path in reversed(found)}
    copies = [path for path in found if first_of[contents[path]] != path]
    if copies:
        same = first_of[contents[copies[0]]]
        notes.append(
            f"{len(copies)} files are copies of others and left out, as {copies[0].name} of "
            f"{same.name}"
        )
    return [[path] for path in found if path not in copies], notes


def _found_in(folder: Path) -> tuple[list[Path], list[str]]:
    """The files of known kinds in a folder, in order, a bag of ROS 2 as its folder; and notes."""
    every = [
        path
        for path in folder.rglob("*")
        if path.is_file() and (kind_of(path) in KINDS or is_yarp_log(path))
    ]
    found = [path for path in every if not _is_left_behind(path.relative_to(folder))]
    notes = []
    if len(every) > len(found):
        notes.append(f"{len(every) - len(found)} hidden files or copies of an editor are left out")
    # Pages of text lie beside recordings of all kinds.
    if any(kind_of(path) not in LOOSE_TEXT_KINDS for path in found):
        found = [path for path in found if kind_of(path) not in LOOSE_TEXT_KINDS]
    bags = {path.parent for path in found if kind_of(path) in BAG_KINDS}
    bags = {path for path in bags if is_rosbag_folder(path)}
    found = [*bags, *(path for path in found if path.parent not in bags)]
    found.sort(key=lambda path: in_order_of_numbers(str(path.relative_to(folder))))
    return found, notes


def _kind(path: Path) -> str:
    return "a bag of ROS 2" if path.is_dir() else kind_of(path)


def _is_left_behind(path: Path) -> bool:
    """Whether a file is hidden, or a copy that an editor or a system keeps."""
    return any(
        part.startswith((".", "~$", "__MACOSX")) for part in path.parts
    ) or path.stem.endswith("-checkpoint")


def _grouped(found: list[Path]) -> list[list[Path]]:
    """Arrays that belong together: of one folder and, if they share some, of one beginning."""
    usual = sorted(
        {plain_form(name) for name in (*Q_NAMES, *SENSATION_NAMES, *TIME_NAMES) if "#" not in name},
        key=len,
        reverse=True,
    )
    groups: dict[tuple[Path, str], list[Path]] = {}
    for path in found:
        form = plain_form(path.stem)
        ending = next((name for name in usual if form == name or form.endswith(f"_{name}")), "")
        beginning = form[: len(form) - len(ending)] if ending else ""
        groups.setdefault((path.parent, beginning), []).append(path)
    return list(groups.values())
