import numpy as np
import robots
from pydrake.multibody.plant import MultibodyPlant

from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot.models import load_model, parse
from selftouch_drake.robot.robot import JointLimits


def test_limits_are_those_of_the_robot_and_the_experiment(cube_world):
    execution = load_experiment("cube", {"execution": {"max_velocity": 0.5}}).execution
    limits = JointLimits.of(cube_world.robot, execution)
    assert np.array_equal(limits.velocity, np.full(6, 0.5))
    assert np.array_equal(limits.acceleration, np.full(6, 5.0))
    assert limits.torque.tolist() == [80.0, 80.0, 60.0, 20.0, 20.0, 20.0]
    assert np.all(limits.lower < limits.upper)


def test_limits_of_several_models_are_in_the_order_of_q(two_arms):
    efforts = dict(zip(two_arms.robot.joint_names, two_arms.limits.torque, strict=True))
    of_model = {"shoulder_yaw": 80, "shoulder_pitch": 80, "elbow_pitch": 60}
    of_model |= {f"wrist_{axis}": 20 for axis in "xyz"}
    assert efforts == {
        f"{side}_arm::{name}": effort
        for side in ("left", "right")
        for name, effort in of_model.items()
    }


def test_the_tighter_limit_of_model_and_experiment_holds(tmp_path):
    def mount(name, parent, **limits):
        return robots.link(name, pose=f"{0.1 * len(name)} 0 0 0 0 0") + robots.joint(
            f"to_{name}", "revolute", parent, name, **limits
        )

    world = robots.build(
        tmp_path,
        robots.link("base"),
        mount("a", "base", velocity=0.25),
        mount("bb", "a", velocity=9.0, effort=7),
        # Zero in a model is what it writes where it says nothing.
        mount("ccc", "bb", velocity=0),
        mount("dddd", "ccc"),
        skins={"skin": {"link": "base", "surface": {"shape": "sphere", "radius": 0.05}}},
        touching={"end": {"frame": "dddd", "radius": 0.01}},
        execution={"max_velocity": 2.0, "max_acceleration": 3.0},
    )
    assert world.limits.velocity.tolist() == [0.25, 2.0, 2.0, 2.0]
    assert world.limits.acceleration.tolist() == [3.0] * 4
    assert world.limits.torque.tolist() == [np.inf, 7.0, np.inf, np.inf]


def test_babbling_stays_within_one_turn_where_there_are_no_limits(tmp_path):
    limits = {"none": None, "all": (-1, 2), "1e16": (-1e16, 1e16), "low": (0.5, 1e16)}
    parts, parent = [robots.link("base")], "base"
    for number, (name, bounds) in enumerate(limits.items(), start=1):
        parts.append(robots.link(name, pose=f"{0.2 * number} 0 0 0 0 0"))
        parts.append(robots.joint(f"to_{name}", "revolute", parent, name, limits=bounds))
        parent = name
    world = robots.build(
        tmp_path,
        *parts,
        skins={"skin": {"link": "base", "surface": {"shape": "sphere", "radius": 0.05}}},
        touching={"end": {"frame": "low", "radius": 0.01}},
    )
    robot = world.robot
    assert robot.joint_names == [f"to_{name}" for name in limits]
    assert robot.lower.tolist() == [-np.inf, -1.0, -np.inf, 0.5]
    assert robot.upper.tolist() == [np.inf, 2.0, np.inf, np.inf]
    lower, upper = robot.babbled_range
    np.testing.assert_allclose(lower, [-np.pi, -1.0, -np.pi, 0.5])
    np.testing.assert_allclose(upper, [np.pi, 2.0, np.pi, 0.5 + 2 * np.pi])


def test_actuators_of_mjcf_are_as_strong_as_in_mujoco(tmp_path):
    actuators = {
        '<motor gear="100" class="weak"/>': 40.0,
        '<motor gear="-50 0 0" ctrlrange="-1 2" forcerange="-3 1"/>': 100.0,
        '<motor gear="10" ctrlrange="-20 20" forcerange="-5 7"/>': 70.0,
        '<motor gear="10" ctrllimited="false"/>': np.inf,
        # The control of a servo is no force.
        '<position gear="3" kp="20" forcerange="-4 4"/>': 12.0,
        '<velocity kv="5"/>': np.inf,
        # All kinds of actuators share their defaults: the control is at most 1.
        '<general gear="2" gainprm="5" forcerange="-9 9"/>': 10.0,
        '<general gear="2" gainprm="5" biastype="affine" forcerange="-9 9"/>': 18.0,
        '<motor forcerange="0 0" ctrlrange="0 0"/>': np.inf,
        '<motor gear="4"/><motor gear="6"/>': 10.0,
    }
    bodies = "".join(
        f"""<body name="link_{k}" pos="0.1 0 0"><geom size="0.02" type="sphere"/>
          <joint name="joint_{k}" type="hinge" axis="0 0 1" range="-60 60"/>"""
        for k in range(len(actuators))
    )
    own = "".join(text.replace("/>", f' joint="joint_{k}"/>') for k, text in enumerate(actuators))
    (tmp_path / "robot.xml").write_text(
        f"""<mujoco model="robot">
          <default><motor ctrlrange="-1 1"/><default class="weak"><motor ctrlrange="-.4 .4"/>
          </default></default>
          <worldbody>{bodies}{"</body>" * len(actuators)}</worldbody>
          <actuator>{own}</actuator></mujoco>"""
    )
    directives = tmp_path / "robot.dmd.yaml"
    directives.write_text("directives:\n- add_model: {name: robot, file: robot.xml}\n")
    plant = MultibodyPlant(time_step=0.0)
    parse(plant, load_model(str(directives), {}))
    indices = plant.GetJointActuatorIndices()
    found = [(a.joint().name(), a.effort_limit()) for a in map(plant.get_joint_actuator, indices)]
    assert {*found} == {(f"joint_{k}", most) for k, most in enumerate(actuators.values())}
    assert len(found) == len(actuators)
