"""The joints of a robot that move; the others are welded at their default positions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, PrismaticJoint, RevoluteJoint, WeldJoint

from selftouch_drake.experiment import Experiment, ExperimentError
from selftouch_drake.robot.links import find_joint
from selftouch_drake.robot.models import RobotModel, parse

# rad or m: models that write 1e16 for a joint without limits mean that it has none.
_NO_LIMIT = 1e10


def fix_joints(plant: MultibodyPlant, experiment: Experiment, model: RobotModel) -> None:
    """Welds joints that do not move at their default positions, and checks those that move.

    Each joint that moves gets one actuator, if its model gives it none. Joints move independently:
    where a model couples joints, `robot.joints` says which ones move; the coupling is ignored.

    Args:
        plant: holds the robot, and is not yet finalized.
        experiment: names the joints that move.
        model: of the robot.

    Raises:
        ExperimentError: a part floats freely, or a joint cannot move as it is asked to.
    """
    bare = MultibodyPlant(time_step=0.0)
    parse(bare, model)
    bare.Finalize()
    if free := [bare.get_body(i).name() for i in sorted(bare.GetFloatingBaseBodies())]:
        raise ExperimentError(
            f"robot.directives leaves {free[0]!r} free to float; weld it to the world (add_weld)"
        )
    joints = [plant.get_joint(i) for i in plant.GetJointIndices()]
    moving = _chosen(plant, joints, experiment.robot.joints)
    if not moving:
        raise ExperimentError(
            "robot.directives has no joint that moves; give a robot with joints that turn or slide"
        )
    _remove_couplings(plant, experiment)
    for joint in moving:
        _require_range(joint)
    _give_actuators(plant, moving)
    numbers = {int(joint.index()) for joint in moving}
    for joint in joints:
        if joint.num_positions() and int(joint.index()) not in numbers:
            _weld(plant, joint, bare)


def _chosen(
    plant: MultibodyPlant, joints: Iterable[Joint], names: Sequence[str] | None
) -> list[Joint]:
    if names is None:
        return [joint for joint in joints if _can_move(joint)]
    chosen = []
    for number, name in enumerate(names):
        joint = find_joint(plant, name, f"robot.joints[{number}]")
        if not _can_move(joint):
            raise ExperimentError(
                f"robot.joints[{number}] is {name!r}, a {joint.type_name()} joint; name joints "
                "that turn about one axis or slide along one"
            )
        chosen.append(joint)
    if len({int(joint.index()) for joint in chosen}) < len(chosen):
        raise ExperimentError(f"robot.joints is {list(names)}; name each joint once")
    return sorted(chosen, key=lambda joint: int(joint.index()))


def _can_move(joint: Joint) -> bool:
    return isinstance(joint, RevoluteJoint | PrismaticJoint)


def _remove_couplings(plant: MultibodyPlant, experiment: Experiment) -> None:
    constraints = plant.GetConstraintIds()
    if constraints and experiment.robot.joints is None:
        raise ExperimentError(
            "robot.joints is null, but some joints of the model are coupled (as by <mimic>); name "
            "those that move independently"
        )
    for constraint in constraints:
        plant.RemoveConstraint(constraint)


def _require_range(joint: Joint) -> None:
    lower, upper = joint.position_lower_limit(), joint.position_upper_limit()
    lower, upper = (x if abs(x) < _NO_LIMIT else np.copysign(np.inf, x) for x in (lower, upper))
    if isinstance(joint, PrismaticJoint) and not (np.isfinite(lower) and np.isfinite(upper)):
        raise ExperimentError(
            f"joint {joint.name()!r} slides without limits; give it limits in its model"
        )
    if lower >= upper:
        raise ExperimentError(
            f"joint {joint.name()!r} has the limits {lower:g} and {upper:g}, so it cannot move; "
            "correct its model, or name the other joints in robot.joints"
        )
    joint.set_position_limits([lower], [upper])


def _give_actuators(plant: MultibodyPlant, moving: Iterable[Joint]) -> None:
    """Leaves each joint that moves one actuator, and the others none."""
    without = {int(joint.index()): joint for joint in moving}
    for index in list(plant.GetJointActuatorIndices()):
        actuator = plant.get_joint_actuator(index)
        if without.pop(int(actuator.joint().index()), None) is None:
            plant.RemoveJointActuator(actuator)
    for joint in without.values():
        plant.AddJointActuator(f"{joint.name()}_actuator", joint)


def _weld(plant: MultibodyPlant, joint: Joint, bare: MultibodyPlant) -> None:
    # By name and model: a plant's elements are its own.
    instance = bare.GetModelInstanceByName(plant.GetModelInstanceName(joint.model_instance()))
    twin = bare.GetJointByName(joint.name(), instance)
    context = bare.CreateDefaultContext()
    X_PC = twin.frame_on_child().CalcPose(context, twin.frame_on_parent())
    name, on_parent, on_child = joint.name(), joint.frame_on_parent(), joint.frame_on_child()
    plant.RemoveJoint(joint)
    plant.AddJoint(WeldJoint(f"{name}_fixed", on_parent, on_child, X_PC))
