"""`selftouch teach`: readings that come bit by bit, kept whole, looked at, and made a run."""

import itertools
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from commands import refused, selftouch
from made_up import sphere_points, twist
from scipy.spatial.distance import cdist

from selftouch_drake.agent.body_model.twists import exponential
from selftouch_drake.agent.lesson import Step
from selftouch_drake.bodies.own import open_reference
from selftouch_drake.run.directory import RunError
from selftouch_drake.run.streams import Callback, GrowingFile, MovingBody, StreamError
from selftouch_drake.run.teaching import Lesson, columns_of, teach

HERE = Path(__file__).parent
NAMES = ("turn", "lift", "roll", "bend", "twist", "nod")
#: Three hinges at a shoulder beside a ball of skin, an elbow, and two at a wrist.
TWISTS = [
    twist([0, 0, 1], [0.0, -1.6, 0.0]),
    twist([1, 0, 0], [0.0, -1.6, 0.0]),
    twist([0, 1, 0], [0.0, -1.6, 0.0]),
    twist([1, 0, 0], [0.0, -0.6, 0.0]),
    twist([0, 1, 0], [0.0, 0.2, 0.0]),
    twist([1, 0, 0], [0.0, 0.2, 0.0]),
]
TIP = np.array([0.0, 0.6, 0.0, 1.0])
LIMITS = np.array([[-2.0, -1.5, -3.0, -2.5, -3.0, -2.0], [2.0, 1.5, 3.0, 2.5, 3.0, 2.0]])
PLACE, _ = sphere_points(40, radius=0.7)


def tip(q):
    """`(n, 3)` where the fingertip is."""
    X = np.eye(4)
    for one, reading in zip(TWISTS, q.T, strict=True):
        X = X @ exponential(one, reading)
    return (X @ TIP)[:, :3]


def feel(q):
    """`(n, 40)` what the ball of skin feels."""
    at = tip(q)
    away = np.linalg.norm(at, axis=1, keepdims=True)
    pressed = np.maximum(0.0, 0.72 - away) * (away > 0.68)
    on_skin = 0.7 * at / np.maximum(away, 1e-9)
    return 50 * pressed * np.maximum(0.0, 1 - cdist(on_skin, PLACE) / 0.5)


