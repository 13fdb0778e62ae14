"""Files that appear whole or not at all."""

import contextlib
import csv
import functools
import hashlib
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
from filelock import FileLock, Timeout

#: Names of files that are being written.
UNFINISHED = ".*.part"


@contextlib.contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yields a path to write aside; on success it is flushed and takes the place of `path`.

    On any error the file aside is removed and `path` is as it was.

    Raises:
        OSError: it cannot be written, as when the disk is full; the text names it.
    """
    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield aside
        with aside.open("rb") as file:
            os.fsync(file.fileno())
        aside.replace(path)
    except OSError as error:
        # What fails while it writes does not say where.
        if error.filename is not None or str(path) in str(error):
            raise
        raise OSError(f"{path} cannot be written: {error.strerror or error}") from error
    finally:
        aside.unlink(missing_ok=True)


def remove_unfinished(folder: Path) -> None:
    """Removes the files that killed processes were writing into a folder; nobody else may write."""
    for aside in folder.rglob(UNFINISHED):
        aside.unlink(missing_ok=True)


@contextlib.contextmanager
def locked(folder: Path, refusal: Exception) -> Iterator[None]:
    """Locks a folder for one writer; the lock ends with its process, however that ends.

    Raises:
        PermissionError: nothing can be written there; the text names the folder.
        Exception: `refusal`, if another process writes there.
    """
    if not os.access(folder, os.W_OK, effective_ids=True):
        raise PermissionError(f"{folder} cannot be written; make it writable, or work on a copy")
    lock = FileLock(folder / ".lock")
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise refusal from None
    try:
        yield
    finally:
        lock.release()


def write_text_whole(path: Path, text: str) -> None:
    """Writes `text` to `path`, whole or not at all."""
    with written_whole(path) as aside:
        aside.write_text(text, encoding="utf-8")


def write_csv(path: Path, names: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Writes a table with the names of its columns, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(path) as aside, aside.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([names, *rows])


def content_digest(path: Path) -> str:
    """SHA-256 of what a file holds."""
    stat = path.stat()
    return _digest(path, stat.st_mtime_ns, stat.st_size)


# By what changes with the content: a sweep asks for the same files hundreds of times.
@functools.lru_cache(maxsize=4096)
def _digest(path: Path, mtime_ns: int, size: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def save_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Writes arrays to an `.npz` file, whole or not at all; equal arrays give equal bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(path) as aside, aside.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def load_arrays(path: Path, names: Iterable[str] = ()) -> dict[str, np.ndarray]:
    """Reads all arrays of an `.npz` file; nothing is ever unpickled.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is damaged, or lacks one of the arrays `names`; the text names it.
    """
    try:
        # A bare array (.npy) opens too, without the `files` of an archive.
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except FileNotFoundError:
        raise
    # For truncated, damaged and foreign files, numpy raises a dozen kinds of errors.
    except Exception as error:
        reason = " ".join(str(error).split())[:200].rstrip(".") or type(error).__name__
        raise ValueError(f"{path} is damaged ({reason}); make it again") from None
    if missing := [name for name in names if name not in arrays]:
        raise ValueError(f"{path} lacks {', '.join(missing)}; make it again")
    return arrays


def kept_arrays(
    path: Path, names: Iterable[str], make: Callable[[], Mapping[str, np.ndarray]]
) -> Mapping[str, np.ndarray]:
    """Arrays of a file that can be made again at any time.

    If the file is missing or damaged, they are made and kept for the next time, unless nothing can
    be written there. The name of the file must say what they are made from.
    """
    try:
        return load_arrays(path, names)
    except (FileNotFoundError, ValueError):
        arrays = make()
    with contextlib.suppress(OSError):
        save_arrays(path, arrays)
    return arrays
