"""Robots that others published, read where they are installed, beside MuJoCo."""

import importlib.util
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from beside_mujoco import (
    Loaded,
    compare,
    floating,
    in_mujoco,
    lighter_or_heavier,
    mujocos_pairs,
    named_to_move,
)

from selftouch_drake.experiment import ExperimentError

pytest.importorskip("mujoco")

# Each with the joints that move, where not all can: those of a body that travels slide without end.
MJCF = {
    "gymnasium/ant": None,
    "gymnasium/half_cheetah": ["bthigh", "bshin", "bfoot", "fthigh", "fshin", "ffoot"],
    "gymnasium/hopper": ["thigh_joint", "leg_joint", "foot_joint"],
    "gymnasium/humanoid": None,
    "gymnasium/humanoidstandup": None,
    "gymnasium/inverted_double_pendulum": None,
    "gymnasium/inverted_pendulum": None,
    "gymnasium/pusher": None,
    "gymnasium/pusher_v5": None,
    "gymnasium/reacher": None,
    "gymnasium/swimmer": ["motor1_rot", "motor2_rot"],
    "gymnasium/walker2d_v5": ["thigh_joint", "leg_joint", "foot_left_joint"],
    "pybullet_data/humanoid": None,
    "pybullet_data/humanoid_symmetric_no_ground": None,
    "pybullet_data/striker": None,
    "pybullet_data/thrower": None,
}
# Its `settotalmass` is not read, and Drake's warning says so.
SCALED = {"gymnasium/half_cheetah"}
URDF = (
    "TwoJointRobot_w_fixedJoints.urdf",
    "cartpole.urdf",
    "pr2_gripper.urdf",
    "r2d2.urdf",
    "racecar/racecar.urdf",
    "a1/a1.urdf",
    "aliengo/aliengo.urdf",
    "laikago/laikago.urdf",
    "franka_panda/panda.urdf",
    "kuka_iiwa/model.urdf",
    "xarm/xarm6_robot.urdf",
)
# What Drake or this program refuses, and the line that says so.
REFUSED = {
    "mini_cheetah/mini_cheetah.urdf": "Material 'darkgray' not previously defined",
    "husky/husky.urdf": "is xacro, which must be expanded first",
    "quadruped/minitaur.urdf": "in URDF, a limit that is left out is 0",
    "mjcf/hopper.xml": "coordinate=global is not supported",
    "mjcf/humanoid_fixed.xml": "Unknown joint type fixed",
    "mjcf/half_cheetah.xml": "'ignorex' slides without limits; give it limits in its model",
    "spherical_joint_limit.urdf": "unrecognized type: 'spherical'",
}
PACKAGES = {"franka_panda": ("meshes", "meshes"), "xarm": ("xarm_description", "xarm_description")}


def folder_of(package):
    """Where a package is installed; skips the test where it is not."""
    spec = importlib.util.find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        pytest.skip(f"{package} is not installed")
    return Path(next(iter(spec.submodule_search_locations)))


def mjcf_file(name):
    package, model = name.split("/")
    inside = "envs/mujoco/assets" if package == "gymnasium" else "mjcf"
    return folder_of(package) / inside / f"{model}.xml"


@pytest.fixture(autouse=True)
def cache(tmp_path, tmp_path_factory, monkeypatch):
    """Converted meshes are kept for the next robot, and MuJoCo's log is not kept here."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))


@pytest.mark.parametrize("name", MJCF)
def test_mjcf_is_what_it_is_in_mujoco(name, tmp_path):
    file = mjcf_file(name)
    there = in_mujoco(file)
    loaded = Loaded(file, tmp_path, joints=MJCF[name], welds=floating(there))
    if MJCF[name] is None:
        hinges_and_slides = {2, 3}
        assert len(loaded.joints) == sum(int(t) in hinges_and_slides for t in there.jnt_type)
    assert compare(loaded, there) == []
    if name not in SCALED:
        assert lighter_or_heavier(loaded, there) == []
    meeting, beside = loaded.pairs()
    assert meeting == mujocos_pairs(there) - beside


@pytest.mark.parametrize("name", URDF)
def test_urdf_is_what_it_is_in_mujoco(name, tmp_path):
    file = folder_of("pybullet_data") / name
    check_urdf(file, tmp_path, packages_of(file))


@pytest.mark.slow
def test_the_icub_is_what_it_is_in_mujoco(tmp_path):
    pytest.importorskip("icub_models")
    share = Path(sys.prefix) / "share" / "iCub"
    file = share / "robots" / "iCubGenova02" / "model.urdf"
    check_urdf(file, tmp_path, {"iCub": str(share)})


def check_urdf(file, tmp_path, packages):
    there = in_mujoco(file)
    welds = [(name, np.zeros(3), [1, 0, 0, 0]) for name in roots(file)]
    try:
        loaded = Loaded(file, tmp_path, welds=welds, packages=packages)
    except ExperimentError as error:
        if (joints := named_to_move(error)) is None:
            raise
        loaded = Loaded(file, tmp_path, joints=joints, welds=welds, packages=packages)
    assert compare(loaded, there) == []
    limited = {there.joint(j).name: there.jnt_actfrcrange[j, 1] for j in range(there.njnt)}
    for name, effort in loaded.efforts.items():
        assert effort == (limited[name] or np.inf)
    meeting, beside = loaded.pairs()
    solid = {name for name in links_with_collisions(file) if name in loaded.links}
    together = {frozenset((a, b)) for a in solid for b in solid if a < b}
    assert meeting == together - beside


def packages_of(file):
    name, folder = PACKAGES.get(file.parent.name, (None, None))
    return {name: str(file.parent / folder)} if name else {}


def roots(file):
    """The links of a URDF that hang on no joint."""
    robot = ElementTree.parse(file).getroot()
    children = {child.get("link") for child in robot.iter("child")}
    return [
        link.get("name")
        for link in robot.findall("link")
        if link.get("name") not in {*children, "world"}
    ]


def links_with_collisions(file):
    robot = ElementTree.parse(file).getroot()
    return [
        link.get("name") for link in robot.findall("link") if link.find("collision") is not None
    ]


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_read_is_said_in_one_line(name, tmp_path):
    file = folder_of("pybullet_data") / name
    names = roots(file) if file.suffix == ".urdf" else []
    with pytest.raises(ExperimentError) as refusal:
        Loaded(file, tmp_path, welds=[(name, np.zeros(3), [1, 0, 0, 0]) for name in names])
    assert REFUSED[name] in str(refusal.value)
    assert "\n" not in str(refusal.value)
