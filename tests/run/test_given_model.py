"""`selftouch model --start`: a model that one has, put right on a skin that is laid by hand."""

import csv
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from commands import refused, selftouch

from selftouch_drake.export.given_model import read_way
from selftouch_drake.resources import MODELS

RADIUS, BALL, FIELD = 0.2, 0.01, 0.12
OFFSETS = np.array([0.0, 0.05, -0.03, 0.02])
JOINTS = ("yaw", "pitch", "elbow", "wrist")
AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0")
RECEPTORS, EXCHANGED = 60, (4, 14)


def urdf(names=JOINTS, axes=AXES):
    """An arm of four joints over a still head; the ball is at the end of the last link."""
    links = "".join(f"<link name='{name}_link'/>" for name in ("base", *names))
    starts = ("0 0 0.75", "0.1 0 0", "0.35 0 0", "0.3 0 0")
    joints = "".join(
        f"<joint name='{name}' type='revolute'><parent link='{parent}_link'/>"
        f"<child link='{name}_link'/><origin xyz='{start}'/><axis xyz='{axis}'/>"
        "<limit lower='-3' upper='3' effort='1' velocity='1'/></joint>"
        for name, parent, start, axis in zip(names, ("base", *names), starts, axes, strict=False)
    )
    tip = (
        "<link name='tip'/><joint name='fixed' type='fixed'>"
        f"<parent link='{names[-1]}_link'/><child link='tip'/><origin xyz='0.1 0.12 0'/></joint>"
    )
    return f"<robot name='arm'><!-- mine -->{links}{joints}{tip}</robot>"


def touches(model, num, seed=0):
    """Joints as read, readings and places of receptors of a sphere that the ball just touches."""
    way, _ = read_way(model, JOINTS, "base_link", "tip")
    rng = np.random.default_rng(seed)
    kept = []
    while sum(map(len, kept)) < num:
        a = rng.uniform([-1.5, -0.4, 0.2, -1.5], [1.5, 1.6, 2.6, 1.5], (4_000, 4))
        b = a + rng.normal(0.0, 0.3, a.shape)

        def height(q):
            return np.linalg.norm(way.places(q), axis=1) - RADIUS - BALL

        across = (height(a) > 0) & (height(b) < 0)
        a, b = a[across], b[across]
        for _ in range(25):
            middle = (a + b) / 2
            outside = height(middle)[:, None] > 0
            a, b = np.where(outside, middle, a), np.where(outside, b, middle)
        centre = way.places(a)
        kept.append(a[np.einsum("nx,nx->n", way.behind(a, 2 * BALL) - centre, centre) > 0])
    q = np.concatenate(kept)[:num]
    touched = way.places(q)
    touched *= RADIUS / np.linalg.norm(touched, axis=1, keepdims=True)
    golden = np.arange(RECEPTORS) + 0.5
    z, turn = 1.0 - 2.0 * golden / RECEPTORS, np.pi * (1 + 5**0.5) * golden
    places = RADIUS * np.c_[np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z]
    along = RADIUS * np.arccos(np.clip(touched @ places.T / RADIUS**2, -1, 1))
    readings = np.square(np.maximum(1.0 - np.square(along / FIELD), 0.0))
    readings *= rng.uniform(0.5, 2.0, (num, 1)) * np.exp(rng.normal(0.0, 0.03, readings.shape))
    return q - OFFSETS, readings, places


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """A folder with a run and a model of its robot; the places of the receptors."""
    folder = tmp_path_factory.mktemp("given")
    model = folder / "arm.urdf"
    model.write_text(urdf())
    q, sensation, places = touches(model, 200)
    sensation[:, [20, 40]] = 0.0
    sensation[:, EXCHANGED] = sensation[:, EXCHANGED[::-1]]
    np.savez(folder / "touches.npz", q=q, sensation=sensation, joint_names=np.array(JOINTS))
    small = "{representation: {num_targets: 50}}"
    read = ("--offset", 0, "--threshold", 0.01, "--set", small)
    done = selftouch("import", folder / "touches.npz", *read, "--out", folder / "run")
    assert done.status == 0, done
    return folder, places


