"""HDF5 files made by h5py, in the layouts of those who share data of robots."""

import h5py
import numpy as np
import pytest
from known_recording import NUM_ROWS, Good, require_same, said

from selftouch_drake.experience.recording import read_recording
from selftouch_drake.experience.recording_error import RecordingError

HALF = NUM_ROWS // 2


@pytest.fixture(scope="module")
def good():
    return Good()


def flat(file, good):
    file["q"], file["touch"], file["time_s"] = good.q, good.force, good.time_s


def in_groups(file, good):
    """As of ALOHA: measurements and commands in groups, and pictures."""
    file["observations/qpos"] = good.q
    file["observations/qvel"] = np.gradient(good.q, axis=0)
    file["observations/tactile"] = good.force.astype(np.float32)
    file["observations/timestamp"] = good.time_s[:, None]
    file.create_dataset("observations/images/cam", (NUM_ROWS, 120, 200, 3), np.uint8, chunks=True)
    file["action/qpos"] = good.q + 1.0
    file["observations/qpos"].attrs["joint_names"] = ["a", "b", "c", "d"]


def in_demos(file, good):
    """As of robomimic: a group for each episode."""
    for number, rows in enumerate((slice(0, HALF), slice(HALF, None))):
        group = file.create_group(f"data/demo_{9 + number}")
        group["obs/robot0_joint_pos"] = good.q[rows]
        group["obs/touch"] = good.force[rows]
        group["obs/time"] = good.time_s[rows] - good.time_s[rows][0]
        group["actions"] = np.zeros((len(good.q[rows]), 7))
        group.attrs["num_samples"] = len(good.q[rows])


def as_a_table(file, good):
    kind = [("q", float, 4), ("taxels", float, 40), ("timestamp", "i8"), ("note", "S3")]
    table = np.zeros(NUM_ROWS, dtype=kind)
    table["q"], table["taxels"] = good.q, good.force
    table["timestamp"] = (1e9 * good.time_s).round() + 1_777_000_000_000_000_000
    file["log"] = table


def in_arrays_of_any_length(file, good):
    file["q"], file["time"] = good.q, good.time_s
    touch = file.create_dataset("touch", (NUM_ROWS,), dtype=h5py.vlen_dtype(float))
    for number, row in enumerate(good.force):
        touch[number] = row


@pytest.mark.parametrize("layout", [in_arrays_of_any_length, flat, in_groups, in_demos, as_a_table])
def test_layouts_of_hdf5_hold_the_same(layout, good, tmp_path):
    path = tmp_path / "a.hdf5"
    with h5py.File(path, "w") as file:
        layout(file, good)
    data = require_same(good, path)
    pieces = np.unique(data.recording.piece)
    assert len(pieces) == (2 if layout is in_demos else 1)
    if layout is in_groups:
        assert data.recording.joints == ("a", "b", "c", "d")
        assert "observations/images/cam" in data.recording.unused
        assert "not read:" in said(data)


def test_joints_and_skin_with_times_of_their_own_are_brought_together(good, tmp_path):
    often = np.linspace(0, good.time_s[-1], 4 * (NUM_ROWS - 1) + 1)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["joints/position"] = np.column_stack(
            [np.interp(often, good.time_s, column) for column in good.q.T]
        )
        file["joints/time"] = often + 50.0
        file["skin/readings"], file["skin/time"] = good.force, good.time_s + 50.0
    data = require_same(good, tmp_path / "a.h5", q="joints/position")
    assert "joints/time and skin/time have times of their own" in said(data)


def test_matlab_7_3_is_read(good, tmp_path):
    """MATLAB writes HDF5 behind a page of its own, axes the other way round."""
    path = tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, array in (("q", good.q), ("touch", good.force), ("time_s", good.time_s[:, None])):
            file[f"data/{name}"] = array.T
            file[f"data/{name}"].attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512))
    require_same(good, path)


def test_hdf5_that_cannot_be_used_is_refused(good, tmp_path, monkeypatch):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        in_groups(file, good)
        file["robot_b/qpos"] = good.q
    with pytest.raises(
        RecordingError, match=r"several columns that may hold joints, observ.*by --q"
    ):
        read_recording(tmp_path / "a.h5")
    with h5py.File(tmp_path / "d.h5", "w") as file:
        for number in range(2):
            file[f"demo_{number}/touch"] = good.force
            file[f"demo_{number}/q"] = good.q[number:]
    with pytest.raises(RecordingError, match=r"it has touch, episode_index \(not read: q\): give"):
        read_recording(tmp_path / "d.h5")
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file.create_group("df").attrs["pandas_type"] = "frame"
    with pytest.raises(RecordingError, match=r"written by pandas.to_hdf; write it by to_parquet"):
        read_recording(tmp_path / "b.h5")
    (tmp_path / "c.h5").write_bytes((tmp_path / "a.h5").read_bytes()[:3000])
    with pytest.raises(RecordingError, match=r"c.h5 is damaged"):
        read_recording(tmp_path / "c.h5")
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    with pytest.raises(RecordingError, match=r"needs h5py.*pip install 'selftouch-drake\[hdf5\]'"):
        read_recording(tmp_path / "a.h5")
