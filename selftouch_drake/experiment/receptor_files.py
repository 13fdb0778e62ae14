"""Places of receptors as files give them: .csv, .txt, .npz or .pcd.

Columns have names: x, y and z; nx, ny and nz, the outward normal; width, the radius of the
receptive field; group, of receptors that share a reading; part, of the body; and name. A text
without names has the first 3, 6 or 7 of them. Tables of `selftouch model` and `selftouch map` have
rows of receptors that were never met, without a part: these are left out. In the files of YARP's
skin, rows of zeros stand for no receptor, and normals are placeholders.
"""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import is_zipfile

import numpy as np

_PLACE, _NORMAL = ["x", "y", "z"], ["nx", "ny", "nz"]
_USUAL = [*_PLACE, *_NORMAL, "width"]
# Names in arrays and point clouds.
_ARRAYS = {"positions": _PLACE, "normals": _NORMAL}
_CLOUD = {f"normal_{axis}": f"n{axis}" for axis in "xyz"}
_TYPES = {"F": "f", "I": "i", "U": "u"}
# After this line, YARP's files have numbers without names.
_YARP = "[calibration]"
# Fewest receptors of a skin.
_FEWEST = 4
# Most rows that an error names.
_SHOWN = 6
# m; two receptors that are nearer to each other are at one place.
_SAME = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReceptorTable:
    """The receptors of a file.

    Attributes:
        p_LS: `(S, 3)` m, their places in the link's frame.
        normal: `(S, 3)` of unit length, outward; or None.
        width: `(S,)` m, radius of each receptive field; or None.
        group: `(S,)` 0 to G - 1, the group of each; or None.
        label: `(S,)` how errors call each: by its line or row, and by its name.
    """

    p_LS: np.ndarray
    normal: np.ndarray | None
    width: np.ndarray | None
    group: np.ndarray | None
    label: Sequence[str]

    def num_readings(self, centre: bool) -> int:
        """S; or three of each group, if its `centre` is all that is read.

        Raises:
            ValueError: there are no groups.
        """
        if not centre:
            return len(self.p_LS)
        if self.group is None:
            raise ValueError("has no column group, which reading.mode centre needs; add it")
        return 3 * (int(self.group.max()) + 1)

    def those(self, which: Sequence[int] | np.ndarray) -> str:
        """Names the receptors with some numbers, as in `row 3, 7 (T7) and 12 more`."""
        more = len(which) - _SHOWN
        named = ", ".join(self.label[number] for number in which[:_SHOWN])
        return f"row {named}" + (f" and {more} more" if more > 0 else "")


def read_receptors(file: str, scale: float = 1.0, part: int | None = None) -> ReceptorTable:
    """Reads a file.

    Args:
        file: its path.
        scale: metres per unit of its lengths.
        part: of the body, whose receptors are wanted; None if there is only one.

    Raises:
        ValueError: it cannot be read or lacks a column; a number is not finite; two receptors are
            at one place, there are fewer than four, or they are of several parts.
    """
    if (read := _READERS.get(Path(file).suffix)) is None:
        raise ValueError(f"{file} has none of the endings {', '.join(_READERS)}; give one of these")
    try:
        table = _table_of(_of_one_part(dict(read(Path(file))), part), scale)
        _check(table)
    except OSError as error:
        raise ValueError(f"{file} cannot be read: {error.strerror or error}") from None
    except KeyError as error:
        raise ValueError(f"{file} has no entry {error}; save it anew") from None
    except ValueError as error:
        raise ValueError(f"{file} {' '.join(str(error).split())}") from None
    return table


def _of_one_part(columns: dict[str, Any], part: int | None) -> dict[str, Any]:
    """The rows of one part, without those of receptors that were never met.

    Raises:
        ValueError: several parts are there and none is named, or there is no such part.
    """
    if "receptor" in columns:  # so a map calls their names
        columns.setdefault("name", columns.pop("receptor"))
    if "part" not in columns:
        if part is not None:
            raise ValueError(f"has no column part, but part is {part}; leave it out")
        return columns
    parts = [str(cell).strip() for cell in columns["part"]]
    known = sorted({cell for cell in parts if cell}, key=lambda cell: (len(cell), cell))
    if part is None and len(known) > 1:
        raise ValueError(f"has receptors of parts {', '.join(known)}; give one of them as part")
    if part is not None and str(part) not in known:
        raise ValueError(f"has no receptors of part {part}, but of {', '.join(known) or 'none'}")
    wanted = str(part) if part is not None else "".join(known)
    kept = [row for row, cell in enumerate(parts) if cell and cell == wanted]
    return {name: [column[row] for row in kept] for name, column in columns.items()}


def _table_of(columns: Mapping[str, Any], scale: float) -> ReceptorTable:
    """The receptors that named columns describe; `scale` is metres per unit of length."""
    if missing := [name for name in _PLACE if name not in columns]:
        known = ", ".join(name for name in columns if name != "row") or "none"
        raise ValueError(f"has no column {', '.join(missing)}, but {known}; name them x, y, z")
    numbers = {name: np.array(columns[name], float) for name in _USUAL if name in columns}
    normal = None
    if all(name in numbers for name in _NORMAL):
        normal = np.stack([numbers[name] for name in _NORMAL], axis=1)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    group = None
    if "group" in columns:
        _, group = np.unique(columns["group"], return_inverse=True)
    return ReceptorTable(
        p_LS=scale * np.stack([numbers[name] for name in _PLACE], axis=1),
        normal=normal,
        width=scale * numbers["width"] if "width" in numbers else None,
        group=group,
        label=_labels(columns),
    )