ON = ("--link", "base_link", "--frame", "tip")


@pytest.fixture(scope="module")
def corrected(given):
    """The folder, what the command says, and the places, once with a file of the taxels."""
    folder, places = given
    rows = [f"T{n},{','.join(f'{v:.4f}' for v in place)}" for n, place in enumerate(places)]
    (folder / "taxels.csv").write_text("\n".join(["name,x,y,z", *rows]))
    # The wrist turns the other way round in this file.
    text = urdf(axes=(*AXES[:3], "-1 0 0"))
    (folder / "wrong.urdf").write_text(text)
    asked = ("--start", folder / "wrong.urdf", *ON, "--taxels", folder / "taxels.csv")
    done = selftouch("model", folder / "run", *asked)
    assert done.status == 0, done
    return folder, done, places


def rows_of(file):
    with file.open() as opened:
        return list(csv.DictReader(opened))


def test_receptors_are_found_in_metres(corrected):
    folder, _, places = corrected
    rows = rows_of(folder / "wrong_refitted_receptors.csv")
    number = np.array([int(row["name"]) for row in rows])
    assert not {20, 40} & set(number.tolist())
    truth = places.copy()
    truth[[*EXCHANGED]] = places[[*EXCHANGED[::-1]]]
    found = np.array([[row[axis] for axis in "xyz"] for row in rows], dtype=float)
    sigma = np.array([[row[f"sigma_{axis}"] for axis in "xyz"] for row in rows], dtype=float)
    error = np.abs(found - truth[number])
    assert np.median(np.linalg.norm(error, axis=1)) < 0.003
    assert np.mean(error <= 1.96 * sigma) > 0.8
    normal = np.array([[row[f"n{axis}"] for axis in "xyz"] for row in rows], dtype=float)
    assert np.einsum("sx,sx->s", normal, truth[number]).min() > 0.9 * RADIUS


def test_offsets_are_found_and_what_is_unobservable_is_said(corrected):
    folder, done, _ = corrected
    rows = {
        row["joint"]: row
        for row in rows_of(folder / "wrong_refitted_changes.csv")
        if row["number"] == "offset"
    }
    found = np.array([float(rows[name]["change"]) for name in JOINTS])
    # About the axis of the file, which is corrected: the wrist reads the other way round there.
    assert np.abs(found - OFFSETS).max() < 0.004
    assert rows["yaw"]["told"] == "0"
    assert "unobservable: the offset of yaw, which moves receptors as well" in done.stdout


def test_what_is_wrong_is_named(corrected):
    _, done, _ = corrected
    lines = [line for line in done.stdout.splitlines() if line.startswith("wrong")]
    assert len(lines) == 2, lines
    assert lines[0].startswith("wrong: joint wrist turns the other way round: its axis is 1 0 0;")
    assert lines[1] == "wrong: receptors 4 and 14 are exchanged"


def test_the_corrected_file_moves_as_the_robot_does_and_keeps_the_rest(corrected):
    folder, _, _ = corrected
    before = (folder / "wrong.urdf").read_text()
    after = (folder / "wrong_refitted.urdf").read_text()
    assert "<!-- mine -->" in after
    for text in (before, after):
        root = ET.fromstring(text)
        assert [e.tag for e in root.iter()] == [e.tag for e in ET.fromstring(before).iter()]
    joints = [ET.fromstring(text).findall("joint") for text in (before, after)]
    for old, new in zip(*joints, strict=True):
        moved = old.find("origin").attrib != new.find("origin").attrib
        assert moved == (new.get("name") in JOINTS[1:])
        turned = old.get("name") == "wrist"
        assert (
            ET.tostring(old.find("axis") or old) == ET.tostring(new.find("axis") or old)
        ) or turned
    true, _ = read_way(folder / "arm.urdf", JOINTS, "base_link", "tip")
    found, _ = read_way(folder / "wrong_refitted.urdf", JOINTS, "base_link", "tip")
    q = np.random.default_rng(5).uniform(-1, 1, (50, 4))
    assert np.linalg.norm(found.places(q) - true.places(q + OFFSETS), axis=1).max() < 0.004


