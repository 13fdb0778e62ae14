"""The calibration of a run: its touches beside a model of its robot."""

from pathlib import Path

import numpy as np

from selftouch_drake.bodies.embodiment import build_world
from selftouch_drake.calibration.contacts import Contacts
from selftouch_drake.calibration.least_squares import calibrate
from selftouch_drake.calibration.model import CalibrationError, read_kinematics
from selftouch_drake.calibration.tables import write_calibration
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.receptor_map import read_touches

#: Most touches that are taken, and fewest of a receptor that is placed.
_MOST_TOUCHES, _LEAST_FELT = 1000, 4
#: A receptor feels a touch strongly from this share of the strongest reading on.
_STRONG = 0.5
#: Fewest touches of a calibration.
_LEAST_TOUCHES = 30


def calibrate_run(
    path: Path, model: Path, link: str, frame: str, radius: float, receptors: list[int] | None
) -> list[str]:
    """Calibrates the skin of a run, writes its files into the run, and returns lines for the user.

    Receptors are the first and the last on the link; None takes all.

    Raises:
        FileNotFoundError: there is no model.
        ValueError: the run or the model cannot be used; the text says what to do.
    """
    run = RunDirectory.open(path)
    imported = run.experiment.imported
    joints = list(imported.joints if imported else build_world(run.experiment).robot.joint_names)
    kinematics, columns = read_kinematics(model, joints, link, frame, radius)
    q, sensation, names = read_touches(path, _MOST_TOUCHES, {})
    if receptors is not None:
        first, last = receptors[0], receptors[-1]
        if not 0 <= first <= last < len(names):
            raise CalibrationError(
                f"--receptors is {first},{last}; give two numbers from 0 to {len(names) - 1}"
            )
        outside = (np.arange(len(names)) < first) | (np.arange(len(names)) > last)
        sensation = np.where(outside, 0.0, sensation)
    # Weakly felt receptors lie beyond what was touched.
    strong = sensation > _STRONG * sensation.max(axis=1, keepdims=True)
    placed = np.flatnonzero(strong.sum(axis=0) >= _LEAST_FELT)
    touched = sensation[:, placed].any(axis=1)
    q, sensation = q[touched].astype(float), sensation[np.ix_(touched, placed)].astype(float)
    if len(q) < _LEAST_TOUCHES:
        raise CalibrationError(
            f"{path} has {len(q)} touches of this skin; give a run with {_LEAST_TOUCHES} or more"
        )
    contacts = Contacts(
        kinematics, columns, q, radius, sensation.sum(axis=1), np.zeros(len(joints))
    )
    found = calibrate(contacts, sensation)
    return write_calibration(path, found, joints, [names[n] for n in placed], link)
