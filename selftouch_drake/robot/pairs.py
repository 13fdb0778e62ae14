"""Pairs of a robot's parts: those that may touch, must not collide, or are filtered."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import (
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    HalfSpace,
    Role,
    SceneGraph,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Frame, RevoluteJoint, RigidBody
from pydrake.systems.framework import Context

from selftouch_drake.experiment import Experiment, ExperimentError
from selftouch_drake.experiment.schema import ReadingSettings
from selftouch_drake.robot.facts import ContactRules
from selftouch_drake.robot.kinematics import TreeJoint, joint_tree
from selftouch_drake.robot.links import all_links, link_geometries
from selftouch_drake.robot.skins import SkinModel

#: The collision geometries that the models give links.
OwnGeometries = Mapping[BodyIndex, tuple[GeometryId, ...]]
# m; joints nearer to each other than this turn at one place.
_ONE_PLACE = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WornSkin:
    """A skin on a link of a plant.

    Attributes:
        model: the skin, in the frame of its link.
        link: the body that wears it, frame L.
        geometry_id: its collision geometry.
        reading: what a `TactileSkin` reports of the forces on it.
    """

    model: SkinModel
    link: RigidBody
    geometry_id: GeometryId
    reading: ReadingSettings


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

    Where only some geometries of a link meet some of the other, two links have several pairs.

    Attributes:
        links: the two bodies.
        geometry_ids: the geometries of each.
        allowed_depth: m, deeper than this the posture is impossible: the experiment's depth, and
            the soft skins that cover the two.
    """

    links: tuple[RigidBody, RigidBody]
    geometry_ids: tuple[tuple[GeometryId, ...], tuple[GeometryId, ...]]
    allowed_depth: float


