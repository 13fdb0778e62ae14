"""What another robot recorded: motor configurations and raw readings, row by row."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from selftouch_drake.agent.readings.faults import turned_steps


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """The recording of another robot: n rows of J joints and S receptors.

    Attributes:
        q: `(n, J)` motor configurations, in the robot's units.
        readings: `(n, S)` raw readings, of the type of the file.
        time_s: `(n,)` s, or None if it was not recorded.
        piece: `(n,)` number of the piece of motion (a file or an episode) of each row.
        row: `(n,)` the row of the files, one after the other, that each row comes from.
        num_read: rows in the files, chosen or not, complete or not.
        joints: J names.
        receptors: S names.
        num_rows: rows in the files, of those that were chosen.
        num_incomplete: number of rows left out because a number was missing, NaN or infinite.
        choices: the values of each other column that has few; `rows` can choose by it.
        unused: names of the columns that were not read.
        notes: what was understood, turned into other units, or put in order, in words.
        left_out: why rows were left out, besides incomplete ones, and how many for each reason.
        time_from: what the times are, in words; empty without times.
        num_gaps: number of pauses in time.
        turn: `(J,)` turn after which a joint's reading begins again, in its unit; 0 if it does not.
            None as long as nobody asked.
    """

    q: np.ndarray
    readings: np.ndarray
    time_s: np.ndarray | None
    piece: np.ndarray
    row: np.ndarray
    num_read: int
    joints: tuple[str, ...]
    receptors: tuple[str, ...]
    num_rows: int
    num_incomplete: int
    choices: Mapping[str, tuple[str, ...]]
    unused: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    left_out: Mapping[str, int] = field(default_factory=dict)
    time_from: str = ""
    num_gaps: int = 0
    turn: np.ndarray | None = None

    @property
    def follows(self) -> np.ndarray:
        """`(n - 1,)` bool, whether the next row belongs to the same piece of motion."""
        return np.diff(self.piece) == 0

    def without(self, rows: np.ndarray, reason: str) -> "Recording":
        """The recording without some rows, `(n,)` bool, and the reason."""
        if not rows.any():
            return self
        counts = dict(self.left_out)
        counts[reason] = counts.get(reason, 0) + int(rows.sum())
        kept = ~rows
        return replace(
            self,
            q=self.q[kept],
            readings=self.readings[kept],
            time_s=None if self.time_s is None else self.time_s[kept],
            piece=self.piece[kept],
            row=self.row[kept],
            left_out=counts,
        )

    def speeds(self) -> np.ndarray:
        """`(m, J)` per second, between successive rows of a piece; none without time."""
        dt = np.zeros(max(len(self.q) - 1, 0)) if self.time_s is None else np.diff(self.time_s)
        follows = self.follows & (dt > 0)
        turn = np.zeros(self.q.shape[1]) if self.turn is None else self.turn
        return turned_steps(self.q, turn)[follows] / dt[follows, None]
