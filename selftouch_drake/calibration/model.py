"""The kinematics of a robot's model file, for the joints of a run."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FrameIndex

from selftouch_drake.robot.kinematics import Kinematics, joint_tree
from selftouch_drake.robot.links import find_link, find_named
from selftouch_drake.robot.models import parse_file


class CalibrationError(ValueError):
    """A model or touches that do not fit; the text says what to do."""


def read_kinematics(
    model: Path, joints: Sequence[str], link: str, frame: str, radius: float
) -> tuple[Kinematics, np.ndarray]:
    """Kinematics of a link that wears skin, of the frame of a ball, and of one behind the ball.

    Args:
        model: a URDF, SDFormat, MJCF or model directives file; a free base is welded to the world.
        joints: J names, in the order of q; other joints of the model stay at 0.
        link: that wears the skin.
        frame: of the ball; a link's name stands for its own frame.
        radius: m, of the ball.

    Returns:
        The kinematics, and `(J,)` the places of the run's joints among those of the model.

    Raises:
        FileNotFoundError: there is no such model.
        CalibrationError: the model lacks a joint, or has one that neither turns nor slides.
        ExperimentError: the model cannot be read, or lacks the link or the frame.
    """
    if not model.is_file():
        raise FileNotFoundError(f"{model} does not exist; give a URDF, SDFormat or MJCF file")
    plant = _parsed(model)
    plant.Finalize()
    if free := plant.GetFloatingBaseBodies():
        plant = _parsed(model)
        for body in free:
            plant.WeldFrames(plant.world_frame(), plant.get_body(body).body_frame())
        plant.Finalize()
    tree = joint_tree(plant)
    names = [joint.name() for joint, *_ in tree]
    asked = [name.rpartition("::")[2] for name in joints]
    for name in asked:
        if name not in names:
            raise CalibrationError(
                f"joint {name!r} of the run is not in {model}, which has {', '.join(names)}; give "
                "the model of the robot that made the run, with its joints called alike"
            )
    for joint, *_ in tree:
        if joint.num_positions() != 1:
            raise CalibrationError(
                f"joint {joint.name()!r} of {model} neither turns about one axis nor slides; fix it"
            )
    frames = [plant.get_frame(FrameIndex(index)) for index in range(plant.num_frames())]
    ball = find_named(plant, frames, frame, "--frame", "frame")
    worn = find_link(plant, link, "--link")
    # The frame behind the ball: of the last joint on its way that is not inside it.
    context = plant.CreateDefaultContext()
    centre = ball.CalcPoseInWorld(context).translation()
    carry = [(far, moved) for *_, far, moved in tree if int(ball.body().index()) in moved]
    behind = plant.world_frame()
    for far, _ in sorted(carry, key=lambda one: -len(one[1])):
        if np.linalg.norm(far.CalcPoseInWorld(context).translation() - centre) > 2.0 * radius:
            behind = far
    found = Kinematics.of(plant, [worn.body_frame(), ball, behind])
    return found, np.array([names.index(name) for name in asked])


def _parsed(model: Path) -> MultibodyPlant:
    plant = MultibodyPlant(time_step=0.0)
    parse_file(plant, model)
    return plant