class Person:
    """Moves the arm by hand, and listens: half of the touches follow the steps."""

    joint_names = NAMES

    def __init__(self, seed=0, batch=60):
        self._random, self._batch, self.heard = np.random.default_rng(seed), batch, []

    def read(self, steps):
        self.heard += steps
        q = self._random.uniform(*LIMITS, (200 * self._batch, len(NAMES)))
        force = feel(q)
        wanted = [receptor for step in steps for receptor in step.receptors]
        here = np.flatnonzero(force.any(axis=1))
        first = here[np.argsort(-force[np.ix_(here, wanted)].sum(axis=1), kind="stable")]
        rows = np.r_[first[: self._batch // 4], here[: self._batch // 4], : self._batch]
        rows = self._random.permutation(np.unique(rows))
        return q[rows], force[rows]


def csv_text():
    """What a person's robot writes: some twenty touches among other rows."""
    return Callback(Person(batch=80).read, NAMES).lines([])


def quiet(look):
    pass


def test_a_file_that_grows_loses_nothing(tmp_path):
    path = tmp_path / "log.csv"
    stream = GrowingFile(path)
    assert stream.lines() == b""  # it is not there yet
    path.write_bytes(b"a,b\n1,2\n3,")
    assert stream.lines() == b"a,b\n1,2\n"
    assert stream.lines() == b""  # it lags
    with path.open("ab") as file:
        file.write(b"4\n5,6\n")
    assert stream.lines() == b"3,4\n5,6\n"
    path.write_bytes(b"a,b\n7,8\n")  # begun anew, shorter
    assert stream.lines() == b"7,8\n"
    assert GrowingFile(path, b"a,b\n7,8\n").lines() == b""  # resumed
    assert GrowingFile(path, b"a,b\n1,2\n").lines() == b"7,8\n"  # another recording since
    with pytest.raises(StreamError, match="begins again with other columns; give another --out"):
        GrowingFile(path, b"a,c\n1,2\n").lines()


def test_a_lesson_that_is_stopped_in_a_line_goes_on_with_whole_ones(tmp_path):
    lesson = Lesson(folder=tmp_path)
    lesson.keep(b"a,b\n1,2\n3,")
    assert lesson.stored() == b"a,b\n1,2\n"
    lesson.keep(b"3,4\n")
    assert lesson.readings.read_bytes() == b"a,b\n1,2\n3,4\n"


def test_a_stream_that_stops_lags_and_jumps_is_the_same_as_one_that_does_not(tmp_path):
    log, whole = tmp_path / "log.csv", csv_text()
    pieces = [whole[:7000], b"", whole[7000:7001], whole[7001:]]
    with log.open("wb") as file:
        waits = iter(pieces)

        def wait(seconds):
            file.write(next(waits, b""))
            file.flush()

        looks = []
        lesson = Lesson(folder=tmp_path / "slow", how=columns_of(NAMES), limits=LIMITS, most=30)
        last = teach(
            lesson,
            lambda stored: GrowingFile(log, stored),
            looks.append,
            every_s=0.0,
            patience_s=3.0,
            sleep=wait,
        )
    assert lesson.readings.read_bytes() == whole
    once = Lesson(folder=tmp_path / "once", how=columns_of(NAMES), limits=LIMITS, most=30)
    rows = iter([whole])
    stream = type("Once", (), {"lines": lambda self, steps: next(rows, None)})()
    again = teach(once, lambda stored: stream, quiet)
    assert last.known.felt.tolist() == again.known.felt.tolist()
    assert last.known.num_touches == again.known.num_touches > 5
    assert len(looks) >= 2


def test_a_stopped_lesson_resumes(tmp_path):
    lesson = Lesson(folder=tmp_path, how=columns_of(NAMES), limits=LIMITS)
    person, calls = Person(batch=20), itertools.count()

    def read_twice(steps):
        if next(calls) == 2:
            raise KeyboardInterrupt
        return person.read(steps)

    with pytest.raises(KeyboardInterrupt):
        teach(lesson, lambda stored: Callback(read_twice, NAMES, bool(stored)), quiet)
    before = lesson.readings.read_bytes()
    opened = []

    def ended(stored):
        opened.append(stored)
        return Callback(lambda steps: None, NAMES, bool(stored))

    look = teach(lesson, ended, quiet)
    assert opened == [before]
    assert lesson.readings.read_bytes() == before
    assert look.known.num_touches > 0


def test_two_lessons_do_not_share_a_folder(tmp_path):
    lesson = Lesson(folder=tmp_path)

    def another(stored):
        with pytest.raises(RunError, match="is used by another lesson"):
            teach(lesson, lambda stored: Callback(lambda steps: None, NAMES), quiet)
        return Callback(lambda steps: None, NAMES)

    assert teach(lesson, another, quiet) is None


@pytest.mark.parametrize(
    "rows", [(np.zeros((2, 3)), np.zeros((2, 8))), (np.zeros((2, 6)), np.zeros((3, 8)))]
)
def test_a_callback_with_wrong_shapes_is_refused(rows):
    with pytest.raises(StreamError, match=r"return \(n, 6\) and \(n, receptors\)"):
        Callback(lambda steps: rows, NAMES).lines([])


def test_rows_with_gaps_are_left_out_and_names_keep_their_cells():
    rows = np.array([[1.0, 2.0], [np.nan, 1.0]]), np.ones((2, 4))
    text = Callback(lambda steps: rows, ("left,arm", "b")).lines([])
    assert text == b"left_arm,b,taxel_0,taxel_1,taxel_2,taxel_3\n1,2,1,1,1,1\n"


BODY = """
import numpy as np
from selftouch_drake.agent.body import Felt, Followed


class Mine:
    joint_names, num_receptors, jumps = ("x", "y"), 4, {jumps}
    lower, upper = np.zeros(2), np.ones(2)
    velocity = acceleration = np.ones(2)

    def feel(self, q):
        return Felt(q=q, sensation=np.tile(q, 2), reached=q[:, 0] < 0.9)

    def follow(self, time_s, q):
        return Followed(time_s=time_s, q=q, sensation=np.tile(q, 2))
"""


@pytest.mark.parametrize("jumps", [True, False])
def test_a_body_walks_within_its_limits_and_what_it_did_not_reach_is_left_out(tmp_path, jumps):
    (tmp_path / "mine.py").write_text(BODY.format(jumps=jumps))
    with open_reference(f"{tmp_path / 'mine.py'}:Mine") as body:
        stream = MovingBody(body)
        text = stream.lines([Step(text="", joints=[1])]) + stream.lines([])
    header, *lines = text.decode().splitlines()
    assert header == "x,y,taxel_0,taxel_1,taxel_2,taxel_3"
    q = np.array([line.split(",")[:2] for line in lines], dtype=float)
    assert 50 < len(q) <= 200
    assert q.min() >= 0
    assert q[:, 0].max() < 0.9


def test_a_file_is_followed_by_the_command_and_resumed(tmp_path):
    log, out = tmp_path / "log.csv", tmp_path / "lesson"
    whole = csv_text()
    log.write_bytes(whole[:-20])
    words = ("teach", log, "--out", out, "--q", "turn..nod", "--sensation", "taxel_*", "--wait", 0)
    done = selftouch(*words, "--time", "none")
    assert done.status == 0, done.stderr
    assert "not enough: too few touches to look for a body" in done.stdout
    assert "give the same command again to go on" in done.stdout
    kept = (out / "readings.csv").read_bytes()
    assert kept == whole[: len(kept)]
    assert kept.endswith(b"\n")
    log.write_bytes(whole)
    assert selftouch(*words, "--time", "none").status == 0
    assert (out / "readings.csv").read_bytes() == whole
    assert "<h2>Next</h2>" in (out / "lesson.html").read_text()


def test_what_cannot_be_read_is_refused_and_stays_stored(tmp_path):
    log, out = tmp_path / "log.csv", tmp_path / "lesson"
    log.write_bytes(csv_text())
    words = ("teach", log, "--out", out, "--wait", 0, "--sensation", "taxel_*", "--q", "arm_*")
    done = selftouch(*words)
    assert done.status == 2
    (line,) = done.stderr.strip().splitlines()
    assert "arm_*" in line
    assert (out / "readings.csv").read_bytes() == log.read_bytes()


def test_nothing_that_is_touched_is_a_mistake(tmp_path):
    done = selftouch("teach", tmp_path / "log.csv", "--out", tmp_path / "lesson", "--wait", 0)
    assert done.status == 2
    assert "which is not there yet" in done.stdout
    assert "holds no touch; touch the robot's skin, or give --threshold" in done.stderr


def test_mistakes_are_refused_in_one_line(tmp_path):
    assert refused("teach", "robot.bag") == (
        "SOURCE is 'robot.bag'; give a .csv that grows, or a class as my_robot.py:MyRobot"
    )
    assert refused("teach", "log.csv", "--urdf", "a.stl") == (
        "--urdf is a.stl; end it in .urdf, .sdf or .xml"
    )
    (tmp_path / "mine.py").write_text(BODY.format(jumps=True))
    assert "--q is given, but" in refused("teach", f"{tmp_path / 'mine.py'}:Mine", "--q", "a")


@pytest.mark.slow
def test_a_person_teaches_a_body_from_the_first_touch_to_its_urdf(tmp_path):
    (tmp_path / "person.py").write_text(
        f"import sys\nsys.path[:0] = {[str(HERE.parent), str(HERE)]!r}\n"
        "from test_teaching import Person\n"
    )
    out, urdf = tmp_path / "lesson", tmp_path / "found.urdf"
    done = selftouch(
        "teach", f"{tmp_path / 'person.py'}:Person", "--out", out, "--touches", 600, "--urdf", urdf
    )
    assert done.status == 0, done.stderr
    assert "body accepted" in done.stdout
    assert "next: touch" in done.stdout
    joints = {joint.get("name") for joint in ET.parse(urdf).getroot().iter("joint")}
    assert set(NAMES) <= joints
    page = (out / "lesson.html").read_text()
    assert "<title>Person</title>" in page
    assert "it is enough" in page
    (run,) = out.glob("run_*")
    assert int(run.name.removeprefix("run_")) <= 600
    assert "body model: accepted" in selftouch("model", run).stdout
