"""Joints and skin in files of their own, as exports of topics are."""

import numpy as np
import pandas as pd
import pytest
from known_recording import NUM_JOINTS, NUM_RECEPTORS, Good, require_same, said

from selftouch_drake.experience.recording import read_recording
from selftouch_drake.experience.recording_error import RecordingError

NUM_ROWS = 1000
START_NS = 1_777_000_000_000_000_000


@pytest.fixture(scope="module")
def good():
    return Good(NUM_ROWS)


def often(good):
    """Times and joints three times as often, on straight lines."""
    time_s = np.linspace(0, good.time_s[-1], 3 * (NUM_ROWS - 1) + 1)
    return time_s, np.column_stack([np.interp(time_s, good.time_s, one) for one in good.q.T])


def echoed(path, time_s, columns):
    """As `rostopic echo -p` writes a topic: times in ns, and a header that looks like a comment."""
    stamps = START_NS + (1e9 * time_s).round().astype(np.int64)
    table = pd.DataFrame(
        {"%time": stamps, "field.header.seq": np.arange(len(time_s)), "field.header.stamp": stamps}
        | columns
    )
    table.to_csv(path, index=False)


def test_topics_that_rostopic_echoed_are_brought_together(good, tmp_path):
    time_s, q = often(good)
    columns = {f"field.name{n}": np.full(len(q), f"arm_{n}") for n in range(NUM_JOINTS)}
    columns |= {f"field.position{n}": q[:, n] for n in range(NUM_JOINTS)}
    columns |= {f"field.velocity{n}": 0 * q[:, n] for n in range(NUM_JOINTS)}
    echoed(tmp_path / "joint_states.csv", time_s, columns)
    columns = {f"field.data{n}": good.force[:, n] for n in range(NUM_RECEPTORS)}
    echoed(tmp_path / "tactile.csv", good.time_s, columns)
    data = require_same(good, tmp_path)
    assert data.recording.joints == ("arm_0", "arm_1", "arm_2", "arm_3")
    text = said(data)
    assert "joint_states.csv and tactile.csv have times of their own" in text
    assert "at 50 Hz, from column time, ns since 1970" in text


@pytest.mark.parametrize(
    "names", ["take{}/{}.csv", "{}_{}.csv", "{1}-{0}.parquet", "{2}_{1}_{0}.csv"]
)
def test_pieces_are_told_by_their_numbers(names, good, tmp_path):
    for number, rows in enumerate((slice(0, 400), slice(400, None))):
        table = good.table().iloc[rows]
        for kind, others in (("joints", "taxel"), ("skin", "q_")):
            part = table[[name for name in table.columns if not name.startswith(others)]]
            model = "ur5" if kind == "joints" else "xela16"
            path = tmp_path / names.format(number + 9, kind, model)
            path.parent.mkdir(exist_ok=True)
            if path.suffix == ".csv":
                part.to_csv(path, index=False)
            else:
                part.to_parquet(path, index=False)
    data = require_same(good, tmp_path)
    assert np.flatnonzero(np.diff(data.recording.piece)).tolist() == [399]


def test_archives_may_have_times_for_joints_and_others_for_the_skin(good, tmp_path):
    time_s, q = often(good)
    arrays = {"q": q, "q_time": time_s, "touch": good.force, "touch_time": good.time_s}
    np.savez(tmp_path / "a.npz", **arrays)
    require_same(good, tmp_path / "a.npz")
    # As many rows of each, and still not of the same instants.
    late = good.time_s + 1.0
    rows = np.arange(50, NUM_ROWS)
    arrays = {"joint_q": good.q, "joint_time": good.time_s, "touch_time": late - 2.0}
    np.savez(tmp_path / "b.npz", **arrays, touch=np.roll(good.force, -50, axis=0))
    data = read_recording(tmp_path / "b.npz", q="joint_q")
    np.testing.assert_allclose(data.readings[:700], np.roll(good.force, -100, axis=0)[:700])
    np.testing.assert_allclose(data.q[:700], good.q[:700], atol=1e-9)
    assert len(rows) == len(data.q)


def test_files_without_a_shared_clock_are_refused(good, tmp_path):
    table = good.table()
    joints = table[[name for name in table.columns if not name.startswith("taxel")]]
    skin = table[[name for name in table.columns if not name.startswith("q_")]]
    joints.to_csv(tmp_path / "joints.csv", index=False)
    skin.drop(columns="time_s").to_csv(tmp_path / "skin.csv", index=False)
    with pytest.raises(RecordingError, match=r"skin.csv has no times, and joints and skin are in"):
        read_recording(tmp_path)
    skin.assign(time_s=skin["time_s"] + 1000).to_csv(tmp_path / "skin.csv", index=False)
    with pytest.raises(RecordingError, match=r"times of skin.csv and of joints.csv that do not ov"):
        read_recording(tmp_path)
