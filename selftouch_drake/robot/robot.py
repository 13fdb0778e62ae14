"""A robot in Drake: what moves, which skins it wears, what presses them and what may collide."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import (
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    HydroelasticContactRepresentation,
    Role,
    SceneGraph,
)
from pydrake.multibody.plant import ContactModel, DiscreteContactApproximation, MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    Frame,
    Joint,
    PdControllerGains,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    WeldJoint,
)

from selftouch_drake.experiment import Experiment, ExperimentError
from selftouch_drake.robot.kinematics import Kinematics, moving_joints
from selftouch_drake.robot.links import (
    all_links,
    find_frame,
    find_joint,
    find_link,
    link_geometries,
)
from selftouch_drake.robot.models import RobotModel, load_model, parse
from selftouch_drake.robot.skins import SkinModel
from selftouch_drake.robot.tactile_skin import RegisterSkin
from selftouch_drake.robot.touchers import TouchingBall, TouchingShapes, register_toucher

# Half a turn either way: where babbling keeps a joint that turns without limits.
HALF_TURN = np.pi


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WornSkin:
    """A skin on a link of a plant.

    Attributes:
        model: the skin, in the frame of its link.
        link: the body that wears it, frame L.
        geometry_id: its collision geometry.
    """

    model: SkinModel
    link: RigidBody
    geometry_id: GeometryId


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Toucher:
    """What presses skins, on a link of a plant.

    Attributes:
        name: as the experiment calls it.
        link: the body that it is on.
        frame: the frame of a ball, or of the link.
        geometry_ids: its collision geometry; of a link that wears a skin, the skin's.
    """

    name: str
    link: RigidBody
    frame: Frame
    geometry_ids: tuple[GeometryId, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidPair:
    """Two links whose own geometries must not run into each other.

    Attributes:
        links: the two bodies.
        geometry_ids: the geometries of each.
        allowed_depth: m, deeper than this the posture is impossible: the experiment's depth, and
            the soft skins that cover the two.
    """

    links: tuple[RigidBody, RigidBody]
    geometry_ids: tuple[tuple[GeometryId, ...], tuple[GeometryId, ...]]
    allowed_depth: float


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
        """J names, in the order of q."""
        return [joint.name() for joint in self.joints]

    @property
    def turns(self) -> np.ndarray:
        """`(J,)` bool, whether each joint turns (rad) or slides (m)."""
        return self.kinematics.turns

    @property
    def lower(self) -> np.ndarray:
        """`(J,)` rad or m, lower joint limits; infinite where a joint turns on and on."""
        return self.plant.GetPositionLowerLimits()

    @property
    def upper(self) -> np.ndarray:
        """`(J,)` rad or m, upper joint limits; infinite where a joint turns on and on."""
        return self.plant.GetPositionUpperLimits()

    @property
    def babbled_range(self) -> tuple[np.ndarray, np.ndarray]:
        """`(J,)` and `(J,)`: where babbling stays, one turn where a joint has no limits."""
        lower, upper = self.lower, self.upper
        endless = ~(np.isfinite(lower) & np.isfinite(upper))
        return np.where(endless, -HALF_TURN, lower), np.where(endless, HALF_TURN, upper)

    def skin_positions(self, q: np.ndarray) -> np.ndarray:
        """`(N, skins, 3, 4)` poses of the links that wear skins at `q` `(N, J)`."""
        return self.kinematics.poses(q)[:, : len(self.skins)]

    def toucher_positions(self, q: np.ndarray) -> np.ndarray:
        """`(N, touchers, 3)` m, the touchers' frames in the world at `q` `(N, J)`."""
        return self.kinematics.positions(q)[:, len(self.skins) :]


