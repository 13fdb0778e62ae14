"""Bags of ROS 1 and ROS 2, and MCAP files of ROS 2: the numbers of each topic, with its times.

A topic is a column, or several if its messages have several fields of numbers. Joint states are
sorted by the names in each message, because publishers may send some joints, in any order.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from selftouch_drake.experience.containers.contents import Clock, Column, Contents
from selftouch_drake.experience.recording_error import RecordingError

# More numbers in a message than a skin has: a picture.
_PICTURE = 20_000
# Types of messages that are neither joints nor skin.
_OTHERS = re.compile(
    r"(Image|PointCloud2?|LaserScan|TFMessage|CameraInfo|Log|Odometry|MarkerArray|Marker|Imu|Clock"
    r"|Path|OccupancyGrid|Joy|JointTrajectory\w*|DiagnosticArray|ParameterEvent|Twist\w*|NavSatFix"
    r"|Pose\w*|Transform\w*|String|Bool)$"
)
# Fields that hold no measurement.
_NO_FIELDS = ("header", "layout")
_NO_READING = re.compile(
    r"seq|stamp|time|temp|status|count|index|variance|^id$|_id$", re.IGNORECASE
)
_TACTILE = re.compile(r"tactile|touch|taxel|skin|pressure|fsr|contact", re.IGNORECASE)
_COMMANDED = re.compile(r"command|desired|goal|target|setpoint|reference|leader|master", re.I)


def read_bag(path: Path) -> Contents:
    """The topics of a bag: a `.bag` or `.mcap` file, a `.db3` file, or ROS 2's folder of one.

    Raises:
        RecordingError: it is damaged, or rosbags is not installed.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise RecordingError(
            f"{path} needs rosbags to be read: pip install 'selftouch-drake[ros]', or export its "
            "topics as csv"
        ) from None
    topics: dict[str, _Topic] = {}
    unknown: list[str] = []
    try:
        # Bags before ROS 2 Iron do not say what their messages hold.
        usual = get_typestore(Stores.ROS2_HUMBLE)
        with AnyReader([path], default_typestore=usual) as reader:
            for connection in reader.connections:
                kind = connection.msgtype.rpartition("/")[2]
                if connection.msgtype not in reader.typestore.fielddefs:
                    unknown.append(f"{connection.topic} ({connection.msgtype}, unknown)")
                elif not _OTHERS.search(kind):
                    topics.setdefault(connection.topic, _Topic(connection.topic, kind))
            wanted = [one for one in reader.connections if one.topic in topics]
            others = {one.topic for one in reader.connections} - {*topics}
            for connection, time_ns, raw in reader.messages(wanted) if wanted else ():
                topic = topics[connection.topic]
                if not topic.is_picture:
                    topic.add(time_ns, reader.deserialize(raw, connection.msgtype))
    # For truncated, damaged and foreign files, rosbags raises a dozen kinds of errors.
    except Exception as error:
        reason = " ".join(str(error).split())[:200].rstrip(".") or type(error).__name__
        raise RecordingError(
            f"{path} cannot be read as a bag of ROS ({reason}); reindex or convert it, or export "
            "its topics as csv"
        ) from None
    return _contents(topics.values(), [*unknown, *sorted(others)])


