"""Tables as text, as other people's tools write them: CSV, TSV, the files of `numpy.savetxt`.

What is understood: comments and blanks before the header, no header at all, a row of units below
it, commas at the end of a row, decimal commas, lists in cells, UTF-16, gzip, and single rows that
are broken.
"""

import codecs
import csv
import gzip
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from selftouch_drake.experience.recording_error import RecordingError
from selftouch_drake.experience.units import UNITS
from selftouch_drake.experiment import shown

# Those that a text rarely has for another reason come first.
_DELIMITERS = "\t;|, "
# Bytes at the start of a text file that show how it is written.
_HEAD = 262_144
_COMMENTS = ("#", "%")
_NUMBER = r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*"
# With points for decimals, commas may stand between thousands.
_THOUSANDS = r"\s*[-+]?\d{1,3}(,\d{3})+(\.\d*)?\s*"
_DECIMAL_COMMA = r"\s*[-+]?\d+(,\d+)?([eE][-+]?\d+)?\s*"
# A decimal point, in a number or a list of numbers; dates have others.
_POINT = r"(^|[\s\[(,;])[-+]?\d+\.\d"
_DATE = r"\s*\d{2,4}[-/.]\d{1,2}[-/.]\d{1,4}.*|\s*\d{1,2}:\d{2}(:\d{2}.*)?"
# How programs write that a number is missing.
_MISSING = (
    *("", "NaN", "nan", "NAN", "-nan", "-NaN", "NA", "N/A", "n/a", "#N/A", "NULL", "null", "None"),
    *("none", "<NA>", "?", "-", "nan(ind)", "-nan(ind)", "1.#QNAN", "-1.#IND", "1.#IND", "#NAME?"),
)
# Cells that are no number count as missing if they are no more than this share of a column; rows
# with another number of cells are left out likewise. A logger was stopped, or started again.
_FEW = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class TextTable:
    """A table that was read from text.

    Attributes:
        names: of the columns, in the order of the file; a name may come twice.
        columns: `(n,)` each.
        num_broken: number of rows left out because they have another number of cells.
        notes: what was understood that the reader of the summary should know.
    """

    names: tuple[str, ...]
    columns: tuple[pa.ChunkedArray, ...]
    num_broken: int
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Form:
    """How a text is written: delimiter, names of the columns, and the byte where rows begin."""

    delimiter: str
    names: tuple[str, ...]
    start: int
    notes: tuple[str, ...]


def read_text_table(path: Path, delimiter: str | None) -> TextTable:
    """Reads a table; the delimiter is as in `read_recording`.

    Raises:
        RecordingError: the delimiter is more than one character, or rows do not fit the header.
        pa.ArrowException, OSError, EOFError, zlib.error, UnicodeDecodeError: it cannot be read.
    """
    if delimiter is not None and len(delimiter) != 1:
        raise RecordingError(f"--delimiter is {shown(delimiter)}; give one character, such as ;")
    content = _unpacked(path)
    with path.open("rb") if content is None else io.BytesIO(content) as file:
        head = file.read(_HEAD)
        form = _form_of(path, head.decode("utf-8", errors="replace"), delimiter)
        file.seek(form.start)
        source: io.IOBase = file
        if form.delimiter == " ":
            source = io.BytesIO(b"\n".join(b" ".join(line.split()) for line in file))
        table, num_broken = _rows(path, source, form, quotes=b'"' in head)
    columns, notes = _mended(table)
    names = list(form.names)
    if not names[0] and "time" not in names and pa.types.is_timestamp(columns[0].type):
        # pandas writes an index of dates without a name.
        names[0] = "time"
    return TextTable(
        names=tuple(names), columns=tuple(columns), num_broken=num_broken, notes=form.notes + notes
    )


def _unpacked(path: Path) -> bytes | None:
    """The text in UTF-8 of a packed file or one in UTF-16, of a spreadsheet; None for others."""
    with path.open("rb") as file:
        start = file.read(4)
    packed = start.startswith(b"\x1f\x8b")
    content = gzip.decompress(path.read_bytes()) if packed else None
    if start.startswith(b"sep=") or "\N{MINUS SIGN}".encode() in path.read_bytes()[:_HEAD]:
        # What a spreadsheet and a typesetter add.
        content = path.read_bytes().replace("\N{MINUS SIGN}".encode(), b"-")
        return re.sub(rb"^sep=.[\r\n]+", b"", content)
    if (content or start).startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return (content or path.read_bytes()).decode("utf-16").encode()
    return content