def MakeRobot(experiment: Experiment, skins: Sequence[SkinModel], scene_graph: SceneGraph) -> Robot:
    """Builds the plant of `experiment` and registers it with `scene_graph`.

    Only pairs of toucher and skin collide; all others are filtered, because every pair that Drake
    need not look at is time. Rigid links of the robot that may run into each other are listed, for
    `collisions.CollisionCheck` and the dynamic world.

    Raises:
        ExperimentError: the experiment names what the robot does not have, or a joint that cannot
            move; nothing can touch a skin.
    """
    plant = MultibodyPlant(time_step=experiment.execution.time_step)
    plant.set_name("plant")
    plant.set_contact_model(ContactModel.kHydroelasticWithFallback)
    plant.set_contact_surface_representation(HydroelasticContactRepresentation.kPolygon)
    # Peak forces are a third of those of SAP, and contact is held as well.
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kLagged)
    # Contact results and state of one instant, so that (q, sensation) is a pair.
    plant.SetUseSampledOutputPorts(False)
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    model = robot_model(experiment)
    parse(plant, model)
    _fix_joints(plant, experiment, model)

    worn = []
    for skin in skins:
        link = find_link(plant, skin.link, f"skins.{skin.name}.link")
        geometry_id = RegisterSkin(
            plant,
            link,
            skin.wall,
            hydroelastic_modulus=skin.hydroelastic_modulus,
            name=f"skin_{skin.name}",
            visible=False,
        )
        worn.append(WornSkin(model=skin, link=link, geometry_id=geometry_id))
    touchers = [
        _toucher(plant, scene_graph, name, toucher, worn)
        for name, toucher in experiment.touching.items()
    ]
    _give_gains(plant, experiment)
    plant.Finalize()

    joints = moving_joints(plant)
    groups = _Neighbours(plant)
    pairs = tuple(
        (t, s)
        for t, toucher in enumerate(touchers)
        for s, skin in enumerate(worn)
        if not groups.are_neighbours(toucher.link, skin.link)
    )
    _require_pairs(pairs, touchers, worn)
    rigid_pairs = tuple(_rigid_pairs(plant, scene_graph, experiment, worn, groups))
    _filter(plant, scene_graph, worn, touchers, pairs)
    frames = [skin.link.body_frame() for skin in worn] + [t.frame for t in touchers]
    return Robot(
        plant=plant,
        scene_graph=scene_graph,
        joints=tuple(joints),
        skins=tuple(worn),
        touchers=tuple(touchers),
        touching_pairs=pairs,
        rigid_pairs=rigid_pairs,
        kinematics=Kinematics.of(plant, frames),
    )


def robot_model(experiment: Experiment) -> RobotModel:
    """The models of an experiment's robot, found and made fit for Drake."""
    return load_model(experiment.robot.directives, experiment.robot.packages)


def _fix_joints(plant: MultibodyPlant, experiment: Experiment, model: RobotModel) -> None:
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


def _give_gains(plant: MultibodyPlant, experiment: Experiment) -> None:
    gains = PdControllerGains(p=experiment.execution.stiffness, d=experiment.execution.damping)
    for actuator in plant.GetJointActuatorIndices():
        plant.get_mutable_joint_actuator(actuator).set_controller_gains(gains)


def _toucher(
    plant: MultibodyPlant, scene_graph: SceneGraph, name: str, toucher, worn: Sequence[WornSkin]
) -> Toucher:
    field = f"touching.{name}"
    if toucher.frame is not None:
        frame = find_frame(plant, toucher.frame, f"{field}.frame")
        ids = register_toucher(plant, name, TouchingBall(frame=frame, radius=toucher.radius))
        return Toucher(name=name, link=frame.body(), frame=frame, geometry_ids=ids)
    link = find_link(plant, toucher.link, f"{field}.link")
    skins = tuple(skin.geometry_id for skin in worn if skin.link.index() == link.index())
    if skins:
        ids = skins
    else:
        inspector = scene_graph.model_inspector()
        own = link_geometries(plant, inspector, link, Role.kProximity)
        if not own:
            raise ExperimentError(
                f"{field}.link is {toucher.link!r}, which has no collision geometry; give it some "
                "in its model, or give a ball by frame and radius"
            )
        ids = register_toucher(
            plant, name, TouchingShapes(link=link, geometries=tuple(own), inspector=inspector)
        )
    return Toucher(name=name, link=link, frame=link.body_frame(), geometry_ids=ids)


