"""The experience (M, S): motor configurations that led to non-null sensations (paper, section III).

It may be larger than the memory, so a learner reads it in batches, and checks it. What is computed
from a block of rows depends on these rows alone, and not on where it is computed.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from .reservoir import Draw, KernelReservoir
from .sensations import strength

# Rows per block: bounds the memory.
_BLOCK = 16_384

#: The text of an error.
NO_ROWS = "sensation has 0 rows: babble until the finger touches the body"

#: `(n, S)` sensations in N and `(n, J)` motor configurations in the robot's units.
Batch = tuple[np.ndarray, np.ndarray]

#: Gives the experience from its first row on, each time it is called, in batches of any size. One
#: that is read where it is needed has `num_rows`, and `read()` returns it.
Batches = Callable[[], Iterable[Any]]

#: Calls a function with each item, anywhere, and gives the results in order, as `map` does.
Map = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]


def passed(
    work: Callable[[Draw, Batch], Any],
    reservoir: KernelReservoir,
    batches: Iterable[Any],
    each: Map,
    *,
    check: bool = False,
) -> Iterator[Any]:
    """What `work` makes of each block of the experience, in order, and of the draw for it.

    Batches that are read where they are needed are checked there, if so asked.
    """

    def parts() -> Iterator[tuple[Draw, Any]]:
        first_row = 0
        for batch in batches:
            # Arrays are cut here; what is stored is cut where it is read.
            for part in _in_blocks(*batch) if isinstance(batch, tuple) else (batch,):
                yield reservoir.draw(first_row), part
                first_row += len(part[1]) if isinstance(part, tuple) else part.num_rows

    for made in each(partial(_made, work, check), parts()):
        yield from made


@threadpool_limits.wrap(limits=1, user_api="blas")
def _made(work: Callable[[Draw, Batch], Any], check: bool, part: tuple[Draw, Any]) -> list[Any]:
    """What `work` makes of each block of one part; arrays are one block, checked before."""
    draw, batch = part
    if isinstance(batch, tuple):
        return [work(draw, batch)]
    first_row, rows = draw.first_row, batch.read()
    if check:
        rows = _checked_batch(rows, first_row)
    made = []
    for sensation, q in _in_blocks(*rows):
        made.append(work(replace(draw, first_row=first_row), (sensation, q)))
        first_row += len(q)
    return made


def checked(batches: Iterable[Any]) -> Iterator[Any]:
    """The same batches; arrays are checked, what is stored is when it is read."""
    row, widths = 0, dict[str, int]()
    for batch in batches:
        if isinstance(batch, tuple):
            batch = sensation, q = _checked_batch(batch, row)
            for name, what, array in (("sensation", "receptors", sensation), ("q", "joints", q)):
                width = widths.setdefault(name, array.shape[1])
                if array.shape[1] != width:
                    raise ValueError(
                        f"{name} row {row} has {array.shape[1]} {what}, earlier rows have {width}: "
                        "give experience of one robot"
                    )
            row += len(q)
        yield batch


def _checked_batch(batch: Batch, row: int) -> Batch:
    """The batch as arrays; `row` is its first."""
    sensation, q = map(as_numbers, ("sensation", "q"), batch)
    check_sensation(sensation, row)
    if q.ndim != 2 or q.shape[1] == 0:
        raise ValueError(f"q has shape {q.shape}: give motor configurations as (rows, joints)")
    if len(q) != len(sensation):
        raise ValueError(
            f"q has {len(q)} rows and sensation {len(sensation)}: give one motor configuration "
            "for each sensation"
        )
    _check_finite("q", np.isfinite(q).all(axis=1), row)
    return sensation, q


def _in_blocks(sensation: np.ndarray, q: np.ndarray) -> Iterator[Batch]:
    """The same rows in blocks of at most `_BLOCK`."""
    for start in range(0, len(sensation), _BLOCK):
        block = slice(start, start + _BLOCK)
        yield np.asarray(sensation)[block], np.asarray(q)[block]


def as_numbers(name: str, rows: Any) -> np.ndarray:
    """The rows as an array; raises a ValueError if they are no real numbers, or sparse."""
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
