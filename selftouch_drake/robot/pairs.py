"""Which pairs of a robot's parts may touch, which must not collide, and which are filtered."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from pydrake.geometry import (
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    Role,
    SceneGraph,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Frame, RigidBody

from selftouch_drake.experiment import Experiment, ExperimentError
from selftouch_drake.robot.kinematics import moving_joints
from selftouch_drake.robot.links import all_links, link_geometries
from selftouch_drake.robot.skins import SkinModel
from selftouch_drake.robot.touchers import PREFIX


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


class Neighbours:
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


def touching_pairs(
    plant: MultibodyPlant, touchers: Sequence[Toucher], worn: Sequence[WornSkin]
) -> tuple[tuple[int, int], ...]:
    """`(toucher, skin)` numbers of those that may touch: all but neighbours in the tree.

    Raises:
        ExperimentError: a skin or a toucher has no partner.
    """
    neighbours = Neighbours(plant)
    pairs = tuple(
        (t, s)
        for t, toucher in enumerate(touchers)
        for s, skin in enumerate(worn)
        if not neighbours.are_neighbours(toucher.link, skin.link)
    )
    _require_partners(pairs, touchers, worn)
    return pairs


def _require_partners(
    pairs: Sequence[tuple[int, int]], touchers: Sequence[Toucher], worn: Sequence[WornSkin]
) -> None:
    for s, skin in enumerate(worn):
        if not any(pair[1] == s for pair in pairs):
            raise ExperimentError(
                f"skins.{skin.model.name} can never feel: all that touches is on its own link or "
                "on one next to it; add something to touching"
            )
    for t, toucher in enumerate(touchers):
        if not any(pair[0] == t for pair in pairs):
            raise ExperimentError(
                f"touching.{toucher.name} can never touch: every skin is on its own link or on one "
                "next to it; leave it out, or add a skin"
            )


def rigid_pairs(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    experiment: Experiment,
    worn: Sequence[WornSkin],
) -> Iterator[RigidPair]:
    """Pairs of links with collision geometry of their own that are no neighbours.

    A skin that lies on its link's own geometry makes the outer layer of that geometry soft.
    """
    neighbours = Neighbours(plant)
    inspector = scene_graph.model_inspector()
    added = {skin.geometry_id for skin in worn}
    geometries, soft = {}, {}
    for link in all_links(plant):
        index = int(link.index())
        own = [
            g
            for g in link_geometries(plant, inspector, link, Role.kProximity)
            if g not in added and not inspector.GetName(g).split("::")[-1].startswith(PREFIX)
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
        if not neighbours.are_neighbours(link_a, link_b):
            yield RigidPair(
                links=(link_a, link_b),
                geometry_ids=(own_a, own_b),
                allowed_depth=experiment.robot.collision_depth + soft[a] + soft[b],
            )


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
