"""A body model as links and joints of a robot, in the order in which a file lists them.

All links have parallel axes where every joint reads 0, so that no file needs an angle for where
things are. The frame of a part of the skin is that of the model's link; the frame of a joint's link
lies on its axis, because URDF knows no other.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.body_model.model import BASE, UNUSED, BodyModel, JointKind
from selftouch_drake.export.unit import extent

#: The link that everything stands on.
WORLD = "world"

# kg, made up: of a link that a joint carries, of a skin, and of a toucher.
_LINK_MASS, _SKIN_MASS, _TOUCHER_MASS = 1.0, 1.0, 0.01
# Radii of the made-up balls, in extents of the skin.
_LINK_RADIUS, _TOUCHER_RADIUS = 0.1, 0.02
# Of a joint that was never moved: limits that no simulator refuses.
_NARROW = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Ball:
    """A solid ball that gives a link mass and inertia; made up, because touch tells neither.

    Attributes:
        mass: kg.
        radius: in the file's unit of length.
        centre: `(3,)` in the frame of the link.
    """

    mass: float
    radius: float
    centre: np.ndarray

    @property
    def inertia(self) -> float:
        """About any axis through the centre."""
        return 0.4 * self.mass * self.radius**2


@dataclass(frozen=True, slots=True, kw_only=True)
class Movement:
    """A joint that moves a link.

    Attributes:
        name: of the joint.
        kind: `revolute` or `prismatic`.
        axis: `(3,)` unit vector.
        lower: rad, or the file's unit of length.
        upper: likewise.
        comment: what is known about the joint.
    """

    name: str
    kind: str
    axis: np.ndarray
    lower: float
    upper: float
    comment: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """A mesh on a link.

    Attributes:
        name: of the geometry, the same in all files.
        file: name of the mesh, in the folder of the file.
    """

    name: str
    file: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """A link, and how it hangs on another.

    Attributes:
        name: of the link.
        parent: name of the link that carries it, or `WORLD`.
        offset: `(3,)` from the parent's origin where all joints read 0.
        movement: how it moves; None if it is fixed.
        ball: its made-up mass.
        shape: its mesh, if it has one.
        is_frame: whether it is only a place on its parent.
    """

    name: str
    parent: str
    offset: np.ndarray
    movement: Movement | None
    ball: Ball
    shape: Shape | None = None
    is_frame: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkTree:
    """A robot.

    Attributes:
        name: of the robot.
        links: each after the one that carries it.
        comments: what a reader of the file should know.
    """

    name: str
    links: Sequence[Link]
    comments: Sequence[str]


def joint_scales(model: BodyModel, slides: np.ndarray) -> np.ndarray:
    """`(J,)` rad, or length, by which each joint moves per unit of its reading; 1 if not used."""
    speed = np.where(
        slides,
        np.linalg.norm(model.twists[:, 3:], axis=1),
        np.linalg.norm(model.twists[:, :3], axis=1),
    )
    return np.where(model.used & (speed > 0), speed, 1.0)


def joint_limits(
    model: BodyModel, slides: np.ndarray, experience: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`(J,)` lower and upper limits: what the experience saw, in the file's coordinates.

    Args:
        model: whose joints are pure.
        slides: `(J,)` bool.
        experience: `(R, J)` readings.
    """
    scale = joint_scales(model, slides)
    return scale * experience.min(axis=0), scale * experience.max(axis=0)


