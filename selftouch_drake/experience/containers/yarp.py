"""Logs of YARP's data dumper, as of an iCub: a folder for each port, with `data.log` in it.

Each line has the number of the packet, the time, twice if both sender and receiver gave one, and
the numbers that the port sent.
"""

import re
from pathlib import Path

import numpy as np

from selftouch_drake.experience.containers.contents import Clock, Contents
from selftouch_drake.experience.recording_error import RecordingError

_TACTILE = re.compile(r"skin|tactile|touch|taxel|comp", re.IGNORECASE)
# Lines of another length are cut off; more than this share of them are another format.
_FEW = 0.01


def is_yarp_log(path: Path) -> bool:
    """Whether a file is a log of the data dumper, which writes two files into a folder."""
    return path.name == "data.log" and path.with_name("info.log").is_file()


def read_yarp(path: Path) -> Contents:
    """What one port sent: a column with the name of its folder.

    Raises:
        RecordingError: it is no log of numbers.
    """
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    rows = [line.translate(str.maketrans("()", "  ")).split() for line in lines if line.strip()]
    widths = [len(row) for row in rows]
    width = max(set(widths), key=widths.count) if widths else 0
    kept = [row for row in rows if len(row) == width]
    info = path.with_name("info.log").read_text(encoding="utf-8", errors="replace")
    num_stamps = 2 if re.search(r"Stamp:.*tx\s*\+\s*rx", info) else 1
    try:
        numbers = np.array(kept, dtype=float).reshape(len(kept), width)
    except ValueError:
        numbers = np.empty((0, 0))
    if numbers.shape[1] <= 1 + num_stamps or len(rows) - len(kept) > max(1, _FEW * len(rows)):
        raise RecordingError(
            f"{path} has lines that are not the number of a packet, a time and numbers; export the "
            "port as csv"
        )
    # The dumper numbers the folders of a port that it writes again.
    port = re.sub(r"_\d{5}$", "", path.parent.name)
    # Both stamps are of one instant; the first is the sender's.
    clock = Clock(name=port, time_s=numbers[:, 1], what=f"the stamps of {port}")
    option = "--sensation" if _TACTILE.search(port) else "--q"
    return Contents(
        by_name={port: numbers[:, 1 + num_stamps :]},
        clocks={port: clock},
        evident={option: [port]},
        num_broken=len(rows) - len(kept),
    )
