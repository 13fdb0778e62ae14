"""Which joints of a robot move: those are given actuators, and all others are welded."""

from collections.abc import Iterable, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, PrismaticJoint, RevoluteJoint, WeldJoint

from selftouch_drake.experiment import Experiment, ExperimentError
from selftouch_drake.robot.links import all_joints, find_named
from selftouch_drake.robot.models import RobotModel, parse

# rad or m: models that write 1e16 for a joint without limits mean that it has none.
_NO_LIMIT = 1e10


def fix_joints(plant: MultibodyPlant, experiment: Experiment, model: RobotModel) -> None:
    """Welds joints that do not move at their default positions, and checks those that move.

    Each joint that moves gets one actuator, if its model gives it none. Joints move independently:
    where a model couples joints, `robot.joints` says which ones move; the coupling is ignored. The
    plant holds the robot of the model, and is not yet finalized.

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
    joints = all_joints(plant)
    moving = _moving_joints(plant, experiment.robot.joints)
    _remove_couplings(plant, chosen=experiment.robot.joints is not None)
    for joint in moving:
        _check_limits(joint)
    _give_actuators(plant, moving)
    numbers = {int(joint.index()) for joint in moving}
    still = [j for j in joints if j.num_positions() and int(j.index()) not in numbers]
    _weld(plant, still, bare)


def find_movable_joint(plant: MultibodyPlant, name: str, field: str) -> Joint:
    """The joint that a field of the experiment names.

    Raises:
        ExperimentError: there is none, or it neither turns about one axis nor slides along one.
    """
    joint = find_named(plant, all_joints(plant), name, field, "joint")
    if not _can_move(joint):
        raise ExperimentError(
            f"{field} is {name!r}, a {joint.type_name()} joint; name joints that turn about one "
            "axis or slide along one"
        )
    return joint


def _can_move(joint: Joint) -> bool:
    return isinstance(joint, RevoluteJoint | PrismaticJoint)


def _moving_joints(plant: MultibodyPlant, names: Sequence[str] | None) -> list[Joint]:
    """The joints that move, in the order of the plant: those named, or all that can."""
    if names is None:
        moving = [joint for joint in all_joints(plant) if _can_move(joint)]
    else:
        moving = [
            find_movable_joint(plant, name, f"robot.joints[{number}]")
            for number, name in enumerate(names)
        ]
        moving.sort(key=lambda joint: int(joint.index()))
        if len({int(joint.index()) for joint in moving}) < len(moving):
            raise ExperimentError(f"robot.joints is {list(names)}; name each joint once")
    if not moving:
        raise ExperimentError(
            "robot.directives has no joint that moves; give a robot with joints that turn or slide"
        )
    return moving


def _remove_couplings(plant: MultibodyPlant, *, chosen: bool) -> None:
    """Removes all couplings between joints, if the experiment has chosen which joints move."""
    constraints = plant.GetConstraintIds()
    if constraints and not chosen:
        raise ExperimentError(
            "robot.joints is null, but some joints of the model are coupled (as by <mimic>); name "
            "those that move independently"
        )
    for constraint in constraints:
        plant.RemoveConstraint(constraint)


def _check_limits(joint: Joint) -> None:
    """Checks the limits of a joint, and sets those that mean no limit to infinity."""
    lower, upper = (
        limit if abs(limit) < _NO_LIMIT else np.copysign(np.inf, limit)
        for limit in (joint.position_lower_limit(), joint.position_upper_limit())
    )
    if isinstance(joint, PrismaticJoint) and not (np.isfinite(lower) and np.isfinite(upper)):
        raise ExperimentError(
            f"joint {joint.name()!r} slides without limits; give it limits in its model"
        )
    if lower >= upper:
        raise ExperimentError(
            f"joint {joint.name()!r} has the limits {lower:g} and {upper:g}, so it cannot "
            "move; correct its model, or name the other joints in robot.joints"
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


def _weld(plant: MultibodyPlant, joints: Iterable[Joint], bare: MultibodyPlant) -> None:
    """Welds joints at their default positions, as a finalized plant of the same model has them."""
    context = bare.CreateDefaultContext()
    for joint in joints:
        # By name and model: a plant's elements are its own.
        model_name = plant.GetModelInstanceName(joint.model_instance())
        twin = bare.GetJointByName(joint.name(), bare.GetModelInstanceByName(model_name))
        X_PC = twin.frame_on_child().CalcPose(context, twin.frame_on_parent())
        name, on_parent, on_child = joint.name(), joint.frame_on_parent(), joint.frame_on_child()
        plant.RemoveJoint(joint)
        plant.AddJoint(WeldJoint(f"{name}_fixed", on_parent, on_child, X_PC))