def link_tree(
    model: BodyModel,
    slides: np.ndarray,
    limits: tuple[np.ndarray, np.ndarray],
    *,
    name: str,
    meshes: Mapping[str, tuple[str, np.ndarray]],
    parts: Sequence[int],
    comments: Sequence[str],
) -> LinkTree:
    """The links and joints of a model.

    Args:
        model: in the file's unit, with pure joints.
        slides: `(J,)` bool, whether a joint slides.
        limits: `(J,)` lower and upper, as from `joint_limits`.
        name: of the robot.
        meshes: of links, by the link's name: file and `(3,)` middle, in the frame of the link.
        parts: of the skin that are worn.
        comments: for the reader of the file.
    """
    size, home = extent(model), _homes(model)
    links = []
    for joint in _parents_first(model):
        above = int(model.joint_parent[joint])
        links.append(
            Link(
                name=_link_name(model, joint),
                parent=_link_name(model, above),
                offset=home[joint] - home[above] if above != UNUSED else np.zeros(3),
                movement=_movement(model, joint, bool(slides[joint]), limits),
                ball=Ball(mass=_LINK_MASS, radius=_LINK_RADIUS * size, centre=np.zeros(3)),
            )
        )
    for part in parts:
        link, own = int(model.part_link[part]), f"part_{part}"
        file, middle = meshes.get(own, ("", np.zeros(3)))
        links.append(
            Link(
                name=own,
                parent=_link_name(model, link),
                offset=-home[link],
                movement=None,
                ball=Ball(mass=_SKIN_MASS, radius=_LINK_RADIUS * size, centre=middle),
                shape=Shape(name=f"{own}_skin", file=file) if file else None,
            )
        )
    for toucher, link in enumerate(model.toucher_link.tolist()):
        own = f"toucher_{toucher}"
        file, _ = meshes.get(own, ("", np.zeros(3)))
        ball = Ball(mass=_TOUCHER_MASS, radius=_TOUCHER_RADIUS * size, centre=np.zeros(3))
        links.append(
            Link(
                name=own,
                parent=_link_name(model, link),
                offset=model.toucher_place[toucher] - home[link],
                movement=None,
                ball=ball,
                shape=Shape(name=f"{own}_surface", file=file) if file else None,
                is_frame=True,
            )
        )
    return LinkTree(name=name, links=links, comments=comments)


def _link_name(model: BodyModel, joint: int) -> str:
    return f"{model.joint_names[joint]}_link" if joint >= 0 else WORLD


def _parents_first(model: BodyModel) -> list[int]:
    """All joints, each after those that carry it; joints that are not used last."""
    used = np.flatnonzero(model.used).tolist()
    unused = np.flatnonzero(~model.used).tolist()
    return sorted(used, key=lambda joint: len(model.chain(joint))) + unused


def _homes(model: BodyModel) -> dict[int, np.ndarray]:
    """Origin of each joint's link where all joints read 0, in the frame of the whole body.

    It is the point of the axis that is nearest to the origin of the link below it; a slide has its
    own there.
    """
    home = {BASE: np.zeros(3)}
    for joint in _parents_first(model):
        w, v = model.twists[joint, :3], model.twists[joint, 3:]
        before = home[int(model.joint_parent[joint])] if model.used[joint] else np.zeros(3)
        if w.any():
            along = w / np.linalg.norm(w)
            foot = np.cross(w, v) / (w @ w)
            home[joint] = foot + along * ((before - foot) @ along)
        else:
            home[joint] = before
    return home


def _movement(
    model: BodyModel, joint: int, slides: bool, limits: tuple[np.ndarray, np.ndarray]
) -> Movement:
    twist = model.twists[joint]
    direction = twist[3:] if slides else twist[:3]
    size = np.linalg.norm(direction)
    lower, upper = float(limits[0][joint]), float(limits[1][joint])
    if upper - lower < _NARROW:
        lower, upper = (lower + upper - _NARROW) / 2, (lower + upper + _NARROW) / 2
    return Movement(
        name=model.joint_names[joint],
        kind="prismatic" if slides else "revolute",
        axis=direction / size if size else np.array([0.0, 0.0, 1.0]),
        lower=lower,
        upper=upper,
        comment=_comment(model, joint, slides),
    )


def _comment(model: BodyModel, joint: int, slides: bool) -> str:
    """What is known about a joint, and what is not."""
    kind = JointKind(model.joint_kind[joint])
    name = model.joint_names[joint]
    if kind == JointKind.UNUSED:
        return f"{name} is of no use to the model: a stub, whose kind and axis are made up"
    words = "slides" if slides else "turns"
    found = [f"{name} {words}"]
    if kind == JointKind.OPEN:
        found = [
            f"{name} is open: touches do not tell whether it turns or slides; taken as {words}"
        ]
    columns = slice(3, 6) if slides else slice(0, 3)
    along, sigma = model.twists[joint, columns], model.twist_sigma[joint, columns]
    size = float(np.linalg.norm(along))
    if np.isfinite(sigma).all() and size:
        across = np.sqrt(np.square(sigma) @ (1 - np.square(along / size)) / 2)
        error_deg = float(np.degrees(across / size))
        found.append(f"standard error of its direction {error_deg:.2g} deg")
    group = model.order_group[joint]
    others = [
        model.joint_names[other]
        for other in np.flatnonzero((model.order_group == group) & (group >= 0))
        if other != joint
    ]
    if others:
        found.append(f"it may change places in the order with {', '.join(others)}")
    return "; ".join(found)
