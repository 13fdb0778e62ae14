import functools
from dataclasses import dataclass

import numpy as np
import pytest

from selftouch_drake.experiment import load_experiment
from selftouch_drake.resources import EXPERIMENTS, shipped
from selftouch_drake.robot import World

ICUB, ICUB_SKIN = "icub", "icub_skin"


@dataclass(frozen=True)
class Shipped:
    """What a robot's description promises.

    `touching` bounds the share of random postures that are kept, in percent.
    """

    joints: int
    skins: int
    touching: tuple[float, float]


ROBOTS = {
    "sphere": Shipped(6, 1, (2, 6)),
    "turning_body": Shipped(9, 1, (2, 5)),
    "gantry": Shipped(5, 1, (4, 7)),
    "planar": Shipped(3, 1, (2, 5)),
    "two_arms": Shipped(12, 3, (2, 5)),
    "five_arms": Shipped(30, 1, (2, 6)),
    "infant": Shipped(14, 6, (4, 8)),
}
NUM_POSTURES = 6000


@functools.cache
def built(name):
    return World(load_experiment(name))


@pytest.fixture(
    scope="module",
    params=[
        name if name in ("planar", "infant") else pytest.param(name, marks=pytest.mark.slow)
        for name in ROBOTS
    ],
)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def world(name):
    return built(name)


@pytest.fixture(scope="module")
def touches(world):
    """Random postures that touch and that the robot can take."""
    robot = world.robot
    postures = np.random.default_rng(0).uniform(
        *robot.babbled_range, (NUM_POSTURES, robot.num_joints)
    )
    touches = world.probe.touches(postures)
    touching = np.unique(touches.row)
    kept = touching[~world.probe.impossible(postures[touching])]
    of_kept = np.isin(touches.row, kept)
    return {
        "share": len(kept) / NUM_POSTURES,
        "pairs": set(zip(touches.toucher[of_kept], touches.skin[of_kept], strict=True)),
    }


def test_every_robot_is_tested():
    paper_s = {"cube", "cylinder", "double_torus", "ellipsoid", "torus"}
    several_fingers = {name for name in shipped(EXPERIMENTS) if name.endswith("fingers")}
    assert set(shipped(EXPERIMENTS)) == set(ROBOTS) | paper_s | several_fingers | {ICUB, ICUB_SKIN}


def test_joints_and_skins(name, world):
    assert world.robot.num_joints == ROBOTS[name].joints
    assert len(world.robot.skins) == ROBOTS[name].skins


def test_joints_have_limits(world):
    plant = world.robot.plant
    assert np.isfinite(world.robot.lower).all()
    assert np.isfinite(world.robot.upper).all()
    assert np.isfinite(plant.GetVelocityUpperLimits()).all()
    assert np.isfinite(plant.GetEffortUpperLimits()).all()


def test_inertias_are_physical(world):
    for joint in world.robot.joints:
        inertia = joint.child_body().default_spatial_inertia()
        assert inertia.get_mass() > 0
        assert inertia.IsPhysicallyValid()


def test_random_postures_touch(name, touches):
    low, high = ROBOTS[name].touching
    assert low < 100 * touches["share"] < high


def test_every_skin_is_touched(world, touches):
    assert {skin for _, skin in touches["pairs"]} == set(range(len(world.robot.skins)))


def test_all_that_touches_touches(world, touches):
    assert {toucher for toucher, _ in touches["pairs"]} == set(range(len(world.robot.touchers)))


def test_turning_body_turns_about_its_neck():
    robot = built("turning_body").robot
    q = np.random.default_rng(0).uniform(*robot.babbled_range, (200, robot.num_joints))
    X_WL = robot.skin_positions(q)[:, 0]
    from_neck = X_WL[:, :, 3] - [0, 0, -0.25]
    np.testing.assert_allclose(np.linalg.norm(from_neck, axis=1), 0.25)
    tilt = np.arccos(X_WL[:, 2, 2])
    assert tilt.max() > 0.7
    assert robot.toucher_positions(q[:1])[0, 0] == pytest.approx(
        robot.toucher_positions(np.concatenate([0 * q[:1, :3], q[:1, 3:]], axis=1))[0, 0]
    )


