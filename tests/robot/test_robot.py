"""A robot is data: how it is built, and how mistakes in it are reported."""

import re

import numpy as np
import pytest
import robots
from pydrake.geometry import Role

from selftouch_drake.experiment import ExperimentError, experiment_from_fields
from selftouch_drake.robot import World
from selftouch_drake.systems.simulation import simulation_of

# Two links on two joints, at a base.
BASE = robots.link("base", robots.shape("box", size="0.2 0.2 0.2"))
ARM = robots.link("arm", pose="0.3 0 0 0 0 0")
HAND = robots.link("hand", pose="0.6 0 0 0 0 0")
SHOULDER = robots.joint("shoulder", "revolute", "base", "arm")
WRIST = robots.joint("wrist", "revolute", "arm", "hand")
SKINS = {"torso": {"link": "base", "surface": {"shape": "sphere", "radius": 0.1}}}
TOUCHING = {"tip": {"frame": "hand", "radius": 0.01}}
ROBOT = (BASE, ARM, HAND, SHOULDER, WRIST)


def build(folder, *parts, skins=SKINS, touching=TOUCHING, **fields):
    return robots.build(folder, *parts, skins=skins, touching=touching, **fields)


def message_of(folder, *parts, **fields):
    """The error message for a mistake."""
    with pytest.raises(ExperimentError) as caught:
        _ = build(folder, *parts, **fields).probe
    return str(caught.value)


def test_this_is_the_same_robot(tmp_path):
    robot = build(tmp_path, *ROBOT).robot
    assert robot.joint_names == ["shoulder", "wrist"]
    assert robot.touching_pairs == ((0, 0),)


