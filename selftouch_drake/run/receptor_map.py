"""The map of receptors of a run or of a recording: its touches, and its table."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from selftouch_drake.agent.shape.receptor_map import ReceptorMap
from selftouch_drake.files import write_csv
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.imported import read_data
from selftouch_drake.run.stages import require_experience


def read_touches(
    source: Path, most: int, how: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Touches of a run, or of a recording, evenly taken if there are more than `most`.

    The source is a run, or what `read_data` reads with the other arguments. Returns `(n, J)` motor
    configurations, `(n, S)` sensations and S names of receptors.

    Raises:
        ValueError: there are no touches, or a run is given arguments of a recording.
    """
    if (source / "experiment.yaml").is_file():
        run = RunDirectory.open(source)
        require_experience(run)
        if how:
            raise ValueError(f"--{next(iter(how))} is given, but {source} is a run; leave it out")
        q = np.concatenate(list(run.touches().batches("q")))
        rows, first, kept = _evenly(len(q), most), 0, []
        for batch in run.touches().batches("sensation"):
            kept.append(batch[rows[(rows >= first) & (rows < first + len(batch))] - first])
            first += len(batch)
        q, sensation = q[rows], np.concatenate(kept)
        names = receptor_names(run, sensation.shape[1])
    else:
        data = read_data(source, **how)
        rows, names = _evenly(len(data.felt.q), most), list(data.recording.receptors)
        q, sensation = data.felt.q[rows], data.felt.sensation[rows]
    return q, sensation, names


def _evenly(num: int, most: int) -> np.ndarray:
    return np.linspace(0, num - 1, min(most, num)).astype(int)


def receptor_names(run: RunDirectory, num: int) -> list[str]:
    """Names of a run's receptors: as recorded, the skin and the number on it, or the number."""
    recorded = run.receptor_names()
    if recorded is not None and len(recorded) == num:
        return recorded
    skins = run.experiment.skins
    if sum(skin.num_receptors for skin in skins.values()) != num:
        return [str(number) for number in range(num)]
    return [f"{name}[{n}]" for name, skin in skins.items() for n in range(skin.num_receptors)]


def write_map(path: Path, found: ReceptorMap, names: Sequence[str]) -> None:
    """Writes a row for each receptor as CSV: name, part, place and error in spacings, touches."""
    rows = []
    columns = zip(names, found.part, found.positions, found.error, found.felt, strict=True)
    for name, part, place, error, felt in columns:
        numbers = ["" if np.isnan(v) else f"{v:.4g}" for v in (*place, error)]
        rows.append([name, "" if part < 0 else part, *numbers, felt])
    write_csv(path, ("receptor", "part", "x", "y", "z", "error", "touches"), rows)


def summary(found: ReceptorMap) -> list[str]:
    """A line for each part and each doubt."""
    lines = [f"joints explain {max(found.explained, 0.0):.0%} of what is felt"]
    for number, part in enumerate(found.parts):
        where = "in a plane" if part.flat else "in space"
        holes = "unknown"
        if part.holes_are_sure:
            assert part.topology is not None
            holes = " ".join(map(str, part.topology.betti))
        lines.append(
            f"part {number}: {len(part.receptors)} receptors {where}, components, loops, voids: "
            f"{holes}; error {np.nanmedian(found.error[part.receptors]):.2g} spacings (median)"
        )
    return [*lines, *(f"doubt: {doubt}" for doubt in found.doubts)]