def test_gantry_slides_and_turns():
    robot = built("gantry").robot
    assert robot.turns.tolist() == [False, False, False, True, True]
    tip = robot.toucher_positions(np.array([[0.1, -0.2, 0.3, 0, 0], [0, 0, 0, 0, np.pi / 2]]))
    np.testing.assert_allclose(tip[:, 0], [[0.38, -0.2, 0.3], [0, 0, -0.28]], atol=1e-12)


def test_no_finger_of_two_arms_reaches_its_own_sleeve():
    world = built("two_arms")
    robot = world.robot
    skins = [skin.model.name for skin in robot.skins]
    q = np.random.default_rng(1).uniform(*robot.babbled_range, (20_000, robot.num_joints))
    # The worst postures: wrists bent back as far as they go.
    q[:, robot.joint_names.index("left_arm::wrist_y")] = 2.0
    q[:, robot.joint_names.index("left_arm::wrist_z")] = 0.0
    touches = world.probe.touches(q)
    own = (touches.toucher == 0) & (touches.skin == skins.index("left_forearm"))
    assert robot.touchers[0].name == "left_fingertip"
    assert not own.any()


def test_infant_is_the_same_on_both_sides():
    robot = built("infant").robot
    q = np.random.default_rng(0).uniform(*robot.babbled_range, (100, robot.num_joints))
    names = robot.joint_names
    other = [name.replace("left", "LEFT").replace("right", "left") for name in names]
    other = [name.replace("LEFT", "right") for name in other]
    mirrored = q[:, [names.index(name) for name in other]]
    mirrored[:, names.index("neck_yaw")] *= -1
    assert [toucher.name for toucher in robot.touchers] == ["left_hand", "right_hand"]
    at_q, at_mirrored = robot.toucher_positions(q), robot.toucher_positions(mirrored)
    np.testing.assert_allclose(at_mirrored[:, ::-1], at_q * [1, -1, 1], atol=1e-12)


def test_rigid_parts_of_the_infant_are_kept_apart():
    pairs = built("infant").robot.rigid_pairs
    names = {tuple(link.name() for link in pair.links) for pair in pairs}
    assert {("torso", "left_upper_arm"), ("head", "right_hand")} <= names


@pytest.mark.slow
def test_icub():
    pytest.importorskip("icub_models")
    robot = built(ICUB).robot
    assert robot.num_joints == 20
    assert len(robot.skins) == 5
    # Links that overlap round a compound joint do not collide, and a hand does not touch its arm.
    pairs = {tuple(link.name() for link in pair.links) for pair in robot.rigid_pairs}
    assert ("head", "r_hand") in pairs
    assert not pairs & {("chest", "head"), ("chest", "r_shoulder_3"), ("r_forearm", "r_hand")}
    names = [skin.model.name for skin in robot.skins]
    assert {names[skin] for toucher, skin in robot.touching_pairs if toucher == 1} == {
        "head",
        "left_forearm",
        "left_thigh",
        "right_thigh",
    }


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::selftouch_drake.robot.skins.MovedReceptorsWarning")
def test_the_icub_has_its_taxels():
    pytest.importorskip("icub_models")
    world = built(ICUB_SKIN)
    assert [skin.fields.num_receptors for skin in world.skins] == [430, 350, 350, 240, 240]
    postures = np.random.default_rng(0).uniform(*world.robot.babbled_range, (100_000, 17))
    touches = world.probe.touches(postures)
    touching = np.flatnonzero(touches.sensation.any(axis=1))
    # One posture in four thousand touches, and the robot can take one in ten of these.
    assert 10 < len(touching) < 60
    # A touch is felt by a few taxels around one place.
    assert np.median((touches.sensation[touching] > 0).sum(axis=1)) < 30
