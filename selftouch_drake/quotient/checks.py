"""Checks of the experience (M, S): is it as a skin can feel it (paper, section III)?

"The motor configurations that led to non-null sensation are stored (the sensation signal being null
when no finger touches the body)."
"""

from typing import Any

import numpy as np

from .sensations import strength

#: The text of an error.
NO_ROWS = "sensation has 0 rows: babble until the finger touches the body"


def checked_experience(sensation: Any, q: Any, first_row: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """`(n, S)` N sensations and `(n, J)` motor configurations as arrays, of rows from a first on.

    Raises:
        ValueError: they do not have these shapes, do not belong together, or hold what no skin can
            feel.
    """
    sensation, q = as_numbers("sensation", sensation), as_numbers("q", q)
    check_sensation(sensation, first_row)
    if q.ndim != 2 or q.shape[1] == 0:
        raise ValueError(f"q has shape {q.shape}: give motor configurations as (rows, joints)")
    if len(q) != len(sensation):
        raise ValueError(
            f"q has {len(q)} rows and sensation {len(sensation)}: give one motor configuration "
            "for each sensation"
        )
    _check_finite("q", np.isfinite(q).all(axis=1), first_row)
    return sensation, q


def require_rows(num_rows: int, num_targets: int) -> None:
    """Rejects experience with fewer rows than targets."""
    if not num_rows:
        raise ValueError(NO_ROWS)
    if num_rows < num_targets:
        raise ValueError(
            f"num_targets is {num_targets}, but there are only {num_rows} "
            "sensations: give a smaller number, or babble longer"
        )


def as_numbers(name: str, rows: Any) -> np.ndarray:
    """The rows as an array; raises a ValueError if they are sparse, or not real numbers."""
    array = np.asarray(rows)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} holds {array.dtype}: give real numbers, not sparse")
    return array


def check_sensation(sensation: np.ndarray, first_row: int = 0) -> None:
    """Rejects sensations that no skin can produce."""
    if sensation.ndim != 2 or sensation.shape[1] == 0:
        raise ValueError(
            f"sensation has shape {sensation.shape}: give sensations as (rows, receptors)"
        )
    felt = strength(sensation).astype(np.float32)
    _check_finite("sensation", np.isfinite(felt), first_row)
    if (lowest := sensation.min(initial=0)) < 0:
        raise ValueError(
            f"sensation holds {lowest:g}, a negative reading: give pressures, without the "
            "receptors' offset"
        )
    if (null := np.flatnonzero(felt == 0)).size:
        raise ValueError(
            f"sensation row {first_row + null[0]} is null: keep only rows that touch "
            f"({null.size} do not)"
        )


def _check_finite(name: str, finite: np.ndarray, first_row: int) -> None:
    if (bad := np.flatnonzero(~finite)).size:
        raise ValueError(
            f"{name} row {first_row + bad[0]} holds NaN or infinity: drop such rows ({bad.size})"
        )
