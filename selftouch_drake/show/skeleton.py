"""Skeletons: where joints are and what they carry, of a body model and of a robot, in one posture.

Of a joint that turns only the axis is known, not where on it the joint is, and of one that slides
only the direction. Joints are drawn where they make the links as short as possible: so the joints
of a shoulder, whose axes meet, are drawn at one place.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from selftouch_drake.agent.body_model.model import BASE, UNUSED, BodyModel
from selftouch_drake.agent.body_model.twists import transformed
from selftouch_drake.evaluation.body_model import Axes, Similarity, found_axes, true_axes
from selftouch_drake.evaluation.shape import KernelTruth
from selftouch_drake.robot import Robot

# Pull of all joints to the middle, in shares of the pull of a link: it decides what nothing else
# does, such as the place of the outer joint of a chain that carries nothing.
_PULL = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Skeleton:
    """A body in one posture, in one frame.

    Attributes:
        joints: `(n,)` numbers of the joints that it shows.
        place: `(n, 3)` where each is drawn.
        direction: `(n, 3)` unit vectors along the axes; NaN if a joint has none.
        slides: `(n,)` bool.
        bones: `(B, 2, 3)` the links, as straight lines.
        touchers: `(U, 3)` centres of what touches.
        skins: `(N, 3)` places of the kernels on each part of the skin.
    """

    joints: np.ndarray
    place: np.ndarray
    direction: np.ndarray
    slides: np.ndarray
    bones: np.ndarray
    touchers: np.ndarray
    skins: Sequence[np.ndarray]

    def moved(self, similarity: Similarity) -> "Skeleton":
        """The same skeleton, turned, mirrored, scaled and moved."""
        return replace(
            self,
            place=similarity(self.place),
            direction=self.direction @ similarity.rotation.T,
            bones=similarity(self.bones),
            touchers=similarity(self.touchers),
            skins=[similarity(places) for places in self.skins],
        )

    @property
    def points(self) -> np.ndarray:
        """`(n, 3)` everything that is drawn."""
        return np.concatenate([self.place, self.touchers, *self.skins])


def found_skeleton(model: BodyModel, q: np.ndarray) -> Skeleton:
    """The skeleton of a model at `(J,)` q, in the frame of its base and its own unit."""
    poses = model.link_poses(q[None])[0]
    touchers = transformed(poses[model.toucher_link], model.toucher_place)
    skins, links = [], []
    for part in np.flatnonzero(model.accepted_by_part & (model.part_link != UNUSED)):
        places = model.kernel_place[model.kernel_part == part]
        pose = poses[model.part_link[part]]
        skins.append(places[np.isfinite(places).all(axis=1)] @ pose[:3, :3].T + pose[:3, 3])
        links.append(int(model.part_link[part]))
    return _skeleton(found_axes(model, q), touchers, model.toucher_link, skins, links)


def true_skeleton(robot: Robot, truth: KernelTruth, q: np.ndarray) -> Skeleton:
    """The skeleton of a robot in the world at `(J,)` q."""
    X_WL = robot.skin_positions(q[None])[0]
    skins, links = [], []
    for skin in np.unique(truth.skin):
        pose = X_WL[skin]
        skins.append(truth.positions[truth.skin == skin] @ pose[:, :3].T + pose[:, 3])
        links.append(int(robot.kinematics.owner[skin]))
    touchers = robot.toucher_positions(q[None])[0]
    axes = true_axes(robot.kinematics, q)
    return _skeleton(axes, touchers, robot.kinematics.owner[len(X_WL) :], skins, links)


def _skeleton(
    axes: Axes,
    touchers: np.ndarray,
    toucher_link: np.ndarray,
    skins: Sequence[np.ndarray],
    skin_link: Sequence[int],
) -> Skeleton:
    """The skeleton of axes and of what links carry, all in one frame."""
    joints = np.flatnonzero(axes.parent != UNUSED)
    fixed: dict[int, list[np.ndarray]] = defaultdict(list)
    carried = [(places.mean(axis=0), link) for places, link in zip(skins, skin_link, strict=True)]
    for place, link in [*zip(touchers, toucher_link.tolist(), strict=True), *carried]:
        fixed[int(link)].append(place)
    place = _shortest(axes, joints, fixed)
    hubs = _links_of(axes, joints)
    bones = []
    for link, on in hubs.items():
        points = [*(place[np.searchsorted(joints, joint)] for joint in on), *fixed[link]]
        if len(points) == 2:
            bones.append(points)
        elif len(points) > 2:  # a star
            middle = np.mean(points, axis=0)
            bones += [[point, middle] for point in points]
    return Skeleton(
        joints=joints,
        place=place,
        direction=axes.direction[joints],
        slides=~np.isfinite(axes.place[joints]).all(axis=1),
        bones=np.array(bones).reshape(-1, 2, 3),
        touchers=touchers,
        skins=skins,
    )


def _links_of(axes: Axes, joints: np.ndarray) -> dict[int, list[int]]:
    """The joints on each link: the one that carries it, and those that it carries."""
    on = defaultdict[int, list[int]](list)
    for joint in joints.tolist():
        on[joint].append(joint)
        on[int(axes.parent[joint])].append(joint)
    on.setdefault(BASE, [])
    return on


def _shortest(axes: Axes, joints: np.ndarray, fixed: dict[int, list[np.ndarray]]) -> np.ndarray:
    """`(n, 3)` places of joints on their axes with the smallest sum of squared lengths of links.

    A joint without a place may be anywhere. `fixed` are places that each link carries.
    """
    free, offset = [], np.zeros((len(joints), 3))
    for number, joint in enumerate(joints):
        turns = np.isfinite(axes.place[joint]).all()
        along = axes.direction[joint][None] if turns else np.eye(3)
        free += [(number, direction) for direction in along]
        offset[number] = axes.place[joint] if turns else 0.0
    # Places are offset + sum of shares of the free directions.
    basis = np.zeros((len(joints), 3, len(free)))
    for column, (number, direction) in enumerate(free):
        basis[number, :, column] = direction
    number_of = {int(joint): number for number, joint in enumerate(joints)}
    rows, goals = [], []
    known = [place for places in fixed.values() for place in places]
    middle = np.mean(known, axis=0) if known else np.zeros(3)
    for link, on in _links_of(axes, joints).items():
        numbers = [number_of[joint] for joint in on]
        # Each point of the link, less the mean of all.
        points = [(basis[n], offset[n]) for n in numbers]
        points += [(np.zeros((3, len(free))), place) for place in fixed.get(link, [])]
        if len(points) > 1:
            mean_basis = np.mean([b for b, _ in points], axis=0)
            mean_offset = np.mean([o for _, o in points], axis=0)
            rows += [b - mean_basis for b, _ in points]
            goals += [mean_offset - o for _, o in points]
    for number in range(len(joints)):
        rows.append(_PULL * basis[number])
        goals.append(_PULL * (middle - offset[number]))
    share = np.linalg.lstsq(np.concatenate(rows), np.concatenate(goals), rcond=None)[0]
    return offset + basis @ share
