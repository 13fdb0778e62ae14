"""Dates and times of a day as people and programs write them."""

import re
from collections.abc import Sequence

import numpy as np

_ZONE = re.compile(r"\s*(?:Z|UTC|GMT|([+-])(\d{2}):?(\d{2}))$")
_HALF_OF_DAY = re.compile(r"\s*([AaPp])\.?[Mm]\.?$")
# The year last, with day and month before it in either order.
_YEAR_LAST = re.compile(r"^(\d{1,2})[-/.](\d{1,2})[-/.](\d{4})")
_COMPACT = re.compile(r"^(\d{4})(\d{2})(\d{2})[T _-]?(\d{2})(\d{2})(\d{2})(?:[.,_]?(\d+))?$")
# Dashes everywhere, as in names of files.
_DASHES = re.compile(r"^(\d{4}-\d{2}-\d{2})[-_ T](\d{2})-(\d{2})-(\d{2})(?:[-.,](\d+))?$")


def counted(dates: np.ndarray) -> tuple[np.ndarray, int]:
    """`(n,)` ns from the first date that is there, as floats, NaN if missing; and that date."""
    there = ~np.isnat(dates)
    counts = np.full(len(dates), np.nan)
    if not there.any():
        return counts, 0
    first = dates[there][0]
    counts[there] = (dates[there] - first).astype(np.int64)
    return counts, int(first.astype(np.int64))


def written_dates(words: np.ndarray) -> tuple[np.ndarray, int] | None:
    """`(n,)` ns from the first of some dates or times of a day, NaN if missing; and that date.

    Of day and month before the year, the first is the day where it can be none else, or where the
    recording is shorter so. None if these are no dates.
    """
    texts = [" ".join(word.split()) for word in words.tolist()]
    if not any(re.match(r"\d{1,4}[-/.:]\d|\d{8}", text) for text in texts if text):
        return None
    found = [_parsed(texts, day_first=day_first) for day_first in (True, False)]
    there = [one for one in found if one is not None]
    return min(there, key=lambda one: float(np.ptp(one[0][np.isfinite(one[0])]))) if there else None


def _parsed(texts: Sequence[str], *, day_first: bool) -> tuple[np.ndarray, int] | None:
    """As of `written_dates`, with day and month in one order; None if one is no date."""
    try:
        dates = np.array(
            [_standard(text, day_first=day_first) if text else "NaT" for text in texts],
            dtype="datetime64[ns]",
        )
    except ValueError:
        return None
    later = np.array([_later_s(text) for text in texts], dtype="timedelta64[s]")
    counts, first = counted(dates + later)
    return (counts, first) if np.isfinite(counts).any() else None


def _later_s(text: str) -> int:
    """Seconds by which a date is later than it reads: by its zone, and in the afternoon."""
    later = 0
    zone = _ZONE.search(text)
    if zone and zone[1]:
        seconds = 3600 * int(zone[2]) + 60 * int(zone[3])
        later -= seconds if zone[1] == "+" else -seconds
    half = _HALF_OF_DAY.search(text)
    if half:
        hour = re.search(r"(\d{1,2}):\d{2}", text)
        at_twelve = hour is not None and int(hour[1]) == 12
        afternoon = half[1].lower() == "p"
        later += 43_200 * (int(afternoon) - int(at_twelve))
    return later


def _standard(text: str, *, day_first: bool) -> str:
    """A date in the form that numpy reads, without its zone.

    Raises:
        ValueError: it has another form.
    """
    text = _HALF_OF_DAY.sub("", text) if _HALF_OF_DAY.search(text) else text
    if re.search(r":\d{2}", text) or text.endswith("Z"):
        text = _ZONE.sub("", text)
    if compact := _COMPACT.match(text):
        year, month, day, hour, minute, second, rest = compact.groups()
        return f"{year}-{month}-{day}T{hour}:{minute}:{second}.{rest or 0}"
    if dashes := _DASHES.match(text):
        day, hour, minute, second, rest = dashes.groups()
        return f"{day}T{hour}:{minute}:{second}.{rest or 0}"
    if last := _YEAR_LAST.match(text):
        day, month = (last[1], last[2]) if day_first else (last[2], last[1])
        text = f"{last[3]}-{int(month):02}-{int(day):02}{text[last.end() :]}"
    text = text.replace(",", ".").replace("/", "-")
    if clock := re.match(r"(\d{1,2}):(\d{2}.*)", text):
        return f"1970-01-01T{int(clock[1]):02}:{clock[2]}"
    if clock := re.match(r"(\d{4}-\d{2}-\d{2})[ T_](\d):(.*)", text):
        return f"{clock[1]}T0{clock[2]}:{clock[3]}"
    return text
