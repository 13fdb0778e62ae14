"""A robot in Drake: its moving joints and their limits, its skins, its touchers, its collisions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import HydroelasticContactRepresentation, SceneGraph
from pydrake.multibody.plant import ContactModel, DiscreteContactApproximation, MultibodyPlant
from pydrake.multibody.tree import Joint, PdControllerGains, RevoluteJoint

from selftouch_drake.experiment import Experiment
from selftouch_drake.experiment.schema import ExecutionSettings
from selftouch_drake.robot.changes import change_joints
from selftouch_drake.robot.facts import ContactRules, Parsed
from selftouch_drake.robot.joints import fix_joints
from selftouch_drake.robot.kinematics import Kinematics, joint_tree
from selftouch_drake.robot.links import scoped_name
from selftouch_drake.robot.masses import require_masses
from selftouch_drake.robot.model_warnings import warn_of_models
from selftouch_drake.robot.models import load_model, parse
from selftouch_drake.robot.pairs import (
    Neighbours,
    RigidPair,
    Toucher,
    WornSkin,
    leave_to_collide,
    own_geometries,
    rigid_pairs,
    touching_pairs,
)
from selftouch_drake.robot.skin_registration import RegisterSkin
from selftouch_drake.robot.skins import SkinModel
from selftouch_drake.robot.touchers import add_toucher

# rad, how far babbling turns a joint that turns without limits.
TURN = 2 * np.pi


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Robot:
    """Handles into a finalized plant that holds one robot with its skins.

    Attributes:
        plant: the plant, discrete, with hydroelastic contact; its positions are q.
        scene_graph: where its geometry is.
        joints: the J joints that move, in the order of q.
        skins: in the order of the experiment, as their readings are in a sensation.
        touchers: in the order of the experiment.
        touching_pairs: `(toucher, skin)` numbers of those that may touch.
        rigid_pairs: links that must not run into each other.
        kinematics: of the frames of the links that wear skins, then those of the touchers.
    """

    plant: MultibodyPlant
    scene_graph: SceneGraph
    joints: tuple[Joint, ...]
    skins: tuple[WornSkin, ...]
    touchers: tuple[Toucher, ...]
    touching_pairs: tuple[tuple[int, int], ...]
    rigid_pairs: tuple[RigidPair, ...]
    kinematics: Kinematics

    @property
    def num_joints(self) -> int:
        """J."""
        return len(self.joints)

    @property
    def joint_names(self) -> list[str]:
        """J names, in the order of q; `model::name` where several models have such a joint."""
        names = [joint.name() for joint in self.joints]
        return [
            name if names.count(name) == 1 else scoped_name(self.plant, joint)
            for name, joint in zip(names, self.joints, strict=True)
        ]

    @property
    def turns(self) -> np.ndarray:
        """`(J,)` bool, whether each joint turns (rad) or slides (m)."""
        return self.kinematics.turns

    @property
    def lower(self) -> np.ndarray:
        """`(J,)` rad or m, lower joint limits; infinite where a joint has none."""
        return self.plant.GetPositionLowerLimits()

    @property
    def upper(self) -> np.ndarray:
        """`(J,)` rad or m, upper joint limits; infinite where a joint has none."""
        return self.plant.GetPositionUpperLimits()

    @property
    def babbled_range(self) -> tuple[np.ndarray, np.ndarray]:
        """`(J,)` and `(J,)`: where babbling stays, one turn where a joint has no limits."""
        return babbled_range(self.lower, self.upper)

    def skin_positions(self, q: np.ndarray) -> np.ndarray:
        """`(N, skins, 3, 4)` poses of the links that wear skins at `q` `(N, J)`."""
        return self.kinematics.poses(q)[:, : len(self.skins)]

    def toucher_positions(self, q: np.ndarray) -> np.ndarray:
        """`(N, touchers, 3)` m, the touchers' frames in the world at `q` `(N, J)`."""
        return self.kinematics.poses(q)[:, len(self.skins) :, :, 3]