class Neighbours:
    """Which links are one (welded together), and which are next to each other in the tree.

    Next to each other are two links with one joint between them, or several that turn at one place,
    as in a spherical wrist: the links between those have no length. So are links between which
    there are only links without mass and geometry, which a parser puts between several joints of
    one body. The models may name more, in collision filter groups of `own_geometries`, or as
    excluded. The plant is finalized.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        own: OwnGeometries,
        rules: ContactRules | None = None,
    ):
        self._inspector, self._own = scene_graph.model_inspector(), own
        self._rules = rules
        # A group is called after its first link.
        self._group = {
            int(link.index()): min(int(one.index()) for one in plant.GetBodiesWeldedTo(link))
            for link in all_links(plant)
        }
        self._adjacent = self._next_to_each_other(plant)

    def _next_to_each_other(self, plant: MultibodyPlant) -> set[frozenset[int]]:
        """Pairs of numbers of groups between which there is a joint, or several at one place."""
        context = plant.CreateDefaultContext()
        tree = joint_tree(plant)
        ends = [(self.of(each.near.body()), self.of(each.far.body())) for each in tree]
        # For each joint the links that it, or a joint before it at the same place, starts from.
        starts: list[set[int]] = []
        for number, each in enumerate(tree):
            parent, _ = ends[number]
            starts.append({parent})
            carried = plant.GetBodiesWeldedTo(each.near.body())
            is_between_joints = not any(self._is_anything(link, plant) for link in carried)
            for before in range(number):
                _, child_before = ends[before]
                if child_before != parent:
                    continue
                if is_between_joints or _turn_at_one_place(tree[before], each, context):
                    starts[number] |= starts[before]
        return {
            frozenset((start, child))
            for (_, child), reached in zip(ends, starts, strict=True)
            for start in reached
        }

    def _is_anything(self, link: RigidBody, plant: MultibodyPlant) -> bool:
        """Whether a link has mass or geometry: its own, a skin or a toucher."""
        frame = plant.GetBodyFrameIdOrThrow(link.index())
        return bool(link.default_mass() or self._inspector.NumGeometriesForFrame(frame))

    def of(self, link: RigidBody) -> int:
        """The number of the group of links that move as one."""
        return self._group[int(link.index())]

    def are_neighbours(self, a: RigidBody, b: RigidBody) -> bool:
        """Whether two links are one, or next to each other, or filtered by their models."""
        if self.of(a) == self.of(b) or {self.of(a), self.of(b)} in self._adjacent:
            return True
        if self._rules is not None and self._rules.are_excluded(a, b):
            return True
        ends = self._own.get(a.index()), self._own.get(b.index())
        # A filter group has all geometries of a link, or none.
        return all(ends) and self._inspector.CollisionFiltered(*(ids[0] for ids in ends if ids))


def _turn_at_one_place(before: TreeJoint, after: TreeJoint, context: Context) -> bool:
    """Whether two successive joints both turn, at places that coincide."""
    X = after.near.CalcPose(context, before.far)
    at_one_place = np.linalg.norm(X.translation()) < _ONE_PLACE
    both_turn = isinstance(before.joint, RevoluteJoint) and isinstance(after.joint, RevoluteJoint)
    return bool(both_turn and at_one_place)


def touching_pairs(
    neighbours: Neighbours, touchers: Sequence[Toucher], worn: Sequence[WornSkin]
) -> tuple[tuple[int, int], ...]:
    """`(toucher, skin)` numbers of those that may touch: all but neighbours in the tree.

    Raises:
        ExperimentError: a skin or a toucher has no partner.
    """
    pairs = tuple(
        (t, s)
        for t, toucher in enumerate(touchers)
        for s, skin in enumerate(worn)
        if not neighbours.are_neighbours(toucher.link, skin.link)
    )
    # A skin that presses another one feels it, too.
    feeling = {s for _, s in pairs} | {
        s
        for s, skin in enumerate(worn)
        for t, _ in pairs
        if skin.geometry_id in touchers[t].geometry_ids
    }
    for s, skin in enumerate(worn):
        if s not in feeling:
            raise ExperimentError(
                f"skins.{skin.model.name} can never be touched: all touchers are on its own link "
                "or next to it; add another one to touching"
            )
    touching = {t for t, _ in pairs}
    for t, toucher in enumerate(touchers):
        if t not in touching:
            raise ExperimentError(
                f"touching.{toucher.name} can never touch: all skins are on its own link or next "
                "to it; leave it out, or add a skin"
            )
    return pairs


def own_geometries(plant: MultibodyPlant, scene_graph: SceneGraph) -> OwnGeometries:
    """The collision geometries of each link that has any, before skins and touchers are added.

    A half space, as the floor of a MuJoCo file, is not a part of a robot and is left out.
    """
    inspector = scene_graph.model_inspector()
    found = {}
    for link in all_links(plant):
        geometries = link_geometries(plant, inspector, link, Role.kProximity)
        solid = [g for g in geometries if not isinstance(inspector.GetShape(g), HalfSpace)]
        if solid:
            found[link.index()] = tuple(solid)
    return found


def rigid_pairs(
    plant: MultibodyPlant,
    neighbours: Neighbours,
    rules: ContactRules,
    own: OwnGeometries,
    experiment: Experiment,
    worn: Sequence[WornSkin],
) -> Iterator[RigidPair]:
    """Pairs of links of `own_geometries` that are not neighbours; the plant is finalized.

    A skin that lies on its link's own geometry makes the outer layer of that geometry soft.
    """
    softness: dict[BodyIndex, float] = {}
    for skin in worn:
        if skin.model.is_own_geometry:
            deepest = max(skin.model.wall.thickness, softness.get(skin.link.index(), 0.0))
            softness[skin.link.index()] = deepest
    for a, b in itertools.combinations(own, 2):
        links = plant.get_body(a), plant.get_body(b)
        if not neighbours.are_neighbours(*links):
            depth = experiment.robot.collision_depth
            depth += sum(softness.get(link.index(), 0.0) for link in links)
            for geometries in _that_collide(own[a], own[b], rules):
                yield RigidPair(links=links, geometry_ids=geometries, allowed_depth=depth)


def _that_collide(
    of_a: Sequence[GeometryId], of_b: Sequence[GeometryId], rules: ContactRules
) -> Iterator[tuple[tuple[GeometryId, ...], tuple[GeometryId, ...]]]:
    """Geometries of two links, in groups of which each one collides with each of the other link."""
    groups: dict[tuple[GeometryId, ...], list[GeometryId]] = {}
    for a in of_a:
        partners = tuple(b for b in of_b if rules.collide(a, b))
        if partners:
            groups.setdefault(partners, []).append(a)
    for partners, alike in groups.items():
        yield tuple(alike), partners


def leave_to_collide(
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