def _labels(columns: Mapping[str, Any]) -> list[str]:
    """How errors call each receptor: by its row, and by its name if there are names."""
    rows = [str(row) for row in columns.get("row", range(len(columns["x"])))]
    if "name" not in columns:
        return rows
    return [f"{row} ({name})" for row, name in zip(rows, columns["name"], strict=True)]


def _check(table: ReceptorTable) -> None:
    """Raises a ValueError if receptors cannot be where, or as wide as, a file says."""
    finite = np.isfinite(table.p_LS).all(axis=1)
    if not finite.all():
        wrong = table.those(np.flatnonzero(~finite))
        raise ValueError(f"has a place that is not finite in {wrong}; correct it")
    if table.width is not None and not (table.width > 0).all():
        wrong = table.those(np.flatnonzero(~(table.width > 0)))
        raise ValueError(f"has a width that is not above 0 in {wrong}; correct it")
    if len(table.p_LS) < _FEWEST:
        raise ValueError(f"has {len(table.p_LS)} receptors; give at least {_FEWEST}")
    # Imported here, because commands that only list experiments do not need it.
    from scipy.spatial import cKDTree

    if doubled := sorted(cKDTree(table.p_LS).query_pairs(_SAME)):
        more = f" and {len(doubled) - 1} more such pairs" if len(doubled) > 1 else ""
        both = table.those(doubled[0])
        raise ValueError(f"has {both} at one place{more}; leave one of them out")


def _from_text(path: Path) -> Mapping[str, Any]:
    """Columns of a table in text, with the number of the line of each row as `row`."""
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    start = lines.index(_YARP) + 1 if _YARP in lines else 0
    rows = _rows_of(lines, path.suffix, start)
    if start:
        rows = _taxels_of_yarp(rows)
    first = next(iter(rows), 0)
    names = rows.get(first, [])
    if _is_number(names):
        names = _USUAL[: len(names)] if len(names) in (3, 6, 7) else []
    else:
        rows.pop(first, None)
    for number, row in rows.items():
        if names and len(row) != len(names):
            raise ValueError(f"has {len(row)} columns in row {number}, but {len(names)} names")
    return {"row": list(rows)} | dict(zip(names, zip(*rows.values(), strict=True), strict=False))


def _rows_of(lines: Sequence[str], suffix: str, start: int) -> dict[int, list[str]]:
    """The cells of each line after the first `start`, by its number; comments are left out."""
    split = csv.reader(lines) if suffix == ".csv" else map(str.split, lines)
    rows = {}
    for number, row in enumerate(split, 1):
        if number > start and any(row) and not row[0].startswith("#"):
            rows[number] = [cell.strip() for cell in row]
    return rows


def _taxels_of_yarp(rows: Mapping[int, Sequence[str]]) -> dict[int, list[str]]:
    """The places in the rows of a file of YARP: rows of zeros stand for no taxel."""
    places = {number: list(row[:3]) for number, row in rows.items()}
    return {
        number: place
        for number, place in places.items()
        if any(float(coordinate) for coordinate in place)
    }


def _is_number(row: Sequence[str]) -> bool:
    """Whether the first cell of a row begins as a number does."""
    return bool(row) and row[0].lstrip("+-.")[:1].isdigit()


def _from_npz(path: Path) -> Mapping[str, Any]:
    """Columns of an archive; `positions` and `normals` are three each."""
    if not is_zipfile(path):
        raise ValueError("is no archive of arrays; save it by numpy.savez")
    columns = dict[str, Any]()
    with np.load(path) as arrays:
        for key, array in arrays.items():
            names = _ARRAYS.get(key)
            columns |= {key: array} if names is None else dict(zip(names, array.T, strict=True))
    return columns


def _from_pcd(path: Path) -> Mapping[str, Any]:
    """Columns of a point cloud, one for each of its fields."""
    head, _, rest = path.read_bytes().partition(b"\nDATA ")
    how, _, body = rest.partition(b"\n")
    entries = (line.split() for line in head.decode("ascii", "replace").splitlines())
    header = {entry[0]: entry[1:] for entry in entries if entry}
    kinds = zip(header["FIELDS"], header["TYPE"], header["SIZE"], strict=True)
    types = np.dtype([(_CLOUD.get(name, name), _TYPES[kind] + size) for name, kind, size in kinds])
    if how.strip() == b"ascii":
        points = np.loadtxt(body.decode("ascii").splitlines(), types, ndmin=1)
    elif how.strip() == b"binary":
        points = np.frombuffer(body, types, int(header["POINTS"][0]))
    else:
        raise ValueError(f"is {how.decode('ascii', 'replace')!r}; save it as ascii or binary")
    return {name: points[name] for name in types.names or ()}


_READERS = {".csv": _from_text, ".txt": _from_text, ".npz": _from_npz, ".pcd": _from_pcd}
