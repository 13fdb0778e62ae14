"""What an agent recovers of its body if its skin reads less than forces.

    python benchmarks/accuracy/readings.py --shapes sphere cube torus --touches 20000

Each body is touched once, in random postures; all readings are of the same forces. With `gaps`, the
receptive fields do not overlap. The table goes to build/readings.csv.
"""

from __future__ import annotations

import argparse
import csv
import time
import warnings
from pathlib import Path

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.evaluation.shape import shape_rms_fraction
from selftouch_drake.experiment import load_experiment
from selftouch_drake.experiment.schema import ReadingSettings
from selftouch_drake.quotient.graph import DisconnectedWarning
from selftouch_drake.robot import World
from selftouch_drake.robot.readings import read_forces

#: N; about a tenth of the largest force on a receptor of a firm touch.
THRESHOLD = 0.1
READINGS = {
    "pressure": ReadingSettings(),
    "binary": ReadingSettings(mode="binary", threshold=THRESHOLD),
    "counts, 4 bits": ReadingSettings(mode="counts", bits=4, full_scale=3.0),
}
#: Widths of the receptive fields, as `field_width` has them.
WIDTHS = {"overlap": 1.0, "gaps": 0.5}
_POSTURES = 20_000


def touched(world: World, number: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q `(n, J)`, forces `(n, S)` N and places `(n, 3)` m of single touches in random postures."""
    rng, found, count = np.random.default_rng(seed), [], 0
    robot, probe = world.robot, world.probe
    while count < number:
        q = rng.uniform(*robot.babbled_range, (_POSTURES, robot.num_joints)).astype(np.float32)
        rows, touches = probe.felt_rows(q)
        once = np.bincount(touches.row, minlength=len(rows)) == 1
        kept = once & ~probe.impossible(q[rows])
        place = touches.of_rows(np.flatnonzero(kept)).p_LC
        found.append((q[rows[kept]], touches.sensation[kept], place))
        count += int(kept.sum())
    return tuple(np.concatenate(part)[:number] for part in zip(*found, strict=True))


def measured(
    q: np.ndarray, sensation: np.ndarray, place: np.ndarray, world: World, targets: int, seed: int
) -> dict[str, str]:
    """What the agent recovers of touches of one reading."""
    felt = sensation.any(axis=1)
    distinct = len(np.unique(sensation[felt], axis=0))
    row = {"felt": f"{felt.mean():.2f}", "distinct": str(distinct)}
    try:
        agent = Agent.learn(q[felt], sensation[felt], num_targets=targets, seed=seed)
        body = agent.recover(seed=seed)
    except ValueError as error:
        return row | {"holes": str(error)}
    known, part = agent.representation, body.parts[0]
    (skin,) = world.skins
    corner, weight = skin.fields.parts_at(place[felt][known.kernel_row])
    on_skin = np.einsum("nk,nki->ni", weight, skin.fields.vertices[corner])
    true = np.array([np.median(on_skin[known.members(k)], axis=0) for k in part.kernels])
    wide = [on_skin[known.members(k)].std(axis=0) for k in part.kernels]
    return row | {
        "parts": str(len(body.parts)),
        "holes": " ".join(map(str, part.topology.betti)),
        "shape error, %": f"{100 * shape_rms_fraction(body.positions[part.kernels], true):.2f}",
        "kernel width, mm": f"{1e3 * np.median(np.linalg.norm(wide, axis=1)):.1f}",
    }


def main() -> None:
    """Prints one line for each shape, field and reading."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shapes", nargs="+", default=["sphere", "cube", "torus"])
    parser.add_argument("--widths", nargs="+", default=list(WIDTHS), choices=WIDTHS)
    parser.add_argument("--readings", nargs="+", default=list(READINGS), choices=READINGS)
    parser.add_argument("--touches", type=int, default=100_000)
    parser.add_argument("--targets", type=int, default=300)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--out", type=Path, default=Path("build/readings.csv"))
    given = parser.parse_args()
    warnings.simplefilter("ignore", DisconnectedWarning)
    given.out.parent.mkdir(parents=True, exist_ok=True)
    with given.out.open("w", newline="") as file:
        table = None
        for shape in given.shapes:
            experiment = load_experiment(shape)
            q = place = None
            for width in given.widths:
                skin = {"body": {"field_width": WIDTHS[width]}}
                world = World(load_experiment(shape, {"skins": skin}))
                if q is None:
                    q, force, place = touched(world, given.touches, given.seed)
                else:
                    force = world.probe.sensations(q)
                for name in given.readings:
                    began = time.process_time()
                    read = read_forces(force, READINGS[name])
                    row = {"shape": shape, "fields": width, "reading": name}
                    row |= measured(q, read, place, world, given.targets, experiment.seed)
                    row["CPU s"] = f"{time.process_time() - began:.0f}"
                    if table is None:
                        columns = [*row, "parts", "holes", "shape error, %", "kernel width, mm"]
                        table = csv.DictWriter(file, dict.fromkeys(columns), extrasaction="ignore")
                        table.writeheader()
                    table.writerow(row)
                    file.flush()
                    print(row, flush=True)


if __name__ == "__main__":
    main()
