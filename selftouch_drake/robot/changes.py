"""Changes of a robot's body: links that grew, joints whose zero shifted, skins that moved."""

from collections import defaultdict
from dataclasses import dataclass
from typing import Self

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Frame,
    Joint,
    JointActuator,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    WeldJoint,
)

from selftouch_drake.experiment import Experiment, ExperimentError
from selftouch_drake.experiment.schema import SkinChange
from selftouch_drake.robot.joints import find_movable_joint
from selftouch_drake.robot.links import all_joints, find_link


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
            joint = find_movable_joint(plant, name, f"changes[{number}].joints")
            zeros[int(joint.index())] += moved
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


def with_tool(plant: MultibodyPlant, experiment: Experiment, toucher: str, frame: Frame) -> Frame:
    """Where a toucher touches with the tool that it took last: a new frame, or its own if none."""
    taken = [change.tools[toucher] for change in experiment.body_changes if toucher in change.tools]
    if not taken or not any(taken[-1]):
        return frame
    X_LF = frame.GetFixedPoseInBodyFrame()
    X_LT = RigidTransform(X_LF.rotation(), X_LF.multiply(np.array(taken[-1], dtype=float)))
    name = f"{frame.name()}_tool_{plant.num_frames()}"
    return plant.AddFrame(FixedOffsetFrame(name, frame.body().body_frame(), X_LT))


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
    """Moves a joint to another frame of its parent and shifts its zero by rad or m."""
    if isinstance(joint, WeldJoint):
        name, on_child, X_FM = joint.name(), joint.frame_on_child(), joint.X_FM()
        plant.RemoveJoint(joint)
        plant.AddJoint(WeldJoint(name, on_parent, on_child, X_FM))
        return
    if not isinstance(joint, RevoluteJoint | PrismaticJoint):
        raise ExperimentError(
            f"changes[].links moves joint {joint.name()!r}, a {joint.type_name()} joint; grow "
            "links that carry joints that turn about one axis or slide along one"
        )
    actuators = _remove_actuators(plant, joint)
    new = _moved_joint(plant, joint, on_parent, zero)
    for actuator in actuators:
        added = plant.AddJointActuator(actuator.name, new, actuator.effort_limit)
        added.set_default_rotor_inertia(actuator.rotor_inertia)
        added.set_default_gear_ratio(actuator.gear_ratio)


def _moved_joint(
    plant: MultibodyPlant, joint: RevoluteJoint | PrismaticJoint, on_parent: Frame, zero: float
) -> Joint:
    """Puts a joint in the place of one without actuators; its zero is shifted by rad or m.

    Its limits, damping and default position are those of the old joint, as far as they still fit.
    """
    turns = isinstance(joint, RevoluteJoint)
    axis = joint.revolute_axis() if turns else joint.translation_axis()
    name, on_child = joint.name(), joint.frame_on_child()
    lower, upper = joint.position_lower_limit() - zero, joint.position_upper_limit() - zero
    start = joint.default_positions()
    damping = joint.default_damping_vector()
    velocity_limits = joint.velocity_lower_limits(), joint.velocity_upper_limits()
    acceleration_limits = joint.acceleration_lower_limits(), joint.acceleration_upper_limits()
    if zero:
        X_FZ = (
            RigidTransform(AngleAxis(zero, axis), np.zeros(3))
            if turns
            else RigidTransform(zero * axis)
        )
        on_parent = plant.AddFrame(
            FixedOffsetFrame(f"{name}_zero_{plant.num_frames()}", on_parent, X_FZ)
        )
    plant.RemoveJoint(joint)
    kind = RevoluteJoint if turns else PrismaticJoint
    new = plant.AddJoint(kind(name, on_parent, on_child, axis, lower, upper))
    new.set_default_positions(np.clip(start, lower, upper))
    new.set_default_damping_vector(damping)
    new.set_velocity_limits(*velocity_limits)
    new.set_acceleration_limits(*acceleration_limits)
    return new


@dataclass(frozen=True, slots=True, kw_only=True)
class _Actuator:
    """What is known of an actuator, to make another like it for a joint that is replaced."""

    name: str
    effort_limit: float
    rotor_inertia: float
    gear_ratio: float

    @classmethod
    def like(cls, actuator: JointActuator) -> Self:
        return cls(
            name=actuator.name(),
            effort_limit=actuator.effort_limit(),
            rotor_inertia=actuator.default_rotor_inertia(),
            gear_ratio=actuator.default_gear_ratio(),
        )


def _remove_actuators(plant: MultibodyPlant, joint: Joint) -> list[_Actuator]:
    """Removes the actuators of a joint, and says what they were."""
    actuators = [
        _Actuator.like(actuator)
        for actuator in map(plant.get_joint_actuator, list(plant.GetJointActuatorIndices()))
        if actuator.joint().index() == joint.index()
    ]
    for actuator in actuators:
        found = plant.GetJointActuatorByName(actuator.name, joint.model_instance())
        plant.RemoveJointActuator(found)
    return actuators
