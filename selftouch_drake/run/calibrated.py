"""The calibration of a run: its touches beside a model of its robot, and its files."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from selftouch_drake.bodies.embodiment import build_world
from selftouch_drake.calibration.contacts import ModelledTouches
from selftouch_drake.calibration.least_squares import Calibrated, calibrate
from selftouch_drake.calibration.model import CalibrationError, read_kinematics
from selftouch_drake.files import write_csv, write_text_whole
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
    if len(placed) < 3:
        raise CalibrationError(
            f"{path} has {len(placed)} receptors that felt {_LEAST_FELT} touches or more; give a "
            "run with 3 or more"
        )
    touched = sensation[:, placed].any(axis=1)
    q, sensation = q[touched].astype(float), sensation[np.ix_(touched, placed)].astype(float)
    if len(q) < _LEAST_TOUCHES:
        raise CalibrationError(
            f"{path} has {len(q)} touches of this skin; give a run with {_LEAST_TOUCHES} or more"
        )
    contacts = ModelledTouches(
        kinematics, columns, q, radius, sensation.sum(axis=1), np.zeros(len(joints))
    )
    found = calibrate(contacts, sensation)
    return _written(path, found, joints, [names[n] for n in placed], link)


def _written(
    folder: Path, found: Calibrated, joints: Sequence[str], receptors: Sequence[str], link: str
) -> list[str]:
    """Writes `calibration.csv` and `calibration.json`; returns lines for the user."""
    axes = ("x", "y", "z")
    names = ["receptor", *axes, *(f"{axis}_half_interval" for axis in axes), "suspect"]
    columns = zip(receptors, found.places, found.place_interval, found.suspect, strict=True)
    rows = (
        [name, *(f"{v:.5f}" for v in (*place, *half)), int(suspect)]
        for name, place, half, suspect in columns
    )
    write_csv(folder / "calibration.csv", names, rows)
    offsets = {
        name: {"offset": float(offset), "half_interval": float(half)}
        for name, offset, half in zip(joints, found.offsets, found.offset_interval, strict=True)
    }
    unobservable = []
    for direction in found.unobservable:
        some = " with ".join(joints[n] for n in np.flatnonzero(np.abs(direction) > 0.3).tolist())
        unobservable.append(
            f"unobservable: the offset of {some}, which moves receptors as well; it is taken as 0"
        )
    # The mean of the places and their principal axes, the widest first.
    middle = found.places.mean(axis=0)
    axes_L = np.linalg.svd(found.places - middle, full_matrices=False)[2]
    axes_L[2] *= np.sign(np.linalg.det(axes_L))
    pose = {"link": link, "X_LS": np.column_stack([axes_L.T, middle]).tolist()}
    summary = {"offsets": offsets, "unobservable": unobservable, "skin": pose}
    write_text_whole(folder / "calibration.json", json.dumps(summary, indent=2) + "\n")
    half = np.linalg.norm(found.place_interval, axis=1)
    lines = [
        f"receptors: {len(receptors)} on {link}, ± {1e3 * np.median(half):.1f} mm (median, 95 %)"
    ]
    lines += [f"{n}: {o['offset']:+.4f} ± {o['half_interval']:.4f}" for n, o in offsets.items()]
    lines += unobservable
    if found.suspect.any():
        names = [receptors[n] for n in np.flatnonzero(found.suspect).tolist()]
        lines.append(f"suspect, their readings fit no place: {', '.join(names)}")
    return [*lines, f"calibration: {folder / 'calibration.csv'}"]
