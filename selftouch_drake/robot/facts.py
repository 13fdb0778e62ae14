"""What a model's file says that Drake's parser leaves out or reads in another way."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydrake.geometry import GeometryId, Role, SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex, RevoluteJoint, RigidBody
from pydrake.systems.framework import Context

from selftouch_drake.experiment import ExperimentError

# m, and without unit: a body's pose and a joint's axis in Drake differ from the file's by rounding.
_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFacts:
    """A joint that turns or slides, as a file describes it.

    Attributes:
        lower: rad or m; minus infinity without limit.
        upper: rad or m; infinity without limit.
        effort: N·m or N, the most that its actuators exert together; infinity without limit.
        armature: kg·m² or kg, inertia of what drives it.
        is_driven: whether the file gives it an actuator, which Drake does not see.
        placed: the body that it moves, and `(2, 3)` its axis and a place on it, m, in that body's
            frame; None where Drake is trusted with them.
    """

    lower: float
    upper: float
    effort: float = math.inf
    armature: float = 0.0
    is_driven: bool = False
    placed: tuple[str, np.ndarray] | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelFacts:
    """What is known of one model beside what Drake makes of it.

    Attributes:
        path: the file as its author wrote it, for messages.
        joints: the joints that turn or slide, by name.
        followers: joints that the model couples to others or holds, by name, and how.
        loops: what closes loops between bodies, in words.
        notes: what was left out of the file, in words.
        contact_bits: `contype` and `conaffinity` of geometries that collide, by name.
        excluded: pairs of bodies whose geometries never collide.
        paired: pairs of geometries that collide whatever else is said.
        poses: the parent of each body that hangs on another one, and its `(3, 4)` pose there, m,
            at the default position.
    """

    path: Path
    joints: Mapping[str, JointFacts] = field(default_factory=dict)
    followers: Mapping[str, str] = field(default_factory=dict)
    loops: Sequence[str] = ()
    notes: Sequence[str] = ()
    contact_bits: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    excluded: frozenset[frozenset[str]] = frozenset()
    paired: frozenset[frozenset[str]] = frozenset()
    poses: Mapping[str, tuple[str, np.ndarray]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Parsed:
    """What is known of a plant's models beside the plant.

    Attributes:
        models: the number of each model in the plant, and its facts.
        logged: what Drake said while it read them.
    """

    models: Sequence[tuple[ModelInstanceIndex, ModelFacts]]
    logged: Sequence[str]


def apply_facts(plant: MultibodyPlant, model: ModelInstanceIndex, facts: ModelFacts) -> None:
    """Gives joints the limits, efforts and inertias of their file; not yet finalized."""
    for name, of_joint in facts.joints.items():
        if plant.HasJointNamed(name, model):
            joint = plant.GetJointByName(name, model)
            if joint.num_positions() == 1:
                joint.set_position_limits([of_joint.lower], [of_joint.upper])
    _limit_efforts(plant, model, facts.joints)


def _limit_efforts(
    plant: MultibodyPlant, model: ModelInstanceIndex, joints: Mapping[str, JointFacts]
) -> None:
    """Leaves one actuator to each joint that is driven, has a limited effort or an armature."""
    without = {
        name
        for name, facts in joints.items()
        if (facts.is_driven or math.isfinite(facts.effort) or facts.armature)
        and plant.HasJointNamed(name, model)
    }
    # Before a plant is finalized, it does not tell the actuators of one model.
    for index in list(plant.GetJointActuatorIndices()):
        actuator = plant.get_mutable_joint_actuator(index)
        name = actuator.joint().name()
        if actuator.model_instance() != model or name not in joints:
            continue
        if name in without:
            actuator.set_effort_limit(joints[name].effort)
            without.discard(name)
            if joints[name].armature:
                actuator.set_default_rotor_inertia(joints[name].armature)
    for name in sorted(without):
        joint = plant.GetJointByName(name, model)
        if joint.num_velocities() == 1:
            actuator = plant.AddJointActuator(f"{name}_actuator", joint, joints[name].effort)
            actuator.set_default_rotor_inertia(joints[name].armature)


def check_facts(plant: MultibodyPlant, parsed: Parsed) -> None:
    """Compares what Drake made of each file with what the file says; the plant is finalized.

    Raises:
        ExperimentError: a joint or a body is missing, or a body is in another place.
    """
    context = plant.CreateDefaultContext()
    for model, facts in parsed.models:
        for name, of_joint in facts.joints.items():
            if not plant.HasJointNamed(name, model):
                raise ExperimentError(
                    f"{facts.path}: joint {name!r} was lost when Drake read it; describe the "
                    "robot as URDF or SDFormat"
                )
            if of_joint.placed and not _is_placed(plant, context, model, name, of_joint.placed):
                raise ExperimentError(
                    f"{facts.path}: Drake moves joint {name!r} about another axis than the file; "
                    "describe the robot as URDF or SDFormat"
                )
        for name, (parent, wanted) in facts.poses.items():
            X_WP, X_WB = (
                plant.GetBodyByName(one, model).body_frame().CalcPoseInWorld(context)
                for one in (parent, name)
            )
            found = X_WP.inverse().multiply(X_WB).GetAsMatrix34()
            if np.abs(found - wanted).max() > _ROUNDING:
                raise ExperimentError(
                    f"{facts.path}: Drake puts body {name!r} {1e3 * _apart(found, wanted):.3g} mm "
                    "away from where the file has it; describe the robot as URDF or SDFormat"
                )


def _is_placed(
    plant: MultibodyPlant,
    context: Context,
    model: ModelInstanceIndex,
    name: str,
    placed: tuple[str, np.ndarray],
) -> bool:
    """Whether a joint has the axis of its file at the default position."""
    body, (axis, place) = placed
    joint, link = plant.GetJointByName(name, model), plant.GetBodyByName(body, model)
    X_WB, X_WJ = (f.CalcPoseInWorld(context) for f in (link.body_frame(), joint.frame_on_child()))
    turns = isinstance(joint, RevoluteJoint)
    found = joint.revolute_axis() if turns else joint.translation_axis()
    along = X_WB.rotation().multiply(axis / np.linalg.norm(axis))
    aside = X_WB.multiply(place) - X_WJ.translation()
    off = [X_WJ.rotation().multiply(found) - along]
    if turns:
        off.append(aside - along * (aside @ along))
    return bool(np.abs(off).max() < _ROUNDING)


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm((a - b)[:, 3]))


class ContactRules:
    """Which geometries the models of a plant let collide, beyond that links are not neighbours.

    As in MuJoCo, two geometries collide if the `contype` of one meets the `conaffinity` of the
    other, or a `<pair>` names them. Geometries of other models collide with everything.
    """

    def __init__(self, plant: MultibodyPlant, inspector: SceneGraphInspector, parsed: Parsed):
        self._bits: dict[GeometryId, tuple[int, int]] = {}
        self._paired: set[frozenset[GeometryId]] = set()
        self._excluded: set[frozenset[BodyIndex]] = set()
        for model, facts in parsed.models:
            named = _geometries_by_name(plant, inspector, model)
            for name, bits in facts.contact_bits.items():
                if name not in named:
                    raise ExperimentError(
                        f"{facts.path}: geom {name!r} was lost when Drake read it; give it another "
                        "shape (hfield and sdf are not read), or remove it"
                    )
                self._bits[named[name]] = bits
            for pair in facts.paired:
                self._paired.add(frozenset(named[name] for name in pair if name in named))
            for pair in facts.excluded:
                if unknown := [name for name in pair if not plant.HasBodyNamed(name, model)]:
                    raise ExperimentError(
                        f"{facts.path}: <exclude> names the body {unknown[0]!r}, which is not "
                        "there; correct it"
                    )
                bodies = (plant.GetBodyByName(name, model).index() for name in pair)
                self._excluded.add(frozenset(bodies))

    def are_excluded(self, a: RigidBody, b: RigidBody) -> bool:
        """Whether the models say that two links never collide."""
        return frozenset((a.index(), b.index())) in self._excluded

    def collide(self, a: GeometryId, b: GeometryId) -> bool:
        """Whether two geometries of different links collide."""
        if frozenset((a, b)) in self._paired:
            return True
        (type_a, affinity_a), (type_b, affinity_b) = (self._bits.get(g, (1, 1)) for g in (a, b))
        return bool(type_a & affinity_b or type_b & affinity_a)


def _geometries_by_name(
    plant: MultibodyPlant, inspector: SceneGraphInspector, model: ModelInstanceIndex
) -> dict[str, GeometryId]:
    prefix = f"{plant.GetModelInstanceName(model)}::"
    named = {}
    # What a file puts into the world itself has no prefix.
    for index in [plant.world_body().index(), *plant.GetBodyIndices(model)]:
        frame = plant.GetBodyFrameIdOrThrow(index)
        for geometry in inspector.GetGeometries(frame, Role.kProximity):
            named[inspector.GetName(geometry).removeprefix(prefix)] = geometry
    return named
