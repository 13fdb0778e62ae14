"""Bags of ROS 1 and 2 and MCAP, made by rosbags' writers: topics with rates and clocks apart."""

import shutil

import numpy as np
import pytest
from known_recording import NUM_JOINTS, NUM_RECEPTORS, Good, require_same, said
from rosbags import rosbag1, rosbag2, typesys

from selftouch_drake.experience.recording import read_recording
from selftouch_drake.experience.recording_error import RecordingError

NUM_ROWS = 800
START_NS = 1_777_000_000_000_000_000
NAMES = ("shoulder", "elbow", "wrist", "finger")
# A message of someone else's skin: one reading a board has, and what is none.
TACTILE = """
std_msgs/Header header
uint16 sequence
my_skin/Board[] boards
float32 temperature
"""
BOARD = """
string name
int16[] pressure
"""


@pytest.fixture(scope="module")
def good():
    return Good(NUM_ROWS)


class Bag:
    """A bag in the making, of ROS 1 or 2."""

    def __init__(self, path, kind):
        self.two = kind != "bag"
        self.store = typesys.get_typestore(
            typesys.Stores.ROS2_HUMBLE if self.two else typesys.Stores.ROS1_NOETIC
        )
        self.path, self.connections = path, {}
        if self.two:
            plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
            self.writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
        else:
            self.writer = rosbag1.Writer(path)

    def __enter__(self):
        self.writer.open()
        return self

    def __exit__(self, *_):
        self.writer.close()

    def register(self, text, name):
        self.store.register(typesys.get_types_from_msg(text, name))

    def header(self, stamp_ns):
        sec, nanosec = divmod(int(stamp_ns), 1_000_000_000)
        stamp = self.store.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
        first = {} if self.two else {"seq": 0}
        return self.store.types["std_msgs/msg/Header"](**first, stamp=stamp, frame_id="")

    def send(self, topic, kind, at_ns, **fields):
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        message = self.store.types[kind](**fields)
        serialize = self.store.serialize_cdr if self.two else self.store.serialize_ros1
        self.writer.write(self.connections[topic], int(at_ns), serialize(message, kind))

    def joints(self, at_ns, stamp_ns, names, position, topic="/joint_states"):
        none = np.zeros(0)
        self.send(
            topic,
            "sensor_msgs/msg/JointState",
            at_ns,
            header=self.header(stamp_ns),
            name=list(names),
            position=np.ascontiguousarray(position, dtype=float),
            velocity=none,
            effort=none,
        )

    def array(self, at_ns, data, topic="/skin"):
        layout = self.store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        data = np.asarray(data, dtype=np.float64)
        self.send(topic, "std_msgs/msg/Float64MultiArray", at_ns, layout=layout, data=data)


def nanoseconds(time_s):
    return START_NS + (1e9 * np.asarray(time_s)).round().astype(np.int64)


def often(good, times=3):
    """The joints at a higher rate: times and positions, on straight lines between the known."""
    time_s = np.linspace(good.time_s[0], good.time_s[-1], times * (NUM_ROWS - 1) + 1)
    columns = [np.interp(time_s, good.time_s, column) for column in good.q.T]
    return time_s, np.column_stack(columns)


