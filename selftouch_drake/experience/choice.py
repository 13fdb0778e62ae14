"""Which columns of a file hold joints and which hold readings: by option, or by their names."""

import fnmatch
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from selftouch_drake.experience.columns import numbers_in, plain, words_in
from selftouch_drake.experience.containers.contents import Contents
from selftouch_drake.experience.recording_error import RecordingError
from selftouch_drake.experience.units import named, plain_form
from selftouch_drake.experience.usual_names import (
    NAMES_OF,
    NO_POSITION,
    PATTERNS,
    Q_NAMES,
    SENSATION_NAMES,
    at_a_usual_end,
    in_order_of_numbers,
    of_usual_name,
)
from selftouch_drake.experiment import closest, shown

_DEFAULTS = {"--q": Q_NAMES, "--sensation": SENSATION_NAMES}
_OPTIONS = {"--q": "joints", "--sensation": "readings"}
# Words that tell boards of one skin apart.
_SIDES = re.compile(r"(^|_)(left|right|l|r|\d+)(?=_|$)")
_TACTILE = re.compile(r"(^|_)(touch|tactile|taxels?|skin)(_|$)")


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """Which columns and rows of each file a recording is made of, as the user says.

    Attributes:
        q: as in `read_recording`; None for the usual names.
        sensation: likewise.
        time: likewise; "none" for no time.
        time_unit: s, ms, us or ns; None for what name or numbers say.
        rows: conditions, as `COLUMN=VALUE` or `COLUMN=VALUE,VALUE`.
        delimiter: between the columns of text; None for the most frequent one.
        named: names of the numbers in a column, where LeRobot gives any.
    """

    q: str | None
    sensation: str | None
    time: str | None
    time_unit: str | None
    rows: Sequence[str]
    delimiter: str | None
    named: Mapping[str, Sequence[str]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Taken:
    """Columns of numbers that make up one array.

    Attributes:
        option: the option that chooses them.
        names: of the columns.
        parts: `(n, width)` numbers of each.
        labels: the names of all numbers in a row; none as long as nobody asked.
        notes: what was done with them, in words.
    """

    option: str
    names: Sequence[str]
    parts: Sequence[np.ndarray]
    labels: Sequence[str] = ()
    notes: tuple[str, ...] = ()

    def joined(self) -> np.ndarray:
        """`(n, total width)` numbers of all columns."""
        return np.concatenate(self.parts, axis=1)


class Choice:
    """The columns of one file, of which some are chosen."""

    def __init__(self, contents: Contents, source: str, wanted: Wanted) -> None:
        self._contents, self._source, self._wanted = contents, source, wanted
        self._columns = contents.by_name

    def taken(self, option: str, asked: str | None) -> Taken:
        """The columns asked for, or those of the first default name that exists.

        Raises:
            RecordingError: there are none, or they do not belong together.
        """
        names = self.names(option, asked)
        if repeated := [name for name in names if names.count(name) > 1]:
            raise RecordingError(
                f"{option} is {shown(asked)}; it takes {repeated[0]} twice: name each column once"
            )
        if option == "--q":
            self._require_positions(asked, names)
        parts = [self.numbers(name) for name in names]
        for name, part in zip(names, parts, strict=True):
            if not part.size:
                raise RecordingError(f"column {name} of {self._source} is empty; record some rows")
        for name, part in zip(names, parts, strict=True):
            if len(part) != len(parts[0]) and name not in self._contents.clocks:
                raise RecordingError(
                    f"column {name} of {self._source} has {len(part)} rows, but {names[0]} has "
                    f"{len(parts[0])}; {option} takes columns that were recorded together"
                )
        flat = [part.reshape(len(part), -1) for part in parts]
        self._require_one_layout(option, asked, names, flat)
        found = Taken(option=option, names=names, parts=flat)
        return _in_usual_units(found) if option == "--q" else found

    def names(self, option: str, asked: str | None) -> list[str]:
        """The names of the columns asked for, or of those with the first name that exists.

        Raises:
            RecordingError: there are none.
        """
        if asked is None:
            return self._usual(option)
        return [name for entry in asked.split(",") for name in self._matching(option, entry)]

    def labelled(self, taken: Taken) -> Taken:
        """The same with the names of all numbers; joints without what is no position."""
        widths = [part.shape[1] for part in taken.parts]
        found = replace(taken, labels=self._labels(taken.option, taken.names, widths))
        return _positions_alone(found) if taken.option == "--q" else found

    def _require_one_layout(
        self, option: str, asked: str | None, names: Sequence[str], flat: Sequence[np.ndarray]
    ) -> None:
        """Raises a `RecordingError` if columns with numbers in their names hold arrays."""
        several = asked is None and len(names) > 1 and not self._contents.evident.get(option)
        if several and isinstance(self._columns[names[0]], np.ndarray):
            return
        if several and max(part.shape[1] for part in flat) > 1 and re.search(r"\d$", names[0]):
            raise RecordingError(
                f"column {names[0]} of {self._source} holds {flat[0].shape[1]} numbers in a row, "
                f"and so do others of {len(names)}; write decimal points, or name columns by "
                f"{option}"
            )

    def _require_positions(self, asked: str | None, names: Sequence[str]) -> None:
        """Raises a `RecordingError` if a pattern takes what is no position, by its name."""
        if asked is not None and not any(sign in asked for sign in "*?["):
            return
        others = [name for name in names if NO_POSITION.search(name)]
        speeds = [name for name in names if named(name).kind in ("velocity", "effort")]
        if wrong := others or speeds:
            what = f"--q is {shown(asked)}" if asked else f"{self._source} has several columns"
            raise RecordingError(
                f"{what}; it takes {wrong[0]} too, which by its name is no joint position: name "
                "the positions alone, or each column"
            )

    def _usual(self, option: str) -> list[str]:
        """The columns that are evident, or have the first of some default names that exists."""
        evident = list(self._contents.evident.get(option, ()))
        clocks = {id(self._contents.clocks.get(name)): name for name in reversed(evident)}
        if option == "--q" and len(clocks) > 1:
            raise RecordingError(
                f"{self._source} has joints in several places, {', '.join(evident[:6])}: choose by "
                f"--q '{evident[0]}', or several with commas between them"
            )
        defaults = _DEFAULTS[option]
        found = evident or of_usual_name(self._columns, defaults)
        if not found:
            found = at_a_usual_end(self._columns, defaults)
            if len({name.rpartition("/")[0] for name in found}) > 1:
                raise RecordingError(
                    f"{self._source} has several columns that may hold {_OPTIONS[option]}, "
                    f"{', '.join(found[:6])}: choose by {option}"
                )
        found = found or (self._boards() if option == "--sensation" else [])
        if found:
            return found
        raise RecordingError(
            f"{self._source} has no column with a usual name for {option}; it has "
            f"{self._all}: give those that hold {_OPTIONS[option]}, by name or by a pattern such "
            f"as {option} '{PATTERNS[option]}'"
        )

    def _boards(self) -> list[str]:
        """Arrays whose names speak of touch and differ in a side or a number alone."""
        arrays = [
            name
            for name, column in self._columns.items()
            if isinstance(column, np.ndarray)
            and column.ndim > 1
            and column.dtype.kind in "fiub"
            and _TACTILE.search(plain_form(name))
        ]
        forms = {_SIDES.sub("", plain_form(name)) for name in arrays}
        return sorted(arrays, key=in_order_of_numbers) if len(forms) == 1 else []

    def _matching(self, option: str, entry: str) -> list[str]:
        """The column of this name, those from one to another, or those that match a pattern."""
        bare = {named(column).bare: column for column in self._columns}
        if entry in self._columns or entry in bare:
            return [entry if entry in self._columns else bare[entry]]
        within = [name for name in self._columns if name.startswith((f"{entry}.", f"{entry}/"))]
        if within and self._contents.clocks:
            return within
        first, to, last = entry.partition("..")
        if to:
            for end in (first, last):
                self.require(option, end)
            every = list(self._columns)
            return every[every.index(first) : every.index(last) + 1]
        found = fnmatch.filter(self._columns, entry)
        if not found:
            self.require(option, entry)
        return sorted(found, key=in_order_of_numbers)

    def require(self, option: str, asked: str) -> None:
        """Raises a `RecordingError` if there is no such column."""
        if asked not in self._columns:
            hint = closest(asked, self._columns) or f"it has {self._all}"
            raise RecordingError(
                f"{option} is {shown(asked)}; {self._source} has no such column: {hint}"
            )

    @property
    def _all(self) -> str:
        """The names of all columns, as far as a line holds them."""
        names = ", ".join([*self._columns][:20]) + (", ..." if len(self._columns) > 20 else "")
        skipped = ", ".join(self._contents.skipped[:8])
        return (names or "no numbers") + (f" (not read: {skipped})" if skipped else "")

    def single(self, names: Sequence[str], num_rows: int) -> np.ndarray | None:
        """`(n,)` the number in each row of the first of these columns that exists, if any."""
        for name in names:
            if name in self._columns:
                numbers = self.numbers(name)
                if len(numbers) == num_rows:
                    return numbers.reshape(len(numbers), -1)[:, 0].astype(float)
        return None

    def numbers(self, name: str) -> np.ndarray:
        """`(n, ...)` numbers of a column; NaN where one is missing."""
        if name in self._contents.clashing:
            raise RecordingError(
                f"{self._source} has several columns {name} that differ; rename all but one"
            )
        return numbers_in(self._columns[name], f"column {name} of {self._source}")

    def _labels(self, option: str, names: Sequence[str], widths: Sequence[int]) -> tuple[str, ...]:
        """Names of all numbers in some columns."""
        for name in (*(f"{name}_names" for name in names), *NAMES_OF[option]):
            found = self._columns.get(name)
            if not isinstance(found, np.ndarray):
                continue
            if found.dtype.kind == "U" and found.size == sum(widths):
                return tuple(found.ravel().tolist())
        labels: list[str] = []
        for name, width in zip(names, widths, strict=True):
            one_number = width == 1 and len(widths) > 1
            unit = named(name)
            shown_as = unit.bare if unit.kind in ("rad", "m") else name
            given = self._contents.labels.get(name) or self._wanted.named.get(name, ())
            given = given or self._sent_names(name)
            each = [shown_as] if one_number and not given else given
            labels += each if len(each) == width else [f"{name}[{n}]" for n in range(width)]
        return tuple(labels)

    def _sent_names(self, name: str) -> list[str]:
        """The name of a joint that `rostopic echo -p` writes beside its position, if it is one."""
        beside = re.sub(r"^field\.position(?=\d+$)", "field.name", name)
        if beside == name or beside not in self._columns:
            return []
        words = words_in(self._columns[beside])
        if words is None or not len(words):
            return []
        if (words != words[0]).any():
            raise RecordingError(
                f"column {beside} of {self._source} names another joint in some rows; export the "
                "bag again, or give the bag itself"
            )
        return [str(words[0])]

    def meeting(self, conditions: Sequence[str], num_rows: int) -> np.ndarray:
        """`(n,)` bool, the rows that meet all conditions."""
        chosen = np.ones(num_rows, dtype=bool)
        for condition in conditions:
            name, equals, values = condition.partition("=")
            if not equals:
                raise RecordingError(f"--rows is {shown(condition)}; write it as COLUMN=VALUE")
            self.require("--rows", name)
            words = words_in(self._columns[name])
            if words is None or len(words) != num_rows:
                raise RecordingError(
                    f"--rows is {shown(condition)}; column {name} of {self._source} does not hold "
                    "one word or number for each instant: choose by another"
                )
            chosen &= np.isin(words, [plain(value) for value in values.split(",")])
        return chosen

    def choices(self, taken: Collection[str], num_rows: int) -> dict[str, tuple[str, ...]]:
        """The values of all columns that are not taken and have few: words or whole numbers."""
        found = {}
        for name in sorted(set(self._columns) - set(taken)):
            words = words_in(self._columns[name], few=True)
            if words is not None and len(words) == num_rows:
                found[name] = tuple(np.unique(words).tolist())
        return found

    def unused(self, taken: Collection[str]) -> tuple[str, ...]:
        """The columns that are not taken and name nothing, and what is no column."""
        naming = {*NAMES_OF["--q"], *NAMES_OF["--sensation"]}
        found = [
            name
            for name in self._columns
            if name not in taken and name not in naming and not name.endswith("_names")
        ]
        return (*found, *self._contents.skipped)


def _in_usual_units(taken: Taken) -> Taken:
    """Angles in rad and lengths in m, where the names of joints state another unit."""
    parts, notes = [], []
    for name, part in zip(taken.names, taken.parts, strict=True):
        unit = named(name)
        if unit.kind in ("rad", "m") and unit.factor != 1.0:
            notes.append(f"{unit.unit} turned to {unit.kind}")
            part = part * unit.factor
        parts.append(part)
    said = tuple(f"joints: {note}" for note in dict.fromkeys(notes))
    return replace(taken, parts=parts, notes=said)


def _positions_alone(taken: Taken) -> Taken:
    """Joints without the numbers in a row whose names say that they are velocities or efforts."""
    wrong = np.array([bool(NO_POSITION.search(label)) for label in taken.labels])
    in_arrays = max(part.shape[1] for part in taken.parts) > 1
    if not in_arrays or not wrong.any() or wrong.all():
        return taken
    ends = np.cumsum([part.shape[1] for part in taken.parts])[:-1]
    parts = [
        part[:, ~left_out]
        for part, left_out in zip(taken.parts, np.split(wrong, ends), strict=True)
    ]
    names = np.array(taken.labels)[wrong].tolist()
    note = f"{', '.join(names[:4])} are by their names no joint positions: left out"
    return replace(
        taken,
        parts=parts,
        labels=tuple(np.array(taken.labels)[~wrong].tolist()),
        notes=(*taken.notes, note),
    )


def upright(q: Taken, touch: Taken) -> tuple[Taken, Taken]:
    """Arrays with one row for each instant: there are more instants than joints or receptors.

    Only single arrays of different lengths are transposed, one of them or both.
    """
    if len(q.parts) > 1 or len(touch.parts) > 1 or len(q.parts[0]) == len(touch.parts[0]):
        return q, touch
    a, b = q.parts[0], touch.parts[0]
    for rows_q, rows_touch in ((a.T, b), (a, b.T), (a.T, b.T)):
        widest = max(rows_q.shape[1], rows_touch.shape[1])
        if len(rows_q) == len(rows_touch) and len(rows_q) > widest:
            return replace(q, parts=[rows_q]), replace(touch, parts=[rows_touch])
    return q, touch