def test_a_model_with_other_joints_is_refused(given, tmp_path):
    folder, _ = given
    other = tmp_path / "other.urdf"
    other.write_text(urdf(("yaw", "pitch", "knee", "wrist")))
    line = refused("model", folder / "run", "--start", other, *ON)
    assert line.startswith("joint 'elbow' of the run is not in")
    assert "which has yaw, pitch, knee, wrist; give the model of the robot" in line
    line = refused("model", folder / "run", "--start", tmp_path / "no.urdf", *ON)
    assert "no.urdf does not exist; give a URDF" in line
    start = ("model", folder / "run", "--start", folder / "arm.urdf")
    line = refused(*start, "--link", "base_lnk", *ON[2:])
    assert "--link is 'base_lnk'; the robot has no such link: did you mean" in line
    line = refused(*start, "--link", "wrist_link", "--frame", "tip")
    assert line.startswith("no joint of the run is between wrist_link and tip in")


def test_what_does_not_go_with_it_is_refused(given, tmp_path):
    folder, _ = given
    start = ("model", folder / "run", "--start", folder / "arm.urdf")
    assert (
        refused(*start, "--link", "base_link") == "--start needs --frame; name it as in the model"
    )
    assert refused(*start, *ON, "--mirror").startswith("--mirror is given with --start")
    assert refused("model", folder / "run", "--link", "a").startswith("--link is given without --s")
    assert "give another file that ends in .urdf" in refused(
        *start, *ON, "--urdf", folder / "arm.urdf"
    )
    assert "--receptors is 5,200; give two numbers from 0 to 59" in refused(
        *start, *ON, "--receptors", "5,200"
    )
    few = tmp_path / "few.csv"
    few.write_text("x,y,z\n0,0,1\n0,1,0\n1,0,0\n1,1,0\n")
    assert "has 4 receptors, the skin 60; give a row for each" in refused(
        *start, *ON, "--taxels", few
    )


def test_a_model_that_nothing_fits_is_refused(given, tmp_path):
    folder, _ = given
    other = tmp_path / "other.urdf"
    other.write_text(urdf(axes=("1 0 0", "1 0 0", "0 0 1", "0 1 0")))
    line = refused("model", folder / "run", "--start", other, *ON)
    assert line.startswith("touches that feel alike lie ")
    assert "no other axis, sign or exchange of two joints brings them near; check --link" in line


@pytest.mark.slow
def test_a_run_in_drake_has_the_joints_of_its_model(tmp_path):
    run, model = tmp_path / "run", MODELS / "one_finger.dmd.yaml"
    small = "{babbling: {num_samples: 300, walk_size: 300}, representation: {num_targets: 50}}"
    assert selftouch("babble", "torus", "--out", run, "--set", small, "--workers", 1).status == 0
    common = ("--link", "body", "--frame", "fingertip_0")
    done = selftouch("model", run, "--start", model, *common)
    assert done.status == 0, done
    assert "unobservable: the offset of shoulder_yaw" in done.stdout
    # Nothing is written beside a model of the package.
    assert (run / "one_finger.dmd_refitted_changes.csv").exists()
    assert not list(MODELS.glob("*refitted*"))


def test_defaults_that_mjcf_inherits_count(tmp_path):
    """Drake's own parser drops the axis of `tilt`, which its class inherits from the main one."""
    (tmp_path / "arm.xml").write_text(
        "<mujoco model='arm'><compiler angle='radian'/>"
        "<default><joint axis='0 1 0'/><default class='arm'><site size='.01'/></default></default>"
        "<worldbody><body name='base' childclass='arm'><geom size='.1'/>"
        "<body name='tip' pos='0 0 .3'><joint name='tilt'/><geom size='.1' pos='0 0 .2'/></body>"
        "</body></worldbody></mujoco>"
    )
    way, _ = read_way(tmp_path / "arm.xml", ["tilt"], "base", "tip")
    np.testing.assert_allclose(way.axes, [[0.0, 1.0, 0.0]], atol=1e-9)
