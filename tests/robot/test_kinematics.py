import numpy as np
import pytest
import robots
from pydrake.multibody.plant import MultibodyPlant

from selftouch_drake.robot.kinematics import Kinematics
from selftouch_drake.robot.models import load_model, parse

# A tree of all kinds of joints, with frames that are turned and moved on both sides of each.
TREE = (
    robots.link("base"),
    robots.link("trunk", pose="0.1 0.2 0.3 0.3 -0.2 0.9"),
    robots.link("left", pose="-0.1 0.5 0.2 1 0.1 -0.4"),
    robots.link("left_tip", pose="-0.3 0.9 0.1 0.5 1.1 0.2"),
    robots.link("right", pose="0.4 -0.5 0.2 -1 0.7 0.3"),
    robots.link("lid", pose="0.3 -0.6 0.5 0 0 1"),
    robots.joint("rise", "prismatic", "base", "trunk", "0.6 0 0.8", pose="0.1 0 0 0.2 0.3 0.4"),
    robots.joint("spin", "continuous", "trunk", "left", "1 2 3", None, "0 0.1 0 1 0 0"),
    robots.joint("bend", "revolute", "left", "left_tip", "0 1 0", (-2, 1), "0 0 0.1 0 0 1"),
    robots.joint("swing", "revolute", "trunk", "right", "0 0.6 -0.8", (-1, 2), "0.1 0.1 0 0 1 0"),
    robots.joint("open", "revolute", "right", "lid", "1 0 0", (0, 1), "0 0 0 0.5 0 0"),
)
SKINS = {"left": {"link": "left_tip", "surface": {"shape": "sphere", "radius": 0.1}}}
TOUCHING = {"lid": {"frame": "lid", "radius": 0.01}}


@pytest.fixture(scope="module", params=["all", "some", "by its tip"])
def tree(request, tmp_path_factory):
    """The tree, with all its joints, with some of them fixed, and welded at another link."""
    some = ["bend", "spin", "robot::open"] if request.param == "some" else None
    weld = "left_tip" if request.param == "by its tip" else "base"
    folder = tmp_path_factory.mktemp("tree")
    skins = SKINS if weld == "base" else {"body": {**SKINS["left"], "link": "right"}}
    touching = TOUCHING if weld == "base" else {"base": {"frame": "base", "radius": 0.01}}
    return robots.build(
        folder, *TREE, skins=skins, touching=touching, robot={"joints": some}, weld=weld
    ).robot


def assert_as_in_drake(robot, frames, X_WL, q):
    context = robot.plant.CreateDefaultContext()
    expected = np.empty_like(X_WL)
    for row, q_row in enumerate(q):
        robot.plant.SetPositions(context, q_row)
        for k, frame in enumerate(frames):
            expected[row, k] = frame.CalcPoseInWorld(context).GetAsMatrix34()
    np.testing.assert_allclose(X_WL, expected, rtol=0, atol=1e-12)
    # Not the poses of a robot that stands still.
    assert np.ptp(expected, axis=0).max() > 0.1


def test_skins_and_touchers_of_shipped_robots_are_where_drake_puts_them(world):
    robot = world.robot
    q = robots.anywhere(robot, 100, seed=0)
    links = [skin.link.body_frame() for skin in robot.skins]
    assert_as_in_drake(
        robot, links + [t.frame for t in robot.touchers], robot.kinematics.poses(q), q
    )
    np.testing.assert_array_equal(
        robot.skin_positions(q), robot.kinematics.poses(q)[:, : len(links)]
    )
    np.testing.assert_array_equal(
        robot.toucher_positions(q), robot.kinematics.poses(q)[..., 3][:, len(links) :]
    )


def test_every_link_of_any_tree_is_where_drake_puts_it(tree):
    plant = tree.plant
    bodies = plant.GetBodyIndices(plant.GetModelInstanceByName("robot"))
    frames = [plant.get_body(index).body_frame() for index in bodies]
    q = robots.anywhere(tree, 100, seed=0)
    assert_as_in_drake(tree, frames, Kinematics.of(plant, frames).poses(q), q)


def test_joints_that_are_not_named_stay_at_their_default(tmp_path):
    defaults = {"swing": 0.7, "rise": 0.2, "spin": 2.0, "open": 0.4}
    world = robots.build(
        tmp_path,
        *TREE,
        skins=SKINS,
        touching=TOUCHING,
        robot={"joints": ["spin", "bend"]},
        defaults=defaults,
    )
    plant = world.robot.plant
    assert sorted(world.robot.joint_names) == ["bend", "spin"]
    free = MultibodyPlant(time_step=0.0)
    parse(free, load_model(world.experiment.robot.directives, {}))
    free.Finalize()
    ours, theirs = plant.CreateDefaultContext(), free.CreateDefaultContext()
    for name in ("spin", "bend"):
        plant.GetJointByName(name).set_angle(ours, 0.3)
        free.GetJointByName(name).set_angle(theirs, 0.3)
    for name in ("trunk", "left", "left_tip", "right", "lid"):
        X_WL, expected = (
            p.GetFrameByName(name).CalcPoseInWorld(context).GetAsMatrix34()
            for p, context in ((plant, ours), (free, theirs))
        )
        np.testing.assert_allclose(X_WL, expected, rtol=0, atol=1e-12)


def test_no_configurations_give_no_poses(world):
    robot = world.robot
    none = np.empty((0, robot.num_joints))
    assert robot.skin_positions(none).shape == (0, len(robot.skins), 3, 4)
    assert robot.toucher_positions(none).shape == (0, len(robot.touchers), 3)


def test_what_turns_and_what_slides(tree):
    kinds = {"rise": False, "spin": True, "bend": True, "swing": True, "open": True}
    found = dict(zip(tree.joint_names, tree.turns.tolist(), strict=True))
    assert found == {name: kinds[name] for name in found}
    endless = dict(zip(tree.joint_names, np.isinf(tree.upper).tolist(), strict=True))
    assert endless == {name: name == "spin" for name in found}
