"""Descriptive names of runs and plans."""

import hashlib
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from selftouch_drake.experiment import Experiment, dump_experiment

# Characters; what is longer is named by a digest.
_LONGEST = 60


def default_path(name: str, changes: Mapping[str, Any]) -> Path:
    """The default run directory of an experiment: `runs/NAME`, plus the changed fields."""
    fields = {field: value for field, value in changes.items() if field != "name"}
    words = [f"{field.rpartition('.')[2]}={value}" for field, value in leaves(fields).items()]
    text = re.sub(r"[^\w.=-]+", "_", "-".join(words))
    return Path("runs") / "-".join(filter(None, (name, _short(text, repr(fields)))))


def free_start(q_start: Iterable[float]) -> str:
    """Names a start at joint positions `(J,)`, rad or m, in the file of a plan."""
    text = ",".join(f"{position:.6g}" for position in q_start)
    return f"q={_short(text, text)}"


def leaves(fields: Any, prefix: str = "") -> dict[str, Any]:
    """The values of a nested mapping, each under its keys joined by dots."""
    if not isinstance(fields, dict):
        return {prefix[:-1]: fields}
    return {
        name: value
        for key, entry in fields.items()
        for name, value in leaves(entry, f"{prefix}{key}.").items()
    }


def fields_of(experiment: Experiment) -> dict[str, Any]:
    """All fields of an experiment by their dotted names."""
    return leaves(yaml.safe_load(dump_experiment(experiment)))


def _short(text: str, content: str) -> str:
    """The text, or a digest of the content if the text is long."""
    return text if len(text) <= _LONGEST else hashlib.sha256(content.encode()).hexdigest()[:12]