def _form_of(path: Path, head: str, delimiter: str | None) -> _Form:
    """How a text is written, from its first lines."""
    lines = head.splitlines(keepends=True)
    first = 0
    while first < len(lines) and (
        _is_blank(lines[first]) or lines[first].lstrip("\ufeff \t").startswith(_COMMENTS)
    ):
        first += 1
    above = _lines_above(lines[first:])
    first += above
    if first == len(lines):
        raise RecordingError(f"{path} has no rows; record some, or leave it out")
    comments = [line.lstrip("\ufeff \t#%") for line in lines[:first] if not _is_blank(line)]
    following = [line for line in lines[first + 1 : first + 20] if not _is_blank(line)]
    top = lines[first].lstrip("\ufeff")
    delimiter = delimiter or _delimiter(top, following)
    cells = _cells(top, delimiter)
    notes: tuple[str, ...] = ()
    if above:
        notes = (f"{path.name} has {above} lines above its header: left out",)
    if _are_names(cells):
        names, rows_from = cells, first + 1
        below = _cells(following[0], delimiter) if following else []
        if units := _units_below(names, below):
            names = units
            rows_from = lines.index(following[0], first + 1) + 1
            following = following[1:]
    else:
        names, rows_from, following = [], first, [lines[first], *following]
        written = _cells(comments[-1], delimiter) if comments else []
        if len(written) == len(cells) and _are_names(written):
            names = written
        elif [cell for cell in cells if cell] == [str(n) for n in range(sum(map(bool, cells)))]:
            # pandas numbers columns that have no name.
            names, rows_from, following = cells, first + 1, following[1:]
        if not any(names):
            names = [f"column_{number}" for number in range(len(cells))]
            note = f"{path.name} has no header: its columns are called column_0, column_1, ..."
            notes = (*notes, note)
    width = len(_cells(following[0], delimiter)) if following else len(names)
    names = [*names, *[""] * (width - len(names))]
    start = len("".join(lines[:rows_from]).encode())
    return _Form(delimiter=delimiter, names=tuple(names), start=start, notes=notes)


def _is_blank(line: str) -> bool:
    """Whether a line is empty, or has empty cells alone, as a spreadsheet writes it."""
    return not line.strip("\ufeff\r\n" + _DELIMITERS)


def _lines_above(lines: Sequence[str]) -> int:
    """How many lines without a sign of comment stand above the header, such as `Robot: iCub`.

    They have less than half as many cells as the rows further down, and no rows among them.
    """
    sample = [(number, line) for number, line in enumerate(lines[:60]) if not _is_blank(line)]
    # Lines with one quotation mark are parts of a cell.
    if len(sample) < 4 or any(line.count('"') % 2 for _, line in sample):
        return 0
    delimiter = _delimiter(sample[-2][1], [sample[-3][1]])
    counts = [sum(map(bool, _cells(line, delimiter))) for _, line in sample]
    usual = counts[-2]
    if usual < 4 or 2 * counts[0] >= usual:
        return 0
    return next(number for (number, _), n in zip(sample, counts, strict=True) if 2 * n >= usual)


def _delimiter(top: str, following: Sequence[str]) -> str:
    """The delimiter of which the first line and the next have equally many, or most of the first.

    A decimal comma has rows with two consistent ones: what is rare in text is the delimiter.
    """

    def count(line: str, of: str) -> int:
        line = re.sub(r'"[^"]*"', "", line.rstrip("\r\n"))
        return len(line.split()) - 1 if of == " " else line.count(of)

    for one in _DELIMITERS:
        if following and 0 < count(top, one) == count(following[0], one):
            return one
    # Equal counts come in the order in which delimiters are usual.
    return max(",;\t| ", key=lambda one: count(top, one))


def _cells(line: str, delimiter: str) -> list[str]:
    """The cells of a line, without blanks and quotes around them."""
    if delimiter == " ":
        line = " ".join(line.split())
    found = next(csv.reader([line.strip("\r\n")], delimiter=delimiter, skipinitialspace=True), [])
    return [cell.strip().strip("'").strip() for cell in found]


