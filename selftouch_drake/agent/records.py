"""Records of arrays: checked when they are made, and saved as one flat dictionary by name."""

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any, Self, get_origin, get_type_hints

import numpy as np
from scipy.interpolate import BSpline

#: Kinds of numbers, as numpy's letters and as errors call them.
Kind = tuple[str, str]
FINITE: Kind = ("iuf", "finite numbers")
REAL: Kind = ("iuf", "real numbers")  # may be NaN
WHOLE: Kind = ("iu", "whole numbers")
BOOLEANS: Kind = ("b", "booleans")

#: Kinds of numbers of the arrays that do not hold finite numbers.
_KINDS = {
    "embedding": REAL,
    **dict.fromkeys(("in_air", "imagined", "overlap", "mode_joints"), BOOLEANS),
    **dict.fromkeys(("nodes", "links", "modes", "node", "offsets"), WHOLE),
    **dict.fromkeys(("missed", "kernel_mode", "part"), WHOLE),
    **dict.fromkeys(("kernel_offsets", "kernel_row", "edges"), WHOLE),
    # Of a body model, in which what is unknown is NaN.
    **dict.fromkeys(("joint_parent", "joint_kind", "order_group"), WHOLE),
    **dict.fromkeys(("part_link", "toucher_link", "num_touches"), WHOLE),
    **dict.fromkeys(("kernel_part", "kernel_toucher", "receptor_part"), WHOLE),
    **dict.fromkeys(("twists", "twist_sigma", "covariance", "receptor_sigma"), REAL),
    **dict.fromkeys(("kernel_place", "kernel_normal"), REAL),
    **dict.fromkeys(("receptor_place", "receptor_normal"), REAL),
    **dict.fromkeys(("held_out", "inliers", "criterion"), REAL),
    "accepted_by_part": BOOLEANS,
}


class Record:
    """A frozen dataclass of arrays, numbers, texts, tuples of texts, paths and other records.

    Raises:
        ValueError: shapes or kinds of numbers disagree; the text names the first array that does
            not fit.
    """

    __slots__ = ()
    #: Of the names of its arrays in a file.
    prefix = ""

    def to_arrays(self) -> dict[str, np.ndarray]:
        """All fields, and those of the records that it holds.

        A path becomes `path_knots` and `path_control`.
        """
        arrays: dict[str, np.ndarray] = {}
        for field in fields(self):  # type: ignore[arg-type]
            name, value = self.prefix + field.name, getattr(self, field.name)
            if isinstance(value, Record):
                arrays |= value.to_arrays()
            elif isinstance(value, BSpline):
                arrays |= {f"{name}_knots": value.t, f"{name}_control": value.c}
            else:
                arrays[name] = np.asarray(value)
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> Self:
        """Inverse of `to_arrays`; other names are ignored.

        A field with a default may be missing, as in files from before there was such a field.

        Raises:
            ValueError: an array is missing or does not fit the others; the text names it.
        """
        types = get_type_hints(cls)
        names = [
            field.name
            for field in fields(cls)  # type: ignore[arg-type]
            if field.default is MISSING or cls.prefix + field.name in arrays
        ]
        return cls(**{name: _restored(cls.prefix + name, types[name], arrays) for name in names})

    def check_arrays(self, shapes: Mapping[str, tuple[int | None, ...]]) -> None:
        """Checks the shapes, in which None is any length, and the kinds of numbers of fields.

        Raises:
            ValueError: an array does not fit; the text names it.
        """
        for field, shape in shapes.items():
            name, array = self.prefix + field, getattr(self, field)
            sizes = zip(shape, array.shape, strict=False)
            if array.ndim != len(shape) or any(want not in (None, have) for want, have in sizes):
                expected = str(shape).replace("None", "any")
                raise ValueError(f"{name} has shape {array.shape}, expected {expected}")
            kind = _KINDS.get(field, FINITE)
            letters, words = kind
            fits = array.dtype.kind in letters
            if fits and kind == FINITE:
                fits = bool(np.isfinite(array).all())
            if not fits:
                raise ValueError(f"{name} must hold {words}")


def _restored(name: str, kind: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    if get_origin(kind) is tuple:
        found = _restored(name, np.ndarray, arrays)
        if found.ndim != 1 or (found.size and found.dtype.kind != "U"):
            raise ValueError(f"{name} is {found.dtype} {found.shape}, expected texts in a row")
        return tuple(map(str, found))
    if issubclass(kind, Record):
        return kind.from_arrays(arrays)
    if kind is BSpline:
        knots, control = (
            _restored(f"{name}_{part}", np.ndarray, arrays) for part in ("knots", "control")
        )
        fits = knots.ndim == 1 and control.ndim == 2 and len(knots) > len(control) + 1
        if not fits or {knots.dtype.kind, control.dtype.kind} != {"f"}:
            raise ValueError(f"{name}_control does not fit {name}_knots")
        return BSpline(knots, control, len(knots) - len(control) - 1)
    if name not in arrays:
        raise ValueError(f"{name} is missing")
    array = np.asarray(arrays[name])
    if kind is int:
        if array.shape or array.dtype.kind not in "iu" or array < 0:
            raise ValueError(f"{name} is {array.tolist()}, expected a whole number >= 0")
        return int(array)
    return kind(array) if kind in (str, bool) else array