def babbled_range(lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`(J,)` and `(J,)`: where joints with `(J,)` limits babble, one turn where they have none."""
    start = np.where(np.isfinite(upper), upper - TURN, -TURN / 2)
    start = np.where(np.isfinite(lower), lower, start)
    return start, np.where(np.isfinite(upper), upper, start + TURN)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BabblingJoints:
    """What babbling must know of a robot's joints, without its skins.

    Attributes:
        lower: `(J,)` rad or m, lower joint limits; infinite where a joint has none.
        upper: `(J,)` rad or m, upper joint limits.
        unit: `(J,)` how far a joint moves where a revolute one turns by a radian: a sliding joint
            crosses its range in the time in which a revolute joint turns once.
        velocity: `(J,)` rad/s or m/s, how fast each may be.
    """

    lower: np.ndarray
    upper: np.ndarray
    unit: np.ndarray
    velocity: np.ndarray

    @staticmethod
    def of_plant(plant: MultibodyPlant, experiment: Experiment) -> "BabblingJoints":
        """The joints of a finalized plant."""
        lower, upper = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
        turns = np.array([isinstance(joint, RevoluteJoint) for joint, *_ in joint_tree(plant)])
        low, high = babbled_range(lower, upper)
        return BabblingJoints(
            lower=lower,
            upper=upper,
            unit=np.where(turns, 1.0, (high - low) / TURN),
            velocity=_tighter(plant.GetVelocityUpperLimits(), experiment.execution.max_velocity),
        )

    @staticmethod
    def of(experiment: Experiment) -> "BabblingJoints":
        """The joints of the robot of an experiment, which takes no time for its skins.

        Raises:
            ExperimentError: as in `MakeRobot`.
        """
        plant, _ = _make_plant(experiment)
        plant.Finalize()
        return BabblingJoints.of_plant(plant, experiment)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointLimits:
    """The limits of a robot's joints and of its motions; each may be infinite.

    Attributes:
        lower: `(J,)` rad or m.
        upper: `(J,)` rad or m.
        velocity: `(J,)` rad/s or m/s.
        acceleration: `(J,)` rad/s^2 or m/s^2.
        torque: `(J,)` N·m or N.
    """

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    torque: np.ndarray

    @staticmethod
    def of(robot: Robot, execution: ExecutionSettings) -> "JointLimits":
        """The limits of `robot` and of the plans of `execution`; the tighter one holds."""
        plant = robot.plant
        actuators = [plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices()]
        effort = {a.joint().position_start(): a.effort_limit() for a in actuators}
        return JointLimits(
            lower=robot.lower,
            upper=robot.upper,
            velocity=_tighter(plant.GetVelocityUpperLimits(), execution.max_velocity),
            acceleration=_tighter(plant.GetAccelerationUpperLimits(), execution.max_acceleration),
            torque=np.array([effort[place] for place in range(robot.num_joints)]),
        )


def _tighter(of_model: np.ndarray, asked: float) -> np.ndarray:
    """`(J,)` the lower of two limits; 0 in a model means no limit."""
    return np.minimum(np.where(of_model > 0, of_model, np.inf), asked)


def MakeRobot(
    experiment: Experiment,
    skins: Sequence[SkinModel],
    scene_graph: SceneGraph,
    *,
    soft: bool = True,
) -> Robot:
    """Builds the plant of `experiment` and registers it with `scene_graph`.

    Only pairs of toucher and skin collide; all others are filtered, because every pair that Drake
    need not look at is time. Rigid links of the robot that may run into each other are listed, for
    `collisions.CollisionCheck` and the dynamic world. Unless they are `soft`, Drake computes no
    contact with the skins.

    Raises:
        ExperimentError: the experiment names what the robot does not have, or a joint that cannot
            move; nothing can touch a skin.

    Warns:
        ModelWarning: Drake, or this program, leaves out something that a file says.
    """
    plant, parsed = _make_plant(experiment, scene_graph)
    own = own_geometries(plant, scene_graph)

    worn = [RegisterSkin(plant, skin, visible=False, soft=soft) for skin in skins]
    touchers = [
        add_toucher(plant, scene_graph.model_inspector(), name, experiment, worn, own)
        for name in experiment.touching
    ]
    gains = PdControllerGains(p=experiment.execution.stiffness, d=experiment.execution.damping)
    for actuator in plant.GetJointActuatorIndices():
        plant.get_mutable_joint_actuator(actuator).set_controller_gains(gains)
    plant.Finalize()

    require_masses(plant)
    rules = ContactRules(plant, scene_graph.model_inspector(), parsed)
    neighbours = Neighbours(plant, scene_graph, own, rules)
    pairs = touching_pairs(neighbours, touchers, worn)
    rigid = tuple(rigid_pairs(plant, neighbours, rules, own, experiment, worn))
    leave_to_collide(scene_graph, worn, touchers, pairs)
    frames = [skin.link.body_frame() for skin in worn] + [t.frame for t in touchers]
    warn_of_models(parsed)
    return Robot(
        plant=plant,
        scene_graph=scene_graph,
        joints=tuple(each.joint for each in joint_tree(plant)),
        skins=tuple(worn),
        touchers=tuple(touchers),
        touching_pairs=pairs,
        rigid_pairs=rigid,
        kinematics=Kinematics.of(plant, frames),
    )


def _make_plant(
    experiment: Experiment, scene_graph: SceneGraph | None = None
) -> tuple[MultibodyPlant, Parsed]:
    """The links and the moving joints of an experiment, not finalized, and the facts of models."""
    plant = MultibodyPlant(time_step=experiment.execution.time_step)
    plant.set_name("plant")
    plant.set_contact_model(ContactModel.kHydroelasticWithFallback)
    plant.set_contact_surface_representation(HydroelasticContactRepresentation.kPolygon)
    # Peak forces are a third of those of SAP, and contact is held as well.
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kLagged)
    # Contact results and state of one instant, so that (q, sensation) is a pair.
    plant.SetUseSampledOutputPorts(False)
    if scene_graph is not None:
        plant.RegisterAsSourceForSceneGraph(scene_graph)
    model = load_model(experiment.robot.directives, experiment.robot.packages)
    parsed = parse(plant, model)
    change_joints(plant, experiment)
    fix_joints(plant, experiment, model, parsed)
    return plant, parsed
