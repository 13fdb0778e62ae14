"""Folders in the layout of LeRobot, versions 2 and 3: `meta/info.json` beside tables in `data/`."""

import json
from collections.abc import Iterator
from pathlib import Path

from selftouch_drake.experience.recording_error import RecordingError


def is_lerobot(source: Path) -> bool:
    """Whether a folder has LeRobot's description of its tables."""
    return (source / "meta" / "info.json").is_file()


def lerobot_names(source: Path) -> dict[str, list[str]]:
    """LeRobot's names for the numbers of each column, where it has any.

    Raises:
        RecordingError: the description is damaged.
    """
    file = source / "meta" / "info.json"
    if not is_lerobot(source):
        return {}
    try:
        # The first tables of version 2.0 were described by their shapes alone.
        features = json.loads(file.read_text(encoding="utf-8")).get("features", {})
        names = {name: feature.get("names") for name, feature in features.items()}
    except (ValueError, TypeError, AttributeError, RecursionError):
        raise RecordingError(f"{file} is damaged; write it again") from None
    return {name: list(_words(given)) for name, given in names.items() if given}


def _words(given: object) -> Iterator[str]:
    """The names in a list, in lists in it, or in the lists of a mapping."""
    if isinstance(given, str):
        yield given
    elif isinstance(given, dict | list):
        for one in given.values() if isinstance(given, dict) else given:
            yield from _words(one)
