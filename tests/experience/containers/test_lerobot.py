"""Folders in LeRobot's layouts, as pandas and pyarrow write them: episodes are pieces of motion."""

import json
from itertools import pairwise

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from known_recording import NUM_ROWS, RATE_HZ, Good, require_same, said

from selftouch_drake.experience.recording import read_recording

ENDS = (0, 1000, 1700, NUM_ROWS)
MOTORS = ["shoulder_pan.pos", "elbow_flex.pos", "wrist.pos", "gripper.pos"]


@pytest.fixture(scope="module")
def good():
    return Good()


def scalar(kind):
    return {"dtype": kind, "shape": [1], "names": None}


def frames(good):
    """The rows of all episodes, with times and numbers that begin again in each."""
    made = []
    for episode, (first, end) in enumerate(pairwise(ENDS)):
        number = np.arange(end - first)
        made.append(
            pd.DataFrame(
                {
                    "observation.state": list(good.q[first:end].astype(np.float32)),
                    "observation.tactile": list(good.force[first:end].astype(np.float32)),
                    "action": list(good.q[first:end].astype(np.float32) + 1),
                    "timestamp": (number / RATE_HZ).astype(np.float32),
                    "frame_index": number,
                    "episode_index": episode,
                    "index": np.arange(first, end),
                    "task_index": 0,
                    "next.done": number == number[-1],
                }
            )
        )
    return made


def described(folder, version, names, **others):
    """LeRobot's description, as its documentation and published sets have it."""
    (folder / "meta" / "episodes" / "chunk-000").mkdir(parents=True)
    features = {
        "observation.state": {"dtype": "float32", "shape": [4], "names": names},
        "observation.tactile": {"dtype": "float32", "shape": [40], "names": ["taxel"]},
        "observation.images.top": {"dtype": "video", "shape": [3, 480, 640], "names": None},
        "timestamp": scalar("float32"),
        "episode_index": scalar("int64"),
    }
    info = {"codebase_version": version, "fps": 50, "features": features} | others
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    # Tables about the episodes are no rows of them.
    table = pa.table({"episode_index": [0, 1, 2], "length": np.diff(ENDS)})
    pq.write_table(table, folder / "meta" / "episodes" / "chunk-000" / "file-000.parquet")


def version_2(folder, good):
    described(folder, "v2.1", {"motors": MOTORS})
    data = folder / "data" / "chunk-000"
    data.mkdir(parents=True)
    for episode, table in enumerate(frames(good)):
        table.to_parquet(data / f"episode_{episode:06d}.parquet", index=False)


def version_2_of_old(folder, good):
    """The first tables of version 2.0 were described by shapes, and lay side by side."""
    described(folder, "v2.0", None)
    info = {"codebase_version": "v2.0", "keys": ["action"], "shapes": {"action": 4}, "fps": 50}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    (folder / "data").mkdir()
    for episode, table in enumerate(frames(good)):
        table.to_parquet(folder / "data" / f"train-{episode:05d}-of-00003.parquet", index=False)


def version_3(folder, good):
    """Several episodes in a file, with pictures beside them."""
    described(folder, "v3.0", MOTORS)
    data = folder / "data" / "chunk-000"
    data.mkdir(parents=True)
    first, second, third = frames(good)
    for number, tables in enumerate(([first, second], [third])):
        table = pa.Table.from_pandas(pd.concat(tables), preserve_index=False)
        pictures = pa.array([{"bytes": b"png", "path": "a.png"}] * len(table))
        table = table.append_column("observation.image", pictures)
        pq.write_table(table, data / f"file-{number:03d}.parquet")


@pytest.mark.parametrize("layout", [version_2, version_2_of_old, version_3])
def test_layouts_of_lerobot_hold_the_same(layout, good, tmp_path):
    layout(tmp_path / "set", good)
    data = require_same(good, tmp_path / "set")
    assert np.flatnonzero(np.diff(data.recording.piece)).tolist() == [999, 1699]
    expected = tuple(MOTORS) if layout is not version_2_of_old else data.recording.joints
    assert data.recording.joints == expected
    assert "50 Hz, from column timestamp; 3 pieces of motion" in said(data)
    assert ("observation.image" in data.recording.unused) == (layout is version_3)
    assert read_recording(tmp_path / "set", rows=["episode_index=1"]).num_rows == 700


def test_states_of_a_base_or_a_hand_are_seen(good, tmp_path):
    """A mobile robot's velocities are no joints, and the pose of a hand is none either."""
    described(tmp_path, "v3.0", ["arm.pos", "wrist.pos", "x.vel", "theta.vel"])
    (tmp_path / "data").mkdir()
    pd.concat(frames(good)).to_parquet(tmp_path / "data" / "file-000.parquet")
    data = read_recording(tmp_path)
    assert data.joints == ("arm.pos", "wrist.pos")
    assert "x.vel, theta.vel are by their names no joint positions: left out" in data.notes
    info = json.loads((tmp_path / "meta" / "info.json").read_text())
    info["features"]["observation.state"]["names"] = {"motors": ["x", "y", "z", "gripper"]}
    (tmp_path / "meta" / "info.json").write_text(json.dumps(info))
    assert "odd: 3 (x, y, z) are places by their names, not joints" in said(
        require_same(good, tmp_path)
    )
