"""Motions as tables, for controllers and other programs."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from selftouch_drake.agent.motions import Motion
from selftouch_drake.files import write_csv


def write_trajectory(path: Path, motion: Motion, joints: Sequence[str] | None) -> None:
    """Writes a motion as CSV: `time_s`, each joint by name, and its `_velocity`.

    Joints whose names are unknown, as in older runs, have numbers.
    """
    if joints is None:
        joints = [f"joint_{number}" for number in range(motion.q.shape[1])]
    rows = np.hstack([motion.time_s[:, None], motion.q, motion.v])
    names = ["time_s", *joints, *(f"{name}_velocity" for name in joints)]
    write_csv(path, names, ([f"{number:.9g}" for number in row] for row in rows))
