"""Logs of YARP's data dumper: a folder for each port, as of an iCub."""

import numpy as np
import pytest
from known_recording import Good, require_same, said

from selftouch_drake.experience.recording import read_recording
from selftouch_drake.experience.recording_error import RecordingError

START_S = 1_777_000_000.0


@pytest.fixture(scope="module")
def good():
    return Good()


def dumped(folder, time_s, rows, form="{}", stamp="tx"):
    """As the data dumper writes a port: number of the packet, times, and the bottle."""
    folder.mkdir(parents=True)
    (folder / "info.log").write_text(f"Type: Bottle;\nStamp: {stamp};\n[{START_S}] /port\n")
    lines = []
    for number, (at, row) in enumerate(zip(time_s, rows, strict=True)):
        stamps = f"{START_S + at:.6f}" + (f" {START_S + at + 0.01:.6f}" if "rx" in stamp else "")
        lines.append(f"{number} {stamps} {form.format(' '.join(f'{one:g}' for one in row))}")
    (folder / "data.log").write_text("\n".join([*lines, ""]))


@pytest.mark.parametrize("stamp", ["tx", "tx+rx"])
def test_ports_are_brought_together(stamp, good, tmp_path):
    dumped(tmp_path / "rec" / "left_arm", good.time_s, good.q, "({})", stamp)
    dumped(tmp_path / "rec" / "left_forearm_skin", good.time_s, good.force, stamp=stamp)
    data = require_same(good, tmp_path / "rec")
    assert data.recording.joints[0] == "left_arm[0]"
    assert "left_arm and left_forearm_skin have times of their own" in said(data)


def test_ports_and_times_of_recording_are_chosen(good, tmp_path):
    for number, rows in enumerate((slice(0, 1500), slice(1500, None))):
        ending = f"_{number:05d}" if number else ""
        time_s = good.time_s[rows]
        dumped(tmp_path / f"arm{ending}", time_s, good.q[rows, :2])
        dumped(tmp_path / f"head{ending}", time_s, good.q[rows, 2:])
        dumped(tmp_path / f"skin{ending}", time_s, good.force[rows])
    with pytest.raises(RecordingError, match=r"joints in several places, arm, head: choose by --q"):
        read_recording(tmp_path)
    data = require_same(good, tmp_path, q="arm,head")
    assert np.flatnonzero(np.diff(data.recording.piece)).tolist() == [1499]
    (tmp_path / "skin" / "data.log").write_text("0 1.5 a.ppm\n1 1.6 b.ppm\n")
    with pytest.raises(RecordingError, match=r"lines that are not the number of a packet"):
        read_recording(tmp_path, q="arm,head")
