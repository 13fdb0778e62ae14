"""The joints of a robot: moved by changes of its body, and welded where they do not move."""

from collections import defaultdict
from collections.abc import Iterable

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Frame,
    Joint,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    WeldJoint,
)

from selftouch_drake.experiment import Experiment, ExperimentError
from selftouch_drake.experiment.schema import SkinChange
from selftouch_drake.robot.links import all_joints, find_link, find_named
from selftouch_drake.robot.models import RobotModel, parse

# rad or m: models that write 1e16 for a joint without limits mean that it has none.
_NO_LIMIT = 1e10


def change_joints(plant: MultibodyPlant, experiment: Experiment) -> None:
    """Moves the joints of a plant according to grown links and shifted zeros.

    What hangs on a grown link moves away from the joint that carries the link. The link's own
    geometry stays as its model has it. The plant is not yet finalized.

    Raises:
        ExperimentError: a change names what the robot does not have, or a joint that cannot move.
    """
    zeros: dict[int, float] = defaultdict(float)
    for number, change in enumerate(experiment.body_changes):
        for name, moved in change.joints.items():
            zeros[int(_movable(plant, name, f"changes[{number}].joints").index())] += moved
    for joint in all_joints(plant):
        on_parent = frame_after(plant, experiment, joint.frame_on_parent())
        zero = zeros[int(joint.index())]
        if zero or on_parent is not joint.frame_on_parent():
            _replace(plant, joint, on_parent, zero)


def frame_after(plant: MultibodyPlant, experiment: Experiment, frame: Frame) -> Frame:
    """A frame of a plant after its link grew: a new frame, or the same if nothing moved."""
    scale, shift = _growth(plant, experiment, frame.body())
    X_LF = frame.GetFixedPoseInBodyFrame()
    p_LF = scale * X_LF.translation() + shift
    if np.array_equal(p_LF, X_LF.translation()):
        return frame
    body, name = frame.body(), f"{frame.name()}_grown_{plant.num_frames()}"
    X_LG = RigidTransform(X_LF.rotation(), p_LF)
    return plant.AddFrame(FixedOffsetFrame(name, body.body_frame(), X_LG))


def skin_motion(
    plant: MultibodyPlant, experiment: Experiment, name: str
) -> tuple[np.ndarray, np.ndarray] | None:
    """The displacement of a skin since it was made: a point p in its link's frame is at A p + b.

    Returns:
        A `(3, 3)` and b `(3,)` m; None if nothing changed.
    """
    if not experiment.body_changes:
        return None
    A, b = np.eye(3), np.zeros(3)
    for change in experiment.body_changes:
        what = change.skins.get(name, SkinChange())
        R = RollPitchYaw(np.radians(what.rpy_deg)).ToRotationMatrix().matrix()
        A, b = what.stretch * R @ A, what.stretch * R @ b + what.translation
    link = find_link(plant, experiment.skins[name].link, f"skins.{name}.link")
    scale, shift = _growth(plant, experiment, link)
    return scale * A, scale * b + shift


def _growth(
    plant: MultibodyPlant, experiment: Experiment, link: RigidBody
) -> tuple[float, np.ndarray]:
    """Factor and shift (`(3,)` m) of the places on a link that grew, 1 and 0 if it did not."""
    scale = 1.0
    for number, change in enumerate(experiment.body_changes):
        for name, share in change.links.items():
            grown = find_link(plant, name, f"changes[{number}].links")
            scale *= 1.0 + share * (grown.index() == link.index())
    # About the joint that carries the link.
    for joint in all_joints(plant):
        if joint.child_body().index() == link.index():
            p_LJ = joint.frame_on_child().GetFixedPoseInBodyFrame().translation()
            return scale, (1.0 - scale) * p_LJ
    return scale, np.zeros(3)