class _Topic:
    """The messages of one topic, as they come."""

    def __init__(self, name: str, kind: str) -> None:
        self.name = name
        self.is_joints = kind == "JointState"
        self.is_picture = False
        self._received: list[int] = []
        self._stamps: list[int] = []
        self._messages: list[dict[str, Any]] = []

    def add(self, time_ns: int, message: object) -> None:
        fields: dict[str, Any] = dict(_numbers(message))
        if any(np.size(value) > _PICTURE for value in fields.values()):
            self.is_picture = True
            return
        if self.is_joints:
            fields["name"] = list(getattr(message, "name", ()))
        self._received.append(time_ns)
        self._stamps.append(_stamp_ns(message))
        self._messages.append(fields)

    def __bool__(self) -> bool:
        return bool(self._messages) and not self.is_picture

    @property
    def start_ns(self) -> int:
        return self._received[0]

    @property
    def stamp_start_ns(self) -> int:
        return next((stamp for stamp in self._stamps if stamp), 0)

    def clock(self, origin_ns: int, stamps_from_ns: int) -> Clock:
        """The times of arrival in seconds from an origin, and the stamps from another."""
        stamps = np.array(self._stamps, dtype=np.int64)
        has_stamps = np.count_nonzero(stamps) > 0.99 * len(stamps)
        relative = np.where(stamps > 0, (stamps - stamps_from_ns) * 1e-9, np.nan)
        received = np.array(self._received, dtype=np.int64) - origin_ns
        return Clock(
            name=self.name, time_s=received * 1e-9, stamp_s=relative if has_stamps else None
        )

    def columns(self) -> tuple[dict[str, Column], dict[str, list[str]]]:
        """Columns by name, and the names of the numbers in them."""
        if self.is_joints:
            return self._joints()
        every = list(dict.fromkeys(key for message in self._messages for key in message))
        found: dict[str, Column] = {}
        for key in every:
            rows = [np.ravel(message.get(key, ())) for message in self._messages]
            widths = [len(row) for row in rows]
            width = max(set(widths), key=widths.count)
            if width:
                # A message of another width is cut off, or of another sensor.
                rows = [row if len(row) == width else np.full(width, np.nan) for row in rows]
                alone = len(every) == 1 or key == "data"
                found[self.name if alone else f"{self.name}.{key}"] = np.stack(rows)
        return found, {}

    def _joints(self) -> tuple[dict[str, Column], dict[str, list[str]]]:
        """Joint states in the order of their names; NaN for a joint that a message leaves out."""
        names = list(dict.fromkeys(name for message in self._messages for name in message["name"]))
        if not names:
            width = max(np.size(message.get("position", ())) for message in self._messages)
            names = [f"joint_{number}" for number in range(width)]
        place = {name: number for number, name in enumerate(names)}
        found: dict[str, Column] = {}
        for key in ("position", "velocity", "effort"):
            rows = np.full((len(self._messages), len(names)), np.nan)
            for row, message in enumerate(self._messages):
                values = np.ravel(message.get(key, ()))
                sent = message["name"] or names
                if len(values) == len(sent):
                    rows[row, [place[name] for name in sent]] = values
            if np.isfinite(rows).any():
                found[self.name if key == "position" else f"{self.name}.{key}"] = rows
        return found, {self.name: names}


def _contents(topics: Any, others: Sequence[str]) -> Contents:
    """The columns of all topics that hold numbers, and which of them can be joints and skin."""
    filled = [topic for topic in topics if topic]
    origin = min((topic.start_ns for topic in filled), default=0)
    stamped = [topic.stamp_start_ns for topic in filled if topic.stamp_start_ns]
    stamps_from = min(stamped, default=0)
    by_name: dict[str, Column] = {}
    labels: dict[str, Sequence[str]] = {}
    clocks: dict[str, Clock] = {}
    joints, skin = [], []
    for topic in filled:
        columns, named = topic.columns()
        clock = topic.clock(origin, stamps_from)
        by_name |= columns
        labels |= named
        clocks |= dict.fromkeys(columns, clock)
        if topic.is_joints and topic.name in columns:
            joints.append(topic.name)
        elif not topic.is_joints and not _COMMANDED.search(topic.name):
            skin += _readings_among(columns)
    return Contents(
        by_name=by_name,
        labels=labels,
        clocks=clocks,
        evident={"--q": _evident_joints(joints), "--sensation": _evident_skin(skin)},
        skipped=tuple(others) + tuple(topic.name for topic in topics if not topic),
    )


def _readings_among(columns: Mapping[str, Column]) -> list[str]:
    """The columns of one topic that may be readings: arrays, if it has any, and no counters."""
    named = [name for name in columns if not _NO_READING.search(name.rpartition(".")[2])]
    return [name for name in named if np.shape(columns[name])[1] > 1] or named


def _evident_joints(topics: Sequence[str]) -> list[str]:
    """The one topic of joint states that are measured; several are for the user to choose from."""
    if "/joint_states" in topics:
        return ["/joint_states"]
    return [topic for topic in topics if not _COMMANDED.search(topic)]


def _evident_skin(columns: Sequence[str]) -> list[str]:
    """The columns whose name speaks of touch; without these, the only one there is."""
    tactile = [column for column in columns if _TACTILE.search(column)]
    return tactile or (list(columns) if len(columns) == 1 else [])


def _numbers(message: object, under: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """The numbers of a message by the path of their fields, those of a list of messages joined."""
    fields: Mapping[str, Any] = getattr(message, "__dataclass_fields__", {})
    for name in fields:
        if name.startswith("__") or name in _NO_FIELDS:
            continue
        value = getattr(message, name)
        key = f"{under}{name}"
        if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
            yield key, value
        elif isinstance(value, bool | int | float):
            yield key, np.array([value], dtype=float)
        elif isinstance(value, list) and value and hasattr(value[0], "__dataclass_fields__"):
            inside = [dict(_numbers(one, f"{key}.")) for one in value]
            for path in inside[0]:
                yield path, np.concatenate([np.ravel(one.get(path, ())) for one in inside])
        elif hasattr(value, "__dataclass_fields__"):
            yield from _numbers(value, f"{key}.")


def _stamp_ns(message: object) -> int:
    """The time in the header of a message; 0 if it has none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0 if stamp is None else stamp.sec * 1_000_000_000 + stamp.nanosec