def write(path, kind, good, stamps_apart_s=0.0):
    """Joints three times as often as the skin; the names come in another order half of the time."""
    with Bag(path, kind) as bag:
        for n, (at, row) in enumerate(
            zip(nanoseconds(often(good)[0]), often(good)[1], strict=True)
        ):
            order = list(range(NUM_JOINTS))[:: -1 if n % 2 else 1]
            names = [NAMES[joint] for joint in order]
            # A message arrives later than it was measured.
            stamp = at + int(1e9 * stamps_apart_s)
            bag.joints(at if stamps_apart_s else at + 2_000_000, stamp, names, row[order])
        for at, row in zip(nanoseconds(good.time_s), good.force, strict=True):
            bag.array(at, row)
    return path


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_bags_of_rosbags_writers_hold_the_same(kind, good, tmp_path):
    path = tmp_path / ("a.bag" if kind == "bag" else "walk")
    data = require_same(good, write(path, kind, good, stamps_apart_s=9.0))
    assert data.recording.joints == NAMES
    text = said(data)
    assert "/joint_states and /skin have times of their own: the joints are interpolated" in text
    assert "/skin has no stamps: the times of arrival are used" in text
    assert "15.98 s at 50 Hz, from the times of arrival" in text
    if kind != "bag":
        # The file alone, as it is sent around, or after the page beside it was lost.
        (file,) = path.glob(f"*.{kind}")
        shutil.copy(file, tmp_path / f"b.{kind}")
        require_same(good, tmp_path / f"b.{kind}")
        (path / "metadata.yaml").unlink()
        require_same(good, path)


def test_stamps_of_the_senders_are_used_if_their_clocks_agree(good, tmp_path):
    rng = np.random.default_rng(0)
    for apart in (0.0, 0.8):
        with Bag(tmp_path / f"{apart}", "mcap") as bag:
            bag.register(BOARD, "my_skin/msg/Board")
            bag.register(TACTILE, "my_skin/msg/Tactile")
            messages = []
            for stamp, row in zip(nanoseconds(often(good)[0]), often(good)[1], strict=True):
                messages.append((stamp + 1_000_000, stamp, row, None))
            for stamp, row in zip(nanoseconds(good.time_s), good.force, strict=True):
                late = 0 if apart else int(rng.uniform(0, 0.015) * 1e9)
                messages.append((stamp + 1_000_000 + late, stamp - int(1e9 * apart), None, row))
            board = bag.store.types["my_skin/msg/Board"]
            for at, stamp, q, force in sorted(messages, key=lambda message: message[0]):
                if q is not None:
                    bag.joints(at, stamp, NAMES, q)
                    continue
                halves = np.split((100 * force).round().astype(np.int16), 2)
                bag.send(
                    "/tactile",
                    "my_skin/msg/Tactile",
                    at,
                    header=bag.header(stamp),
                    sequence=at % 60_000,
                    boards=[board(name="a", pressure=half) for half in halves],
                    temperature=30.0,
                )
        data = read_recording(tmp_path / f"{apart}")
        assert len(data.q) == NUM_ROWS
        np.testing.assert_allclose(data.q[:100], good.q[:100], atol=1e-4)
        np.testing.assert_allclose(data.readings[:100], (100 * good.force[:100]).round())
        assert data.receptors[:2] == ("/tactile.boards.pressure[0]", "/tactile.boards.pressure[1]")
        expected = "the times of arrival" if apart else "the stamps of the messages"
        assert data.time_from == expected
        assert any("0.8 s apart" in note for note in data.notes) == bool(apart)


