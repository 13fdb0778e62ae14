"""Which joints of a robot move: the others are welded where they are by default."""

from __future__ import annotations

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, PrismaticJoint, RevoluteJoint, WeldJoint

from selftouch_drake.experiment import Experiment, ExperimentError
from selftouch_drake.robot.links import find_joint
from selftouch_drake.robot.models import RobotModel, parse


def fix_joints(plant: MultibodyPlant, experiment: Experiment, model: RobotModel) -> None:
    """Welds every joint that does not move where it is by default, and checks those that do."""
    bare = MultibodyPlant(time_step=0.0)
    parse(bare, model)
    bare.Finalize()
    context = bare.CreateDefaultContext()
    if free := [bare.get_body(i).name() for i in sorted(bare.GetFloatingBaseBodies())]:
        raise ExperimentError(
            f"robot.directives leaves {free[0]!r} free to float; weld it to the world (add_weld)"
        )
    joints = [plant.get_joint(i) for i in plant.GetJointIndices()]
    names = experiment.robot.joints
    if names is None:
        moving = {int(j.index()) for j in joints if _can_move(j)}
    else:
        chosen = [
            find_joint(plant, name, f"robot.joints[{number}]") for number, name in enumerate(names)
        ]
        for number, joint in enumerate(chosen):
            if not _can_move(joint):
                raise ExperimentError(
                    f"robot.joints[{number}] is {names[number]!r}, a {joint.type_name()} joint; "
                    "name joints that turn about one axis or slide along one"
                )
        moving = {int(j.index()) for j in chosen}
        if len(moving) < len(chosen):
            raise ExperimentError(f"robot.joints is {names}; name each joint once")
    if not moving:
        raise ExperimentError(
            "robot.directives has no joint that moves; give a robot with joints that turn or slide"
        )
    actuated = {}
    for index in list(plant.GetJointActuatorIndices()):
        actuator = plant.get_joint_actuator(index)
        if int(actuator.joint().index()) in moving:
            actuated[int(actuator.joint().index())] = actuator
        else:
            plant.RemoveJointActuator(actuator)
    for joint in joints:
        if int(joint.index()) in moving:
            _require_range(joint)
            if int(joint.index()) not in actuated:
                plant.AddJointActuator(f"{joint.name()}_actuator", joint)
        elif joint.num_positions():
            # By name and model: a plant's elements are its own.
            instance = bare.GetModelInstanceByName(
                plant.GetModelInstanceName(joint.model_instance())
            )
            twin = bare.GetJointByName(joint.name(), instance)
            X_PC = twin.frame_on_child().CalcPose(context, twin.frame_on_parent())
            on_parent, on_child, name = (
                joint.frame_on_parent(),
                joint.frame_on_child(),
                joint.name(),
            )
            plant.RemoveJoint(joint)
            plant.AddJoint(WeldJoint(f"{name}_fixed", on_parent, on_child, X_PC))


def _can_move(joint: Joint) -> bool:
    return isinstance(joint, RevoluteJoint | PrismaticJoint)


def _require_range(joint: Joint) -> None:
    lower, upper = joint.position_lower_limit(), joint.position_upper_limit()
    if isinstance(joint, PrismaticJoint) and not (np.isfinite(lower) and np.isfinite(upper)):
        raise ExperimentError(
            f"joint {joint.name()!r} slides without limits; give it limits in its model"
        )
    if lower >= upper:
        raise ExperimentError(
            f"joint {joint.name()!r} has the limits {lower:g} and {upper:g}, no range to move in; "
            "mend its model, or name the other joints in robot.joints"
        )
