"""The experience as a learner reads it: in batches, checked, by this process or by many.

What is computed from a block of rows depends on these rows alone and not on where it is computed.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.representation.reservoir import Draw, KernelReservoir
from selftouch_drake.quotient.checks import checked_experience

# Rows per block: bounds the memory.
_BLOCK = 16_384

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
    first_row = draw.first_row
    sensations, configurations = batch.read()
    if check:
        sensations, configurations = checked_experience(sensations, configurations, first_row)
    made = []
    for sensation, q in _in_blocks(sensations, configurations):
        made.append(work(replace(draw, first_row=first_row), (sensation, q)))
        first_row += len(q)
    return made


def checked(batches: Iterable[Any]) -> Iterator[Any]:
    """The same batches; arrays are checked, what is stored is when it is read."""
    row, widths = 0, dict[str, int]()
    for batch in batches:
        if isinstance(batch, tuple):
            batch = sensation, q = checked_experience(batch[0], batch[1], row)
            for name, what, array in (("sensation", "receptors", sensation), ("q", "joints", q)):
                width = widths.setdefault(name, array.shape[1])
                if array.shape[1] != width:
                    raise ValueError(
                        f"{name} row {row} has {array.shape[1]} {what}, earlier rows have {width}: "
                        "give experience of one robot"
                    )
            row += len(q)
        yield batch


def _in_blocks(sensation: np.ndarray, q: np.ndarray) -> Iterator[Batch]:
    """The same rows in blocks of at most `_BLOCK`."""
    for start in range(0, len(sensation), _BLOCK):
        block = slice(start, start + _BLOCK)
        yield np.asarray(sensation)[block], np.asarray(q)[block]
