"""`selftouch calibrate`: receptors in metres, on a skin that is laid by hand."""

import csv
import json

import numpy as np
import pytest
from commands import refused, selftouch

from selftouch_drake.calibration.model import read_kinematics
from selftouch_drake.resources import MODELS

RADIUS, BALL, FIELD = 0.2, 0.01, 0.1
OFFSETS = np.array([0.0, 0.05, -0.03, 0.02])
JOINTS = ("yaw", "pitch", "elbow", "wrist")


def urdf(names=JOINTS):
    """An arm of four joints over a still head; the ball is at the end of the last link."""
    links = "".join(f"<link name='{name}_link'/>" for name in ("base", *names))
    axes = ("0 0 1", "0 1 0", "0 1 0", "1 0 0")
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
    return f"<robot name='arm'>{links}{joints}{tip}</robot>"


def touches(model, num, seed=0):
    """Joints as read, readings and places of receptors of a sphere that the ball just touches."""
    kinematics, _ = read_kinematics(model, JOINTS, "base_link", "tip", BALL)
    rng = np.random.default_rng(seed)
    kept = []
    while sum(map(len, kept)) < num:
        a = rng.uniform([-1.5, -0.4, 0.2, -1.5], [1.5, 1.6, 2.6, 1.5], (4_000, 4))
        b = a + rng.normal(0.0, 0.3, a.shape)

        def height(q):
            return np.linalg.norm(kinematics.poses(q)[:, 1, :, 3], axis=1) - RADIUS - BALL

        across = (height(a) > 0) & (height(b) < 0)
        a, b = a[across], b[across]
        for _ in range(25):
            middle = (a + b) / 2
            outside = height(middle)[:, None] > 0
            a, b = np.where(outside, middle, a), np.where(outside, b, middle)
        X_W = kinematics.poses(a)
        away = np.einsum("nx,nx->n", X_W[:, 2, :, 3] - X_W[:, 1, :, 3], X_W[:, 1, :, 3])
        kept.append(a[away > 0])
    q = np.concatenate(kept)[:num]
    touched = kinematics.poses(q)[:, 1, :, 3]
    touched *= RADIUS / np.linalg.norm(touched, axis=1, keepdims=True)
    golden = np.arange(90) + 0.5
    z, turn = 1.0 - 2.0 * golden / 90, np.pi * (1 + 5**0.5) * golden
    places = RADIUS * np.c_[np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z]
    along = RADIUS * np.arccos(np.clip(touched @ places.T / RADIUS**2, -1, 1))
    readings = np.square(np.maximum(1.0 - np.square(along / FIELD), 0.0))
    readings *= rng.uniform(0.5, 2.0, (num, 1)) * np.exp(rng.normal(0.0, 0.03, readings.shape))
    return q - OFFSETS, readings, places


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("calibration")
    model = folder / "arm.urdf"
    model.write_text(urdf())
    q, sensation, places = touches(model, 300)
    sensation[:, [20, 40]] = 0.0
    np.savez(folder / "touches.npz", q=q, sensation=sensation, joint_names=np.array(JOINTS))
    small = "{representation: {num_targets: 50}}"
    read = ("--offset", 0, "--threshold", 0.01, "--set", small)
    done = selftouch("import", folder / "touches.npz", *read, "--out", folder / "run")
    assert done.status == 0, done
    common = ("--link", "base_link", "--frame", "tip")
    done = selftouch("calibrate", folder / "run", "--robot", model, *common)
    assert done.status == 0, done
    return folder, done, places


def test_receptors_are_found_in_metres(calibrated):
    folder, _, places = calibrated
    with (folder / "run" / "calibration.csv").open() as file:
        rows = list(csv.DictReader(file))
    number = [int(row["receptor"]) for row in rows]
    assert not {20, 40} & set(number)
    found = np.array([[row[axis] for axis in "xyz"] for row in rows], dtype=float)
    half = np.array([[row[f"{axis}_half_interval"] for axis in "xyz"] for row in rows], dtype=float)
    error = np.abs(found - places[number])
    assert np.median(np.linalg.norm(error, axis=1)) < 0.002
    assert np.mean(error <= half) > 0.8


def test_offsets_are_found_and_what_is_unobservable_is_said(calibrated):
    folder, done, _ = calibrated
    summary = json.loads((folder / "run" / "calibration.json").read_text())
    found = np.array([summary["offsets"][name]["offset"] for name in JOINTS])
    assert np.abs(found - OFFSETS).max() < 0.003
    assert "unobservable: the offset of yaw, which moves receptors as well" in done.stdout
    X = np.array(summary["skin"]["X_LS"])
    np.testing.assert_allclose(X[:, :3].T @ X[:, :3], np.eye(3), atol=1e-9)


def test_a_model_with_other_joints_is_refused(calibrated, tmp_path):
    folder, _, _ = calibrated
    other = tmp_path / "other.urdf"
    other.write_text(urdf(("yaw", "pitch", "knee", "wrist")))
    common = ("--link", "base_link", "--frame", "tip")
    line = refused("calibrate", folder / "run", "--robot", other, *common)
    assert line.startswith("joint 'elbow' of the run is not in")
    assert "which has yaw, pitch, knee, wrist; give the model of the robot" in line
    line = refused("calibrate", folder / "run", "--robot", tmp_path / "no.urdf", *common)
    assert "no.urdf does not exist; give a URDF" in line
    line = refused(
        "calibrate",
        folder / "run",
        "--robot",
        folder / "arm.urdf",
        "--link",
        "base_lnk",
        *common[2:],
    )
    assert "--link is 'base_lnk'; the robot has no such link: did you mean" in line


@pytest.mark.slow
def test_a_run_in_drake_has_the_joints_of_its_model(tmp_path):
    run, model = tmp_path / "run", MODELS / "one_finger.dmd.yaml"
    small = "{babbling: {num_samples: 300, walk_size: 300}, representation: {num_targets: 50}}"
    assert selftouch("babble", "torus", "--out", run, "--set", small, "--workers", 1).status == 0
    common = ("--robot", model, "--link", "body", "--frame", "fingertip_0")
    done = selftouch("calibrate", run, *common)
    assert done.status == 0, done
    assert "unobservable: the offset of shoulder_yaw" in done.stdout
    assert "--receptors is 5,200; give two" in refused(
        "calibrate", run, *common, "--receptors", "5,200"
    )


def test_defaults_that_mjcf_inherits_count(tmp_path):
    """Drake's own parser drops the axis of `tilt`, which its class inherits from the main one."""
    (tmp_path / "arm.xml").write_text(
        "<mujoco model='arm'><compiler angle='radian'/>"
        "<default><joint axis='0 1 0'/><default class='arm'><site size='.01'/></default></default>"
        "<worldbody><body name='base' childclass='arm'><geom size='.1'/>"
        "<body name='tip' pos='0 0 .3'><joint name='tilt'/><geom size='.1' pos='0 0 .2'/></body>"
        "</body></worldbody></mujoco>"
    )
    kinematics, _ = read_kinematics(tmp_path / "arm.xml", ["tilt"], "base", "tip", 0.01)
    turned = kinematics.poses(np.array([[0.5]]))[0, 1, :, 2]
    np.testing.assert_allclose(turned, [np.sin(0.5), 0.0, np.cos(0.5)], atol=1e-9)