def _replace(plant: MultibodyPlant, joint: Joint, on_parent: Frame, zero: float) -> None:
    """Moves a joint to another frame of its parent and shifts its zero."""
    name, on_child = joint.name(), joint.frame_on_child()
    if isinstance(joint, WeldJoint):
        X_FM = joint.X_FM()
        plant.RemoveJoint(joint)
        plant.AddJoint(WeldJoint(name, on_parent, on_child, X_FM))
        return
    turns = isinstance(joint, RevoluteJoint)
    if not turns and not isinstance(joint, PrismaticJoint):
        raise ExperimentError(
            f"changes[].links moves joint {name!r}, a {joint.type_name()} joint; grow links that "
            "carry joints that turn about one axis or slide along one"
        )
    axis = joint.revolute_axis() if turns else joint.translation_axis()
    make = RevoluteJoint if turns else PrismaticJoint
    lower, upper = joint.position_lower_limit(), joint.position_upper_limit()
    start, damping = joint.default_positions(), joint.default_damping_vector()
    speed = joint.velocity_lower_limits(), joint.velocity_upper_limits()
    acceleration = joint.acceleration_lower_limits(), joint.acceleration_upper_limits()
    actuators = [
        (a.name(), a.effort_limit(), a.default_rotor_inertia(), a.default_gear_ratio())
        for a in map(plant.get_joint_actuator, list(plant.GetJointActuatorIndices()))
        if a.joint().index() == joint.index()
    ]
    for actuator in actuators:
        plant.RemoveJointActuator(plant.GetJointActuatorByName(actuator[0], joint.model_instance()))
    if zero:
        moved = RigidTransform(zero * axis)
        X_FZ = RigidTransform(AngleAxis(zero, axis), np.zeros(3)) if turns else moved
        on_parent = plant.AddFrame(
            FixedOffsetFrame(f"{name}_zero_{plant.num_frames()}", on_parent, X_FZ)
        )
    plant.RemoveJoint(joint)
    new = plant.AddJoint(make(name, on_parent, on_child, axis, lower - zero, upper - zero))
    new.set_default_positions(np.clip(start, lower - zero, upper - zero))
    new.set_default_damping_vector(damping)
    new.set_velocity_limits(*speed)
    new.set_acceleration_limits(*acceleration)
    for actuator, effort, inertia, ratio in actuators:
        added = plant.AddJointActuator(actuator, new, effort)
        added.set_default_rotor_inertia(inertia)
        added.set_default_gear_ratio(ratio)


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
    moving = [joint for joint in joints if _can_move(joint)]
    if (names := experiment.robot.joints) is not None:
        moving = [_movable(plant, name, f"robot.joints[{n}]") for n, name in enumerate(names)]
        moving.sort(key=lambda joint: int(joint.index()))
    numbers = {int(joint.index()) for joint in moving}
    if len(numbers) < len(moving):
        raise ExperimentError(f"robot.joints is {list(names or ())}; name each joint once")
    if not moving:
        raise ExperimentError(
            "robot.directives has no joint that moves; give a robot with joints that turn or slide"
        )
    constraints = plant.GetConstraintIds()
    if constraints and names is None:
        raise ExperimentError(
            "robot.joints is null, but some joints of the model are coupled (as by <mimic>); name "
            "those that move independently"
        )
    for constraint in constraints:
        plant.RemoveConstraint(constraint)
    for joint in moving:
        lower, upper = joint.position_lower_limit(), joint.position_upper_limit()
        lower, upper = (x if abs(x) < _NO_LIMIT else np.copysign(np.inf, x) for x in (lower, upper))
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
    _give_actuators(plant, moving)
    context = bare.CreateDefaultContext()
    for joint in joints:
        if joint.num_positions() and int(joint.index()) not in numbers:
            # By name and model: a plant's elements are its own.
            model_name = plant.GetModelInstanceName(joint.model_instance())
            twin = bare.GetJointByName(joint.name(), bare.GetModelInstanceByName(model_name))
            X_PC = twin.frame_on_child().CalcPose(context, twin.frame_on_parent())
            name, ends = joint.name(), (joint.frame_on_parent(), joint.frame_on_child())
            plant.RemoveJoint(joint)
            plant.AddJoint(WeldJoint(f"{name}_fixed", *ends, X_PC))


def _movable(plant: MultibodyPlant, name: str, field: str) -> Joint:
    joint = find_named(plant, all_joints(plant), name, field, "joint")
    if not _can_move(joint):
        raise ExperimentError(
            f"{field} is {name!r}, a {joint.type_name()} joint; name joints that turn about one "
            "axis or slide along one"
        )
    return joint


def _can_move(joint: Joint) -> bool:
    return isinstance(joint, RevoluteJoint | PrismaticJoint)


def _give_actuators(plant: MultibodyPlant, moving: Iterable[Joint]) -> None:
    """Leaves each joint that moves one actuator, and the others none."""
    without = {int(joint.index()): joint for joint in moving}
    for index in list(plant.GetJointActuatorIndices()):
        actuator = plant.get_joint_actuator(index)
        if without.pop(int(actuator.joint().index()), None) is None:
            plant.RemoveJointActuator(actuator)
    for joint in without.values():
        plant.AddJointActuator(f"{joint.name()}_actuator", joint)
