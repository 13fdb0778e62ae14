"""Checks of the arrays that a dataclass holds."""

from collections.abc import Mapping
from typing import Any

import numpy as np

#: Kinds of numbers, as numpy's letters and as errors call them.
Kind = tuple[str, str]
FINITE: Kind = ("iuf", "finite numbers")
REAL: Kind = ("iuf", "real numbers")  # may be NaN
WHOLE: Kind = ("iu", "whole numbers")
BOOLEANS: Kind = ("b", "booleans")


def check_arrays(
    record: Any,
    shapes: Mapping[str, tuple[int | None, ...]],
    kinds: Mapping[str, Kind] | None = None,
    *,
    prefix: str = "",
) -> None:
    """Checks the shapes, in which None is any length, and the kinds of numbers of some fields.

    Fields without a kind hold finite numbers. Errors begin with the name, after the prefix.

    Raises:
        ValueError: an array does not fit; the text names it.
    """
    for field, shape in shapes.items():
        name, array = prefix + field, getattr(record, field)
        sizes = zip(shape, array.shape, strict=False)
        if array.ndim != len(shape) or any(want not in (None, have) for want, have in sizes):
            expected = str(shape).replace("None", "any")
            raise ValueError(f"{name} has shape {array.shape}, expected {expected}")
        kind = FINITE if kinds is None else kinds.get(field, FINITE)
        letters, words = kind
        fits = array.dtype.kind in letters
        if fits and kind == FINITE:
            fits = bool(np.isfinite(array).all())
        if not fits:
            raise ValueError(f"{name} must hold {words}")
