"""A robot's model file, as arrays: the joints between its skin and what touches it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, FrameIndex, RevoluteJoint

from selftouch_drake.agent.given_model.way import GivenWay
from selftouch_drake.robot.kinematics import TreeJoint, joint_tree
from selftouch_drake.robot.links import all_joints, find_link, find_named
from selftouch_drake.robot.models import parse_file


class GivenModelError(ValueError):
    """A model or touches that do not fit; the text says what to do."""


def read_way(
    model: Path, joints: Sequence[str], link: str, frame: str
) -> tuple[GivenWay, np.ndarray]:
    """The joints between a link that wears skin and a frame that touches it.

    Args:
        model: a URDF, SDFormat, MJCF or model directives file; a free base is welded to the world.
        joints: J names, in the order of q; other joints of the model stay at 0.
        link: that wears the skin.
        frame: of what touches; a link's name stands for its own frame.

    Returns:
        The way, and `(L,)` the places of its joints among those of the run.

    Raises:
        FileNotFoundError: there is no such model.
        GivenModelError: the model lacks a joint, has one that neither turns nor slides, or has none
            between the link and the frame.
        ExperimentError: the model cannot be read, or lacks the link or the frame.
    """
    if not model.is_file():
        raise FileNotFoundError(f"{model} does not exist; give a URDF, SDFormat or MJCF file")
    plant = _parsed(model)
    tree = joint_tree(plant)
    names = [each.joint.name() for each in tree]
    asked = [name.rpartition("::")[2] for name in joints]
    for name in asked:
        if name not in names:
            raise GivenModelError(
                f"joint {name!r} of the run is not in {model}, which has {', '.join(names)}; give "
                "the model of the robot that made the run, with its joints called alike"
            )
    frames = [plant.get_frame(FrameIndex(index)) for index in range(plant.num_frames())]
    touching = find_named(plant, frames, frame, "--frame", "frame")
    worn = find_link(plant, link, "--link").body_frame()
    up, down = _between(tree, worn, touching)
    passed = [each for each in (*up, *down) if each.joint.name() in asked]
    for each in passed:
        if each.joint.num_positions() != 1:
            raise GivenModelError(
                f"joint {each.joint.name()!r} of {model} neither turns about one axis nor slides; "
                "fix it"
            )
    if not passed:
        raise GivenModelError(
            f"no joint of the run is between {link} and {frame} in {model}; name the link that "
            "wears the skin by --link and what touches it by --frame"
        )
    up, down = ([each for each in some if each in passed] for some in (up, down))
    way = _way(plant, up, down, worn, touching)
    return way, np.array([asked.index(name) for name in way.names])


def _parsed(model: Path) -> MultibodyPlant:
    """The finalized plant of a model, with free bases welded to the world."""

    def parsed() -> MultibodyPlant:
        plant = MultibodyPlant(time_step=0.0)
        parse_file(plant, model)
        return plant

    plant = parsed()
    plant.Finalize()
    if free := plant.GetFloatingBaseBodies():
        plant = parsed()
        for body in free:
            plant.WeldFrames(plant.world_frame(), plant.get_body(body).body_frame())
        plant.Finalize()
    return plant


def _between(
    tree: Sequence[TreeJoint], worn: Frame, touching: Frame
) -> tuple[list[TreeJoint], list[TreeJoint]]:
    """Joints that move one of two frames: up from the skin, and down to the toucher."""

    def carry(frame: Frame) -> list[TreeJoint]:
        moving = [each for each in tree if int(frame.body().index()) in each.moved]
        return sorted(moving, key=lambda each: len(each.moved))

    up, down = carry(worn), carry(touching)
    common = [each for each in up if each in down]
    return [e for e in up if e not in common], [e for e in down if e not in common][::-1]


def _way(
    plant: MultibodyPlant,
    up: Sequence[TreeJoint],
    down: Sequence[TreeJoint],
    worn: Frame,
    touching: Frame,
) -> GivenWay:
    """The way, all joints reading 0; the common link's frame is the world's, then."""
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, np.zeros(plant.num_positions()))

    def pose(frame: Frame) -> np.ndarray:
        return frame.CalcPoseInWorld(context).GetAsMatrix4()

    origins = {}
    ends = []
    for chain, end in ((up[::-1], worn), (down, touching)):
        before = np.eye(4)
        for each in chain:
            origins[each.joint.name()] = np.linalg.inv(before) @ pose(each.near)
            before = pose(each.near)
        ends.append(np.linalg.inv(before) @ pose(end))
    passed = [*up, *down]
    names = tuple(each.joint.name() for each in passed)
    return GivenWay(
        names=names,
        slides=np.array([not isinstance(each.joint, RevoluteJoint) for each in passed]),
        axes=np.array([_axis(each) for each in passed]),
        signs=np.array([-1.0] * len(up) + [1.0] * len(down)),
        origins=np.array([origins[name] for name in names]),
        skin=ends[0],
        toucher=ends[1],
        mount=_mount(plant, touching),
    )


def _axis(each: TreeJoint) -> np.ndarray:
    """Of a joint, in its frame, as the side away from the world moves."""
    joint = each.joint
    axis = joint.revolute_axis() if isinstance(joint, RevoluteJoint) else joint.translation_axis()
    backwards = each.near.index() != joint.frame_on_parent().index()
    return -axis if backwards else axis


def _mount(plant: MultibodyPlant, touching: Frame) -> str:
    """The fixed joint whose origin places a frame, or the frame itself if it is no link's own."""
    body = touching.body()
    if touching.index() != body.body_frame().index():
        return touching.name()
    for joint in all_joints(plant):
        if joint.num_positions() == 0 and joint.child_body().index() == body.index():
            return joint.name()
    return ""
