# ruff: noqa: E501  (lines as they are printed)
import robots

from selftouch_drake.robot.describe import describe

TWO_ARMS = """\
12 joints move
  left_arm::shoulder_yaw     turns  -3.14 to 3.14 rad  80 N·m
  left_arm::shoulder_pitch   turns  -1 to 2.6 rad      80 N·m
  left_arm::elbow_pitch      turns  -2.6 to 2.6 rad    60 N·m
  left_arm::wrist_x          turns  -3.14 to 3.14 rad  20 N·m
  left_arm::wrist_y          turns  -2 to 2 rad        20 N·m
  left_arm::wrist_z          turns  -3.14 to 3.14 rad  20 N·m
  right_arm::shoulder_yaw    turns  -3.14 to 3.14 rad  80 N·m
  right_arm::shoulder_pitch  turns  -1 to 2.6 rad      80 N·m
  right_arm::elbow_pitch     turns  -2.6 to 2.6 rad    60 N·m
  right_arm::wrist_x         turns  -3.14 to 3.14 rad  20 N·m
  right_arm::wrist_y         turns  -2 to 2 rad        20 N·m
  right_arm::wrist_z         turns  -3.14 to 3.14 rad  20 N·m

3 skins
  body           on body::body          3190 cm²  30 mm thick  100 receptors
  left_forearm   on left_arm::forearm   979 cm²   20 mm thick  40 receptors   moves
  right_forearm  on right_arm::forearm  979 cm²   20 mm thick  40 receptors   moves

What touches what
  left_fingertip   on left_hand::hand_mount   touches body, right_forearm  not left_forearm: next to it
  right_fingertip  on right_hand::hand_mount  touches body, left_forearm   not right_forearm: next to it

No links can run into each other: they have no collision geometry that could"""
GANTRY = """\
5 joints move
  gantry::rail_x        slides  -0.4 to 0.4 m      300 N
  gantry::rail_y        slides  -0.4 to 0.4 m      200 N
  gantry::rail_z        slides  -0.4 to 0.4 m      200 N
  gantry::finger_yaw    turns   -3.14 to 3.14 rad  20 N·m
  gantry::finger_pitch  turns   -1.3 to 1.6 rad    20 N·m

1 skin
  body  on body::body  7771 cm²  30 mm thick  100 receptors

What touches what
  fingertip  on gantry::finger  touches body

No links can run into each other: they have no collision geometry that could"""


def test_two_arms(two_arms):
    assert describe(two_arms) == TWO_ARMS


def test_a_gantry():
    assert describe(robots.shipped("gantry")) == GANTRY


def test_an_infant():
    title, *pairs = describe(robots.shipped("infant")).split("\n\n")[-1].splitlines()
    assert title == "23 pairs of rigid links must not run into each other"
    # Collision depth, and 12 mm of the torso's skin and 8 mm of the forearm's.
    assert pairs[0].split(None, 2) == ["torso", "left_upper_arm", "at most 25 mm deep"]
    assert pairs[-1] == "  and 11 more"
    assert len(pairs) == 13


def test_a_skin_on_what_is_fixed_to_a_moving_link_moves(tmp_path):
    world = robots.build(
        tmp_path,
        robots.link("base"),
        robots.link("arm", pose="0.3 0 0 0 0 0"),
        robots.link("sleeve", pose="0.5 0 0 0 0 0"),
        robots.joint("turn", "continuous", "base", "arm", limits=None),
        robots.joint("bend", "revolute", "arm", "sleeve", effort=3),
        robots.carried("ball"),
        robot={"joints": ["turn", *(f"ball_{part}_joint" for part in ("x", "y", "z", "pitch"))]},
        skins={
            "still": {"link": "base", "surface": {"shape": "cube", "side": 0.1}, "thickness": 0.01},
            "sleeve": {"link": "sleeve", "surface": {"shape": "sphere", "radius": 0.05}},
        },
        touching={"ball": {"frame": "ball", "radius": 0.01}},
    )
    lines = [line.split() for line in describe(world).splitlines()]
    (still,) = (line for line in lines if line[:2] == ["still", "on"])
    (sleeve,) = (line for line in lines if line[:2] == ["sleeve", "on"])
    assert still[-1] == "receptors"
    assert sleeve[-1] == "moves"
    assert next(line for line in lines if line[0] == "robot::turn")[:8] == [
        "robot::turn",
        "turns",
        "no",
        "limits;",
        "babbles",
        "within",
        "one",
        "turn",
    ]