def test_publishers_may_send_some_joints_each_and_boards_may_have_topics_of_their_own(
    good, tmp_path
):
    time_s, q = often(good)
    with Bag(tmp_path / "a.bag", "bag") as bag:
        for n, (at, row) in enumerate(zip(nanoseconds(time_s), q, strict=True)):
            part = slice(0, 3) if n % 3 else slice(3, 4)
            bag.joints(at, at, NAMES[part], row[part])
        for at, row in zip(nanoseconds(good.time_s), good.force, strict=True):
            bag.array(at, row[: NUM_RECEPTORS // 2], "/skin/left")
            bag.array(at + 4_000_000, row[NUM_RECEPTORS // 2 :], "/skin/right")
            bag.joints(at, at, NAMES, 0 * row[:4], "/arm/command")
    data = read_recording(tmp_path / "a.bag")
    assert data.joints == ("finger", *NAMES[:3])
    assert data.receptors[0] == "/skin/left[0]"
    assert data.receptors[-1] == f"/skin/right[{NUM_RECEPTORS // 2 - 1}]"
    # Before the first row, and after the last, some joints are not known.
    assert len(data.q) == NUM_ROWS - 2
    np.testing.assert_allclose(data.readings, good.force[1:-1])
    # The finger was sent at each time of the skin, the others before and after.
    np.testing.assert_allclose(data.q[:, 0], good.q[1:-1, 3], atol=1e-6)
    np.testing.assert_allclose(data.q[:, 1:], good.q[1:-1, :3], atol=0.03)
    assert "/arm/command" in data.unused


def test_topics_are_chosen_where_they_are_not_evident(good, tmp_path):
    with Bag(tmp_path / "walk", "db3") as bag:
        for at, row, force in zip(
            nanoseconds(good.time_s[:200]), good.q[:200], good.force[:200], strict=True
        ):
            bag.joints(at, at, NAMES[:2], row[:2], "/left/joint_states")
            bag.joints(at, at, NAMES[2:], row[2:], "/right/joint_states")
            bag.array(at, force, "/board_1")
            bag.array(at, [1.0, 2.0], "/board_2")
    with pytest.raises(RecordingError, match=r"joints in several places, /left/joint_states, /r"):
        read_recording(tmp_path / "walk")
    both = "/left/joint_states,/right/joint_states"
    with pytest.raises(
        RecordingError, match=r"no column with a usual name for --sensation; it has"
    ):
        read_recording(tmp_path / "walk", q=both)
    data = read_recording(tmp_path / "walk", q=both, sensation="/board_1")
    np.testing.assert_allclose(data.q, good.q[:200])
    np.testing.assert_allclose(data.readings, good.force[:200])
    assert data.joints == NAMES
    with pytest.raises(RecordingError, match="--time is none; joints and skin of"):
        read_recording(tmp_path / "walk", q=both, sensation="/board_1", time="none")


def test_one_message_may_hold_joints_and_skin(good, tmp_path):
    whole = "std_msgs/Header header\nfloat64[4] angles\nfloat32[40] skin\n"
    with Bag(tmp_path / "walk", "mcap") as bag:
        bag.register(whole, "my_skin/msg/Whole")
        rng = np.random.default_rng(0)
        for stamp, row, force in zip(nanoseconds(good.time_s), good.q, good.force, strict=True):
            bag.send(
                "/robot",
                "my_skin/msg/Whole",
                stamp + int(rng.uniform(0, 0.015) * 1e9),
                header=bag.header(stamp),
                angles=row,
                skin=force.astype(np.float32),
            )
    data = require_same(good, tmp_path / "walk", q="/robot.angles")
    assert "50 Hz, from the stamps of the messages" in said(data)
    assert "have times of their own" not in said(data)


def test_bags_in_a_folder_are_pieces_whatever_the_order_of_their_joints(good, tmp_path):
    for number, rows in enumerate((slice(0, 400), slice(400, None))):
        order = slice(None, None, -1 if number else 1)
        with Bag(tmp_path / f"walk_{number}", "db3") as bag:
            for at, q, force in zip(
                nanoseconds(good.time_s[rows]), good.q[rows], good.force[rows], strict=True
            ):
                bag.joints(at, at, NAMES[order], q[order])
                bag.array(at, force)
    data = require_same(good, tmp_path)
    assert data.recording.joints == NAMES
    assert np.flatnonzero(np.diff(data.recording.piece)).tolist() == [399]


def test_bags_that_cannot_be_read_are_refused(good, tmp_path, monkeypatch):
    path = write(tmp_path / "a.bag", "bag", good)
    (tmp_path / "b.bag").write_bytes(path.read_bytes()[:50_000])
    (tmp_path / "c.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(100))
    for name in ("b.bag", "c.mcap"):
        with pytest.raises(RecordingError, match=r"cannot be read as a bag of ROS .*reindex"):
            read_recording(tmp_path / name)
    monkeypatch.setitem(__import__("sys").modules, "rosbags.highlevel", None)
    with pytest.raises(
        RecordingError, match=r"needs rosbags.*pip install 'selftouch-drake\[ros\]'"
    ):
        read_recording(path)