class _Neighbours:
    """Which links are one (welded together), and which are next to each other in the tree."""

    def __init__(self, plant: MultibodyPlant):
        self._group: dict[int, int] = {}
        for number, bodies in enumerate(_welded_groups(plant)):
            for body in bodies:
                self._group[body] = number
        self._adjacent = set()
        for joint in moving_joints(plant):
            ends = [self.of(joint.parent_body()), self.of(joint.child_body())]
            self._adjacent |= {tuple(ends), tuple(ends[::-1])}

    def of(self, link: RigidBody) -> int:
        """The number of the group of links that move as one."""
        return self._group[int(link.index())]

    def are_neighbours(self, a: RigidBody, b: RigidBody) -> bool:
        """Whether one joint or none lies between two links."""
        return self.of(a) == self.of(b) or (self.of(a), self.of(b)) in self._adjacent


def _welded_groups(plant: MultibodyPlant) -> list[set[int]]:
    left = set(range(plant.num_bodies()))
    groups = []
    while left:
        body = plant.get_body(BodyIndex(min(left)))
        groups.append({int(b.index()) for b in plant.GetBodiesWeldedTo(body)} | {int(body.index())})
        left -= groups[-1]
    return groups


def _require_pairs(pairs, touchers: Sequence[Toucher], worn: Sequence[WornSkin]) -> None:
    for s, skin in enumerate(worn):
        if not any(pair[1] == s for pair in pairs):
            raise ExperimentError(
                f"skins.{skin.model.name} can never feel: all that touches is on its own link or on "
                "one next to it; add something to touching"
            )
    for t, toucher in enumerate(touchers):
        if not any(pair[0] == t for pair in pairs):
            raise ExperimentError(
                f"touching.{toucher.name} can never touch: every skin is on its own link or on one "
                "next to it; leave it out, or add a skin"
            )


def _rigid_pairs(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    experiment: Experiment,
    worn: Sequence[WornSkin],
    groups: _Neighbours,
) -> Iterable[RigidPair]:
    """Pairs of links with collision geometry of their own that are no neighbours.

    A skin that lies on its link's own geometry makes the outer layer of that geometry soft.
    """
    inspector = scene_graph.model_inspector()
    added = {skin.geometry_id for skin in worn}
    geometries, soft = {}, {}
    for link in all_links(plant):
        index = int(link.index())
        own = [
            g
            for g in link_geometries(plant, inspector, link, Role.kProximity)
            if g not in added and not inspector.GetName(g).split("::")[-1].startswith("touching_")
        ]
        if own:
            geometries[index] = (link, tuple(own))
        soft[index] = max(
            (
                skin.model.wall.thickness
                for skin in worn
                if int(skin.link.index()) == index and skin.model.is_own_geometry
            ),
            default=0.0,
        )
    for (a, (link_a, own_a)), (b, (link_b, own_b)) in itertools.combinations(geometries.items(), 2):
        if not groups.are_neighbours(link_a, link_b):
            yield RigidPair(
                links=(link_a, link_b),
                geometry_ids=(own_a, own_b),
                allowed_depth=experiment.robot.collision_depth + soft[a] + soft[b],
            )


def _filter(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    worn: Sequence[WornSkin],
    touchers: Sequence[Toucher],
    pairs: Sequence[tuple[int, int]],
) -> None:
    """Leaves touchers and skins to collide, and nothing else."""
    inspector = scene_graph.model_inspector()
    everything = GeometrySet(inspector.GetAllGeometryIds(Role.kProximity))
    filters = scene_graph.collision_filter_manager()
    filters.Apply(CollisionFilterDeclaration().ExcludeWithin(everything))
    for t, s in pairs:
        toucher = GeometrySet(list(touchers[t].geometry_ids))
        skin = GeometrySet([worn[s].geometry_id])
        filters.Apply(CollisionFilterDeclaration().AllowBetween(toucher, skin))