def _are_names(cells: Sequence[str]) -> bool:
    """Whether a row holds names: no cell is a number, a list of numbers or a date."""
    number = f"{_NUMBER}|{_DECIMAL_COMMA}|{_DATE}|nan|[\\[({{].*"
    return any(cells) and not any(re.fullmatch(number, cell, re.I) for cell in cells if cell)


def _units_below(names: Sequence[str], below: Sequence[str]) -> list[str] | None:
    """Names with the units of the row below them; None if that is no row of units."""
    bare = [cell.strip("[]() ").lower() for cell in below]
    if len(bare) != len(names) or not _are_names(below) or not any(cell in UNITS for cell in bare):
        return None
    return [
        f"{name} [{unit}]" if unit in UNITS else name
        for name, unit in zip(names, bare, strict=True)
    ]


def _rows(path: Path, source: io.IOBase, form: _Form, *, quotes: bool) -> tuple[pa.Table, int]:
    """The rows below the header, and how many were left out because they are broken."""
    num_broken, wrong = 0, 0

    def left_out(row: pyarrow.csv.InvalidRow) -> str:
        nonlocal num_broken, wrong
        num_broken, wrong = num_broken + 1, row.actual_columns
        return "skip"

    try:
        table = pyarrow.csv.read_csv(
            source,
            read_options=pyarrow.csv.ReadOptions(
                column_names=[str(number) for number in range(len(form.names))]
            ),
            # A cell in quotes may hold an array that was printed over several lines.
            parse_options=pyarrow.csv.ParseOptions(
                delimiter=form.delimiter, newlines_in_values=quotes, invalid_row_handler=left_out
            ),
            convert_options=pyarrow.csv.ConvertOptions(null_values=_MISSING),
        )
    except pa.ArrowInvalid as error:
        if "Empty CSV" in str(error):
            raise RecordingError(f"{path} has no rows; record some, or leave it out") from None
        raise
    if num_broken > max(1, _FEW * (len(table) + num_broken)):
        hint = "decimal commas need another delimiter" if form.delimiter == "," else "correct them"
        raise RecordingError(
            f"{path} has {num_broken:,} rows with another number of cells than its header, as "
            f"{wrong} instead of {len(form.names)}; write it again ({hint})"
        )
    nameless = [
        number
        for number, name in enumerate(form.names)
        if not name and table.column(number).null_count < len(table)
    ]
    if nameless and nameless != [0]:
        raise RecordingError(
            f"{path} has {len(form.names)} cells in a row, but its header names "
            f"{sum(map(bool, form.names))}; name each column"
        )
    return table, num_broken


def _mended(table: pa.Table) -> tuple[list[pa.ChunkedArray], tuple[str, ...]]:
    """The columns, with numbers where text holds decimal commas, or numbers but for a few words.

    Returns:
        The columns, and notes on what was done.
    """
    texts = [column for column in table.columns if pa.types.is_string(column.type)]
    points = any(pa.types.is_floating(column.type) for column in table.columns) or any(
        pc.any(pc.match_substring_regex(column, _POINT)).as_py() for column in texts
    )
    columns, notes = [], []
    for column in table.columns:
        found = _as_numbers(column, commas=not points)
        columns.append(found)
        if found is not column:
            if found.null_count > column.null_count:
                notes.append("words among numbers count as missing")
            if pc.any(pc.match_substring(column, ",")).as_py():
                how = "commas between thousands" if points else "a decimal comma"
                notes.append(f"numbers have {how}")
    return columns, tuple(dict.fromkeys(notes))


def _as_numbers(column: pa.ChunkedArray, *, commas: bool) -> pa.ChunkedArray:
    """Text as numbers, if nearly all cells are numbers; else the column as it is."""
    if not pa.types.is_string(column.type):
        return column
    usual = _DECIMAL_COMMA if commas else f"{_NUMBER}|{_THOUSANDS}"
    fits = pc.match_substring_regex(column, f"^({usual})$")
    num_there = len(column) - column.null_count
    num_fits = pc.sum(pc.cast(fits, pa.int64())).as_py() or 0
    if num_fits < max((1 - _FEW) * num_there, 1):
        return column
    cells = pc.if_else(fits, pc.utf8_trim_whitespace(column), pa.scalar(None, pa.string()))
    return pc.replace_substring(cells, ",", "." if commas else "").cast(pa.float64())
