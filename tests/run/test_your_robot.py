"""The page "Your robot, in an afternoon": all its commands, on a robot that only the test knows."""

import csv
import shlex
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pytest
from commands import selftouch
from fenced import blocks

from selftouch_drake.agent.given_model.taxels import similarity
from selftouch_drake.experiment import load_experiment
from selftouch_drake.export.given_model import read_way
from selftouch_drake.robot import World

PAGE = Path(__file__).parents[2] / "docs" / "your_robot.md"
NUM_TOUCHES = 1000
JOINTS = (
    ("shoulder_yaw", "0 0 0.4", "0 0 1"),
    ("shoulder_pitch", "0 0 0", "0 1 0"),
    ("elbow_pitch", "0.4 0 0", "0 1 0"),
    ("wrist_x", "0.4 0 0", "1 0 0"),
    ("wrist_y", "0 0 0", "0 1 0"),
    ("wrist_z", "0 0 0", "0 0 1"),
)
BODY = """
import numpy as np

from selftouch_drake.agent.body import Felt, Followed
from selftouch_drake.agent.given_model.taxels import similarity
from selftouch_drake.experiment import load_experiment
from selftouch_drake.export.given_model import read_way
from selftouch_drake.robot import World

WORLD = World(load_experiment("torus"))


class MyRobot:
    joint_names = WORLD.robot.joint_names
    lower, upper = WORLD.robot.babbled_range
    velocity, acceleration = np.full(6, 1.0), np.full(6, 5.0)
    num_receptors, jumps = 100, True

    def feel(self, q):
        return Felt(q=q, sensation=WORLD.probe.sensations(q), reached=np.ones(len(q), bool))

    def follow(self, time_s, q):
        return Followed(time_s=time_s, q=q, sensation=WORLD.probe.sensations(q))
"""


def urdf(forearm=0.4):
    """The arm over the torus; its forearm may be inexact."""
    links, joints, before = ["<link name='body'/>"], [], "body"
    for name, start, axis in JOINTS:
        start = start.replace("0.4 0 0", f"{forearm} 0 0") if name == "wrist_x" else start
        links.append(f"<link name='{name}_link'/>")
        joints.append(
            f"<joint name='{name}' type='revolute'><parent link='{before}'/>"
            f"<child link='{name}_link'/><origin xyz='{start}'/><axis xyz='{axis}'/>"
            "<limit lower='-3.2' upper='3.2' effort='9' velocity='1'/></joint>"
        )
        before = f"{name}_link"
    tip = (
        "<link name='fingertip'/><joint name='tip' type='fixed'>"
        f"<parent link='{before}'/><child link='fingertip'/><origin xyz='0.12 0 0'/></joint>"
    )
    return f"<robot name='mine'>\n{''.join(links)}{''.join(joints)}{tip}\n</robot>"


def write_recording(folder, world):
    """Touches, each with a row at rest behind it, as CSV."""
    rng, low, high = np.random.default_rng(0), *world.robot.babbled_range
    rows, felt = [], 0
    while felt < NUM_TOUCHES:
        q = rng.uniform(low, high, (20_000, len(JOINTS)))
        touching, touches = world.probe.felt_rows(q)
        for n, reading in zip(touching, touches.sensation, strict=True):
            rows += [[*q[n], *reading], [*q[n - 1], *np.zeros(len(reading))]]
        felt += len(touching)
    with (folder / "touches.csv").open("w", newline="") as file:
        names = [name for name, *_ in JOINTS] + [f"taxel_{n}" for n in range(len(reading))]
        csv.writer(file).writerows([names, *rows])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What a person has."""
    folder, world = tmp_path_factory.mktemp("mine"), World(load_experiment("torus"))
    write_recording(folder, world)
    (folder / "arm.urdf").write_text(urdf(forearm=0.41))
    (folder / "my_robot.py").write_text(BODY)
    places = world.skins[0].fields.p_LS
    rows = [[f"taxel_{n}", *place] for n, place in enumerate(places)]
    with (folder / "taxels.csv").open("w", newline="") as file:
        csv.writer(file).writerows([["name", "x", "y", "z"], *rows])
    return folder


def similar_error(file):
    """Root mean square, m, of how a file's fingertip moves otherwise, after a similarity."""
    names = [name for name, *_ in JOINTS]
    q = np.random.default_rng(1).uniform(-1, 1, (200, len(names)))
    Path("true.urdf").write_text(urdf())
    true, found = (
        read_way(Path(each), names, "body", "fingertip")[0].places(q)
        for each in ("true.urdf", file)
    )
    turn, scale, shift = similarity(found, true, np.ones(len(q)))
    off = scale * found @ turn.T + shift - true
    return float(np.sqrt(np.square(off).sum(axis=1).mean()))


@pytest.mark.slow
def test_every_command_works_one_after_another(folder, monkeypatch):
    monkeypatch.chdir(folder)
    text, printed = PAGE.read_text(), {}
    lines = [line for block in blocks(text, "") for line in block.splitlines()]
    assert len(lines) == 9
    for line in lines:
        done = selftouch(*shlex.split(line)[1:])
        assert done.status == 0, (line, done.stderr)
        printed[line] = done.stdout
    (found,) = [out for line, out in printed.items() if line == "selftouch model runs/mine"]
    assert found.startswith("body model: accepted")
    (moved,) = [out for line, out in printed.items() if "--start" in line]
    assert "wrong" not in moved
    with (folder / "arm_refitted_changes.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["z"] and abs(float(row["z"])) > 3]
    moved = [row for row in rows if row["number"] != "offset"]
    assert [row["number"] for row in moved] == ["shift along x"]
    assert float(moved[0]["change"]) == pytest.approx(-0.01, abs=0.001)
    assert similar_error("arm_refitted.urdf") < 0.7 * similar_error("arm.urdf")
    for file in ("mine_receptors.csv", "arm_refitted_receptors.csv"):
        with (folder / file).open() as opened:
            assert [row["name"] for row in csv.DictReader(opened)][:2] == ["taxel_0", "taxel_1"]
    (program,) = blocks(text, "python")
    exec(compile(program, PAGE.name, "exec"), {})
    names = mujoco.MjModel.from_xml_path("mine.urdf")
    assert {names.joint(n).name for n in range(names.njnt)} == {name for name, *_ in JOINTS}
    # The links of the file that was given have no inertia, so MuJoCo does not take it.
    refitted = ET.parse("arm_refitted.urdf").getroot()
    assert {joint.get("name") for joint in refitted.iter("joint")} >= {name for name, *_ in JOINTS}
    assert (folder / "runs" / "mine" / "map.csv").is_file()
    world = World(load_experiment("torus"))
    with (folder / "runs" / "mine" / "plans" / "3-40.csv").open() as file:
        plan = np.array([[float(row[name]) for name, *_ in JOINTS] for row in csv.DictReader(file)])
    assert np.mean(world.probe.sensations(plan).any(axis=1)) > 0.9
