"""The paths of what touches, over the skins that it slides on."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from selftouch_drake.show.skins import moved


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkinPath:
    """Where one thing that touches is along a motion, seen from the skin that it slides on.

    In the frame of the skin's link, so that a body that moves stands still.

    Attributes:
        toucher: its name.
        skin: number of the skin.
        points: `(n, 3)` m, one after another.
        rows: `(n,)` the instants of the motion, rising.
    """

    toucher: str
    skin: int
    points: np.ndarray
    rows: np.ndarray

    def moved(self, pose: np.ndarray) -> SkinPath:
        """The same path with its frame put at a pose `(3, 4)`."""
        return dataclasses.replace(self, points=moved(self.points, pose))

    def stretches(self) -> list[np.ndarray]:
        """The points `(m, 3)` of each stretch without a break; at a break it touches elsewhere."""
        return np.split(self.points, np.flatnonzero(np.diff(self.rows) > 1) + 1)

    def at(self, row: int) -> np.ndarray | None:
        """`(3,)` m, where it is at an instant; None if it is on another skin."""
        found = np.flatnonzero(self.rows == row)
        return self.points[found[0]] if len(found) else None


def evenly_spaced(path: np.ndarray, spacing: float) -> np.ndarray:
    """`(N, 3)` points along a polyline `(T, 3)`, `spacing` apart, both in metres."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0.0, length[-1], 2 + int(length[-1] / spacing))
    return np.stack([np.interp(at, length, axis) for axis in path.T], axis=1)
