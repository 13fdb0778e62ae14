"""Files of a calibration: receptors as CSV, offsets and the pose of the skin as JSON."""

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from selftouch_drake.calibration.least_squares import Calibrated
from selftouch_drake.files import write_text_whole


def write_calibration(
    folder: Path, found: Calibrated, joints: Sequence[str], receptors: Sequence[str], link: str
) -> list[str]:
    """Writes `calibration.csv` and `calibration.json`; returns lines for the user."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    axes = ("x", "y", "z")
    writer.writerow(["receptor", *axes, *(f"{axis}_half_interval" for axis in axes), "suspect"])
    rows = zip(receptors, found.places, found.place_interval, found.suspect, strict=True)
    for name, place, half, suspect in rows:
        writer.writerow([name, *(f"{v:.5f}" for v in (*place, *half)), int(suspect)])
    offsets = {
        name: {"offset": float(offset), "half_interval": float(half)}
        for name, offset, half in zip(joints, found.offsets, found.offset_interval, strict=True)
    }
    untold = []
    for direction in found.untold:
        some = [joints[n] for n in np.flatnonzero(np.abs(direction) > 0.3).tolist()]
        untold.append(
            f"not told: the offset of {' with '.join(some)}, which moves receptors as well; it is "
            "taken as 0"
        )
    # The mean of the places and their principal axes, the widest first.
    middle = found.places.mean(axis=0)
    axes_L = np.linalg.svd(found.places - middle, full_matrices=False)[2]
    axes_L[2] *= np.sign(np.linalg.det(axes_L))
    pose = {"link": link, "X_LS": np.column_stack([axes_L.T, middle]).tolist()}
    folder.mkdir(parents=True, exist_ok=True)
    write_text_whole(folder / "calibration.csv", text.getvalue())
    summary = {"offsets": offsets, "not_told": untold, "skin": pose}
    write_text_whole(folder / "calibration.json", json.dumps(summary, indent=2) + "\n")
    half = np.linalg.norm(found.place_interval, axis=1)
    lines = [
        f"receptors: {len(receptors)} on {link}, ± {1e3 * np.median(half):.1f} mm (median, 95 %)"
    ]
    lines += [f"{n}: {o['offset']:+.4f} ± {o['half_interval']:.4f}" for n, o in offsets.items()]
    lines += untold
    if found.suspect.any():
        names = [receptors[n] for n in np.flatnonzero(found.suspect).tolist()]
        lines.append(f"suspect, their readings fit no place: {', '.join(names)}")
    return [*lines, f"calibration: {folder / 'calibration.csv'}"]