@pytest.mark.parametrize(
    ("parts", "fields", "message"),
    [
        (
            ROBOT,
            {"weld": None},
            "robot.directives leaves 'base' free to float; weld it to the world (add_weld)",
        ),
        (
            (*ROBOT, robots.link("apple")),
            {},
            "robot.directives leaves 'apple' free to float; weld it to the world (add_weld)",
        ),
        (
            (*ROBOT, robots.link("ball"), robots.joint("hip", "ball", "base", "ball")),
            {"robot": {"joints": ["wrist", "hip"]}},
            "robot.joints[1] is 'hip', a ball_rpy joint; name joints that turn about one axis or "
            "slide along one",
        ),
        (
            (*ROBOT[:4], robots.joint("rail", "prismatic", "arm", "hand", limits=None)),
            {},
            "joint 'rail' slides without limits; give it limits in its model, or leave it out of "
            "robot.joints",
        ),
        (
            (*ROBOT[:4], robots.joint("rail", "prismatic", "arm", "hand", limits=(-1e16, 1e16))),
            {},
            "joint 'rail' slides without limits; give it limits in its model, or leave it out of "
            "robot.joints",
        ),
        (
            (*ROBOT[:4], robots.joint("wrist", "revolute", "arm", "hand", limits=(0.5, 0.5))),
            {},
            "joint 'wrist' has the limits 0.5 and 0.5, so it cannot move; correct its model, or "
            "name the other joints in robot.joints",
        ),
        (
            ROBOT,
            {"robot": {"joints": ["wrist", "robot::wrist"]}},
            "robot.joints is ['wrist', 'robot::wrist']; name each joint once",
        ),
        (
            ROBOT,
            {"robot": {"joints": ["wrist", "wirst"]}},
            "robot.joints[1] is 'wirst'; the robot has no such joint: did you mean wrist?",
        ),
        (
            (
                BASE,
                ARM,
                HAND,
                robots.joint("shoulder", "fixed", "base", "arm"),
                robots.joint("wrist", "fixed", "arm", "hand"),
            ),
            {},
            "robot.directives has no joint that moves; give a robot with joints that turn or slide",
        ),
        (
            ROBOT,
            {"skins": SKINS | {"sleeve": {"link": "arm", "surface": SKINS["torso"]["surface"]}}},
            "skins.sleeve can never be touched: all touchers are on its own link or next to it; "
            "add another one to touching",
        ),
        (
            ROBOT,
            {"touching": TOUCHING | {"elbow": {"frame": "arm", "radius": 0.1}}},
            "touching.elbow can never touch: all skins are on its own link or next to it; "
            "leave it out, or add a skin",
        ),
        (
            ROBOT,
            {"touching": {"hand": {"link": "hand"}}},
            "touching.hand.link is 'hand', a link without collision geometry; add some in its "
            "model, or give a ball by frame and radius",
        ),
        (
            (
                *ROBOT,
                robots.link("floor", robots.shape("plane"), pose="0 0 -1 0 0 0"),
                robots.joint("fix", "fixed", "hand", "floor"),
            ),
            {"touching": {"floor": {"link": "floor"}}},
            "touching.floor.link is 'floor', a link without collision geometry; add some in its "
            "model, or give a ball by frame and radius",
        ),
        (
            ROBOT,
            {"touching": {"tip": {"frame": "hnd", "radius": 0.01}}},
            "touching.tip.frame is 'hnd'; the robot has no such frame: did you mean hand?",
        ),
        (
            ROBOT,
            {"touching": {"tip": {"link": "hnd"}}},
            "touching.tip.link is 'hnd'; the robot has no such link: did you mean hand?",
        ),
        (
            ROBOT,
            {"skins": {"torso": {**SKINS["torso"], "link": "zzzzzz"}}},
            "skins.torso.link is 'zzzzzz'; the robot has no such link: it has arm, base, hand, "
            "world",
        ),
        (
            ROBOT,
            {"skins": {"hand": {"link": "hand", "surface": "collision"}}},
            "skins.hand.surface is 'collision', but link 'hand' has no such geometry; add some "
            "in its model, or give a shape or a mesh",
        ),
        (
            ROBOT,
            {"skins": {"hand": {"link": "hand", "surface": "visual"}}},
            "skins.hand.surface is 'visual', but link 'hand' has no such geometry; add some "
            "in its model, or give a shape or a mesh",
        ),
    ],
)
def test_mistakes_get_one_line(tmp_path, parts, fields, message):
    assert message_of(tmp_path, *parts, **fields) == message


def test_a_name_that_two_models_have_must_be_scoped(tmp_path):
    directives = robots.write(tmp_path, *ROBOT)
    directives.write_text(
        "directives:\n"
        + "".join(
            f"- add_model: {{name: {name}, file: robot.sdf}}\n"
            f"- add_weld: {{parent: world, child: '{name}::base'}}\n"
            for name in ("one", "other")
        )
    )

    def world(link):
        skin = {**SKINS["torso"], "link": link}
        touching = {"tip": {"frame": "other::hand", "radius": 0.01}}
        fields = {"robot": {"directives": str(directives)}, "skins": {"torso": skin}}
        return World(experiment_from_fields({"name": "a", **fields, "touching": touching}))

    message = (
        "skins.torso.link is 'base'; 2 models have a link of this name: write one::base or "
        "other::base"
    )
    with pytest.raises(ExperimentError, match=f"^{re.escape(message)}$"):
        _ = world("base").skins
    robot = world("one::base").robot
    assert robot.joint_names == [
        "one::shoulder", "one::wrist", "other::shoulder", "other::wrist",
    ]  # fmt: skip
    assert robot.skins[0].link.model_instance() != robot.touchers[0].link.model_instance()


def test_a_skin_that_only_presses_another_feels_it_too(tmp_path):
    surface = {"shape": "sphere", "radius": 0.08}
    world = build(
        tmp_path,
        BASE,
        robots.carried("hand"),
        skins=SKINS | {"hand": {"link": "hand", "surface": surface}},
        touching={"hand": {"link": "hand"}},
    )
    assert world.robot.touching_pairs == ((0, 0),)
    q = np.array([[0.13, 0.0, 0.0, 0.0, 0.0, 0.0]])
    felt = world.probe.sensations(q)[0]
    assert felt[:100].sum() == pytest.approx(felt[100:].sum())
    assert felt.sum() > 1.0


