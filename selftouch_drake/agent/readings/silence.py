"""Receptors that feel nothing in a part of a recording, as of a board that was off (naive)."""

from dataclasses import dataclass

import numpy as np

# Parts of equal numbers of touches, and how many of them a board must be there, and be off.
_PARTS, _LEAST = 10, 3
# Touches, at least, that a receptor would have felt while it was off.
_EXPECTED = 10.0
# Receptors, at least, that are off together, in number and as a share of those that feel anything.
_TOGETHER, _SHARE = 4, 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Silence:
    """Receptors that feel nothing from some touch on, or until some touch.

    Attributes:
        receptors: `(S,)` bool.
        share: of the touches, in which they feel nothing.
        at_end: whether these are the last touches, or the first.
    """

    receptors: np.ndarray
    share: float
    at_end: bool


def silence(sensation: np.ndarray) -> Silence | None:
    """The receptors that are off for at least three tenths of `(T, S)` touches, if they are many.

    One receptor may be left alone by chance; a tenth of a skin that was felt all the time is not.
    """
    parts = np.array_split(sensation > 0, _PARTS)
    counts = np.array([part.sum(axis=0) for part in parts])
    num_alive = np.count_nonzero(counts.sum(axis=0))
    best: Silence | None = None
    for at_end in (True, False):
        along = counts if at_end else counts[::-1]
        for num_there in range(_LEAST, _PARTS - _LEAST + 1):
            there, off = along[:num_there], along[num_there:]
            expected = there.mean(axis=0) * len(off)
            found = (there > 0).all(axis=0) & (off == 0).all(axis=0) & (expected >= _EXPECTED)
            if best is None or found.sum() > best.receptors.sum():
                best = Silence(receptors=found, share=len(off) / _PARTS, at_end=at_end)
    assert best is not None
    return best if best.receptors.sum() >= max(_TOGETHER, _SHARE * num_alive) else None
