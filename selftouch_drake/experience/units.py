"""Units that the names of columns state, as in `q_0 [deg]`, `time_ms` or `stamp (us)`."""

import re
from dataclasses import dataclass

import numpy as np

#: Unit as it is written: the unit that values are turned to, and the factor.
UNITS = {
    **dict.fromkeys(("deg", "degree", "degrees", "°"), ("rad", np.pi / 180)),
    **dict.fromkeys(("rad", "radian", "radians"), ("rad", 1.0)),
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), ("m", 1.0)),
    "cm": ("m", 1e-2),
    "mm": ("m", 1e-3),
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), ("s", 1.0)),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "milliseconds"), ("s", 1e-3)),
    **dict.fromkeys(("us", "µs", "usec", "usecs", "micros", "microseconds"), ("s", 1e-6)),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanoseconds"), ("s", 1e-9)),
    **dict.fromkeys(("rad/s", "deg/s", "°/s", "m/s", "mm/s"), ("velocity", 1.0)),
    **dict.fromkeys(("nm", "n*m", "n·m", "ma"), ("effort", 1.0)),
}
# In brackets any unit counts; behind an underscore, those that are no usual end of a name.
_BRACKETS = re.compile(r"^(.*?)[\s_]*[\[(]\s*([^\[\]()]+?)\s*[\])]\s*$")
_ENDING = re.compile(r"^(.*?)[_. -](deg|degrees|rad|ms|msec|us|usec|ns|nsec|nanos|sec|s|mm)$", re.I)


@dataclass(frozen=True, slots=True, kw_only=True)
class Named:
    """The name of a column and the unit in it.

    Attributes:
        bare: the name without the unit.
        unit: as it is written, in small letters; empty if none is stated.
    """

    bare: str
    unit: str

    @property
    def kind(self) -> str:
        """What values are turned to: rad, m, s, velocity, effort; empty if that is not known."""
        return UNITS.get(self.unit, ("", 1.0))[0]

    @property
    def factor(self) -> float:
        """By which values are multiplied to be in `kind`."""
        return UNITS.get(self.unit, ("", 1.0))[1]


def named(column: str) -> Named:
    """Splits the name of a column into name and unit."""
    if (found := _BRACKETS.match(column)) and found[1] and not re.search(r"\d", found[2]):
        return Named(bare=found[1], unit=found[2].lower())
    if (found := _ENDING.match(column)) and found[1]:
        return Named(bare=found[1], unit=found[2].lower())
    return Named(bare=column, unit="")


def plain_form(column: str) -> str:
    """A name in the form in which usual names are compared: `Q [3]` and `q_3` are equal.

    Single letters stay as they are: `T` is rarely the time.
    """
    bare = named(column).bare
    form = re.sub(r"[\s.\-\[\]()/:]+", "_", bare).strip("_")
    return form if len(form) == 1 else form.lower()