def test_a_ball_is_no_part_of_its_link_s_own_geometry(tmp_path):
    ball, own = robots.shape("sphere", "0.1 0 0 0 0 0", radius=0.02), {"link": "hand"}
    parts = (robots.link("base"), robots.carried("hand", ball))
    tip = {"frame": "hand", "radius": 0.02}
    both, alone = (
        build(tmp_path / str(number), *parts, touching=touching)
        for number, touching in enumerate(({"tip": tip, "hand": own}, {"hand": own}))
    )
    assert [len(toucher.geometry_ids) for toucher in both.robot.touchers] == [1, 1]
    # The hand's own ball presses the skin, the other one is outside of it.
    q = np.array([[-0.21, 0.0, 0.0, 0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(both.probe.sensations(q), alone.probe.sensations(q))
    assert alone.probe.sensations(q).any()
    assert both.probe.touches(q).toucher.tolist() == [1]


def test_two_balls_may_sit_on_one_link(tmp_path):
    touching = {name: {"frame": "hand", "radius": 0.01} for name in ("tip", "nail")}
    world = build(tmp_path, *ROBOT, touching=touching)
    assert len(world.robot.touchers) == 2


def test_two_skins_may_be_worn_by_one_link(tmp_path):
    shifted = {"shape": "sphere", "radius": 0.1, "translation": [0, 0, 0.5]}
    skins = SKINS | {"top": {"link": "base", "surface": shifted}}
    world = build(tmp_path, BASE, robots.carried("hand"), skins=skins)
    q = np.array([[0.0, 0, 0.1, 0, 0, 0], [0.0, 0, 0.6, 0, 0, 0]])
    felt = world.probe.sensations(q)
    for row, skin in ((0, 0), (1, 1)):
        np.testing.assert_array_equal(felt[row].reshape(2, 100).any(axis=1), np.arange(2) == skin)


def test_a_skin_has_a_pose_on_its_link(tmp_path):
    pose = {"translation": [0.1, 0.2, 0.3], "rpy_deg": [0, 90, 0]}
    surface = {"shape": "cylinder", "radius": 0.05, "height": 0.3, **pose}
    world = build(tmp_path, *ROBOT, skins={"torso": {"link": "base", "surface": surface}})
    (skin,) = world.skins
    low, high = skin.wall.vertices.min(axis=0), skin.wall.vertices.max(axis=0)
    np.testing.assert_allclose(low, [0.1 - 0.15, 0.2 - 0.05, 0.3 - 0.05], atol=1e-3)
    np.testing.assert_allclose(high, [0.1 + 0.15, 0.2 + 0.05, 0.3 + 0.05], atol=1e-3)
    # Receptors and fields are where the skin is.
    assert ((skin.fields.p_LS >= low - 1e-9) & (skin.fields.p_LS <= high + 1e-9)).all()


def test_a_skin_may_lie_on_its_link_s_own_geometry(tmp_path):
    for kind in ("collision", "visual"):
        skins = {"torso": {"link": "base", "surface": kind, "thickness": 0.01}}
        world = build(tmp_path, *ROBOT, skins=skins)
        (skin,) = world.skins
        assert skin.is_own_geometry
        np.testing.assert_allclose(np.ptp(skin.wall.vertices, axis=0), 0.2, rtol=0.02)


def urdf_link(name):
    return (
        f"<link name='{name}'><inertial><mass value='1'/>"
        "<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link>"
    )


def test_joints_that_are_coupled_must_be_named(tmp_path):
    (tmp_path / "robot.urdf").write_text(
        """<robot name="robot">
          <link name="base"/>
          {links}
          <joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/>
            <origin xyz="0.3 0 0"/><limit lower="-1" upper="1" effort="5" velocity="3"/></joint>
          <joint name="wrist" type="revolute"><parent link="arm"/><child link="hand"/>
            <origin xyz="0.3 0 0"/><limit lower="-1" upper="1" effort="5" velocity="3"/></joint>
          <joint name="knuckle" type="revolute"><parent link="hand"/><child link="thumb"/>
            <origin xyz="0.1 0 0"/><limit lower="-1" upper="1" effort="5" velocity="3"/>
            <mimic joint="wrist" multiplier="2"/></joint>
        </robot>""".format(links="".join(map(urdf_link, ("arm", "hand", "thumb"))))
    )
    directives = tmp_path / "robot.dmd.yaml"
    directives.write_text(
        "directives:\n- add_model: {name: robot, file: robot.urdf}\n"
        "- add_weld: {parent: world, child: 'robot::base'}\n"
    )
    fields = {"name": "a", "skins": SKINS, "touching": {"tip": {"frame": "thumb", "radius": 0.01}}}

    def world(joints):
        robot = {"directives": str(directives), "joints": joints}
        return World(experiment_from_fields({**fields, "robot": robot}))

    message = (
        "robot.joints is null, but some joints are coupled: 'knuckle' follows 'wrist' (<mimic>); "
        "name the joints that move on their own, as in joints: [shoulder, wrist]: the others are "
        "welded"
    )
    with pytest.raises(ExperimentError, match=f"^{re.escape(message)}$"):
        _ = world(None).robot
    made = world(["wrist", "shoulder"])
    assert made.robot.joint_names == ["shoulder", "wrist"]
    simulation_of(made).rest_at(np.array([0.1, 0.2]))
    simulation_of(made).advance(0.1)
    np.testing.assert_allclose(simulation_of(made).q, [0.1, 0.2], atol=1e-3)


def test_a_joint_with_two_actuators_keeps_one(tmp_path):
    (tmp_path / "robot.xml").write_text(
        """<mujoco model="robot"><worldbody><body name="arm" pos="0.3 0 0">
          <joint name="shoulder" type="hinge" axis="0 0 1" range="-60 60"/>
          <geom type="sphere" size="0.02"/>
          <body name="hand" pos="0.3 0 0"><joint name="wrist" type="hinge" axis="0 1 0"/>
            <geom type="sphere" size="0.02"/></body></body></worldbody>
          <actuator><position joint="shoulder" kp="3"/>
            <velocity joint="shoulder" kv="1"/></actuator>
        </mujoco>"""
    )
    directives = tmp_path / "robot.dmd.yaml"
    directives.write_text("directives:\n- add_model: {name: robot, file: robot.xml}\n")
    world = World(
        experiment_from_fields(
            {
                "name": "a",
                "robot": {"directives": str(directives)},
                "skins": {"torso": {**SKINS["torso"], "link": "world"}},
                "touching": {"hand": {"link": "hand"}},
            }
        )
    )
    assert world.robot.plant.num_actuators() == 2
    simulation_of(world).rest_at(np.array([0.3, -0.4]))
    simulation_of(world).advance(0.2)
    np.testing.assert_allclose(simulation_of(world).q, [0.3, -0.4], atol=1e-3)


def test_the_model_s_own_geometry_is_left_as_it_is(tmp_path):
    world = build(
        tmp_path, BASE, robots.carried("hand", robots.shape("box", size="0.1 0.1 0.1")),
        touching={"hand": {"link": "hand"}},
    )  # fmt: skip
    inspector = world.robot.scene_graph.model_inspector()
    names = sorted(
        inspector.GetName(geometry).split("::")[-1]
        for geometry in inspector.GetAllGeometryIds(Role.kProximity)
    )
    assert names == ["collision_0", "collision_0", "skin_torso", "touching_hand_0"]
