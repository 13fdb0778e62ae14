"""Which joints of a robot move: those are given actuators, and all others are welded."""

from collections.abc import Iterable, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, PrismaticJoint, RevoluteJoint, WeldJoint

from selftouch_drake.experiment import Experiment, ExperimentError
from selftouch_drake.robot.facts import Parsed, check_facts
from selftouch_drake.robot.links import all_joints, find_named
from selftouch_drake.robot.models import RobotModel, parse

# rad or m: models that write 1e16 for a joint without limits mean that it has none.
_NO_LIMIT = 1e10


def fix_joints(
    plant: MultibodyPlant, experiment: Experiment, model: RobotModel, parsed: Parsed
) -> None:
    """Welds joints that do not move at their default positions, and checks those that move.

    Each joint that moves gets one actuator, if its model gives it none. Joints move independently:
    where a model couples joints, or has other kinds of joints, `robot.joints` says which ones move;
    the coupling is ignored. The plant holds the robot of the model, as `parsed`, and is not yet
    finalized.

    Raises:
        ExperimentError: a part floats freely, Drake did not read what a file says, or a joint
            cannot move as it is asked to.
    """
    bare = MultibodyPlant(time_step=0.0)
    facts = parse(bare, model)
    bare.Finalize()
    check_facts(bare, facts)
    if free := [bare.get_body(i).name() for i in sorted(bare.GetFloatingBaseBodies())]:
        raise ExperimentError(
            f"robot.directives leaves {free[0]!r} free to float; weld it to the world (add_weld)"
        )
    joints = all_joints(plant)
    chosen = experiment.robot.joints
    if chosen is None:
        _require_free_joints(joints, plant, parsed)
    moving = _moving_joints(plant, chosen)
    for constraint in plant.GetConstraintIds():
        plant.RemoveConstraint(constraint)
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


def _require_free_joints(joints: Sequence[Joint], plant: MultibodyPlant, parsed: Parsed) -> None:
    """Refuses a robot whose joints do not all move on their own, each in one way.

    Raises:
        ExperimentError: a joint follows others, a loop is closed, or a joint moves in several ways;
            the text has the joints that can be named in `robot.joints`.
    """
    followers = {name: how for _, facts in parsed.models for name, how in facts.followers.items()}
    loops = [loop for _, facts in parsed.models for loop in facts.loops]
    free = [joint.name() for joint in joints if _can_move(joint) and joint.name() not in followers]
    if not free:
        return  # there is nothing to name
    others = [j for j in joints if j.num_positions() and not _can_move(j)]
    if others:
        kind = _KINDS.get(others[0].type_name(), f"{others[0].type_name()} joint")
        reason = f"joint {others[0].name()!r} is a {kind}"
    elif followers:
        reason = "some joints are coupled: " + ", ".join(
            f"{name!r} {how}" for name, how in list(followers.items())[:_MOST_NAMED]
        )
    elif loops:
        reason = f"{loops[0]} closes a loop between bodies"
    elif plant.GetConstraintIds():
        reason = "some joints are coupled"
    else:
        return
    raise ExperimentError(
        f"robot.joints is null, but {reason}; name the joints that move on their own, as in "
        f"joints: [{', '.join(free)}]: the others are welded"
    )


# How a joint moves that does not turn about one axis or slide along one.
_KINDS = {
    "ball_rpy": "ball joint",
    "quaternion_floating": "free joint",
    "rpy_floating": "free joint",
    "planar": "planar joint",
    "screw": "screw",
    "universal": "universal joint",
}
# Joints that an error explains.
_MOST_NAMED = 4


def _check_limits(joint: Joint) -> None:
    """Checks the limits of a joint, and sets those that mean no limit to infinity."""
    lower, upper = (
        limit if abs(limit) < _NO_LIMIT else np.copysign(np.inf, limit)
        for limit in (joint.position_lower_limit(), joint.position_upper_limit())
    )
    if isinstance(joint, PrismaticJoint) and not (np.isfinite(lower) and np.isfinite(upper)):
        raise ExperimentError(
            f"joint {joint.name()!r} slides without limits; give it limits in its model, or leave "
            "it out of robot.joints"
        )
    if lower >= upper:
        # As for urdfdom, a limit that a URDF leaves out is 0.
        left_out = " (in URDF, a limit that is left out is 0)" if lower == upper == 0 else ""
        raise ExperimentError(
            f"joint {joint.name()!r} has the limits {lower:g} and {upper:g}, so it cannot move; "
            f"correct its model{left_out}, or name the other joints in robot.joints"
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
