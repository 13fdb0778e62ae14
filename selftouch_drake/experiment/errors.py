"""A user's mistakes, each in one line: the field by its full path, its value and the remedy."""

import difflib
import re
import reprlib
from collections.abc import Iterable
from typing import Any

from pydantic import ValidationError

# What to do about each kind of error that pydantic finds.
_REMEDIES = {
    "float_type": "give a finite number",
    "finite_number": "give a finite number",
    "int_type": "give a whole number",
    "string_type": "give a text",
    "bool_type": "give true or false",
    "list_type": "give a list",
    "dict_type": "give a mapping by name",
    "dataclass_type": "give a mapping of its fields",
    "missing": "`selftouch experiments --show cube` is an example",
    "greater_than": "give a number above {gt:g}",
    "greater_than_equal": "give at least {ge:g}",
    "less_than": "give a number below {lt:g}",
    "less_than_equal": "give at most {le:g}",
}


class ExperimentError(ValueError):
    """A user's mistake in an experiment or a sweep: its text names field, value and remedy."""


class Mistake(ValueError):  # noqa: N818 -- becomes an ExperimentError once its path is known
    """A mistake that a check of our own found.

    Attributes:
        at: the field below the settings that were checked, as in `surface.radius`, or empty.
        line: what the user reads; `{path}` stands for the field's full path.
    """

    def __init__(self, at: str, line: str) -> None:
        super().__init__(line)
        self.at, self.line = at, line


def require(valid: bool, at: str, found: object, remedy: str) -> None:
    """Raises a `Mistake` unless `valid`: the field, what was found and what to do."""
    if not valid:
        raise Mistake(at, f"{{path}} is {shown(found)}; {remedy}")


def explained(error: ValidationError, prefix: str = "") -> ExperimentError:
    """The first of the mistakes that pydantic found; `prefix` is the path of what was checked."""
    first: Any = error.errors(include_url=False)[0]
    kind, value, context = first["type"], first["input"], first.get("ctx", {})
    mistake = context.get("error")
    if isinstance(mistake, Mistake):
        path = _field_path(prefix, first["loc"], mistake.at)
        return ExperimentError(mistake.line.replace("{path}", path))
    if kind == "literal_error":
        choices = re.findall("'(.*?)'", context["expected"])
        remedy = closest(str(value), choices) or f"choose one of {', '.join(choices)}"
    else:
        remedy = _REMEDIES.get(kind, first["msg"]).format(**context)
    found = "missing" if kind == "missing" else shown(value)
    path = _field_path(prefix, first["loc"])
    return ExperimentError(f"{path or 'the experiment'} is {found}; {remedy}")


def _field_path(prefix: str, location: tuple[int | str, ...], below: str = "") -> str:
    """The full path of a field that pydantic locates, and of what is `below` it.

    Where a key of a mapping is wrong, pydantic names the key and then `[key]`.
    """
    is_key = location[-1:] == ("[key]",)
    fields = [part for part in location if part != "[key]"]
    if is_key:
        del fields[-1:]
    parts = [prefix, *fields, below]
    path = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in parts if p != "")
    return ("a name in " if is_key else "") + path.removeprefix(".")


def closest(text: str, choices: Iterable[str]) -> str:
    """`did you mean ...?` with the choice most similar to a text; empty if none is similar."""
    found = difflib.get_close_matches(text, list(choices), n=1)
    return f"did you mean {found[0]}?" if found else ""


def shown(value: object) -> str:
    """A value as quoted in errors: on one line, and always short."""
    short = reprlib.Repr()
    short.maxstring = short.maxother = 100
    short.maxlevel = 3
    try:
        text = " ".join(short.repr(value).split())
        return text if len(text) <= 150 else f"{text[:150]}..."
    except ValueError:  # Python does not print numbers with many thousand digits
        return "a number of thousands of digits"
