"""How well receptors and joint offsets are calibrated. Run it as a script.

    python benchmarks/accuracy/calibration.py [--experiment torus] [--seeds 20] [--first 100]
        [--wrong]

For each seed, a robot of the package babbles. Each time it comes to its skin, it stops at the first
touch of half a newton, as one would calibrate a robot: 300 touches. Its joints read wrong by up to
0.1 rad (uniform; not those whose offset no touch can show), 5 % of its taxels are dead or, with
`--wrong`, report the readings of another taxel. Then

- places: mm, median and root mean square distance from the true receptors;
- offsets: mrad, root mean square and largest error of those that touches tell;
- cover: share of the true values within the 95 % intervals;
- wrong, found: wrong taxels that were placed, and how many of them are suspected. Places and cover
  are of the other taxels.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import trimesh

from selftouch_drake.bodies.drake import DrakeBody
from selftouch_drake.calibration.contacts import ModelledTouches
from selftouch_drake.calibration.least_squares import calibrate
from selftouch_drake.calibration.model import read_kinematics
from selftouch_drake.experience.collect import random_walk
from selftouch_drake.experiment import load_experiment
from selftouch_drake.resources import MODELS
from selftouch_drake.robot import World

NUM_TOUCHES, DEAD, OFFSET, FORCE = 300, 0.05, 0.1, 0.5
MODEL = {"torus": "one_finger", "sphere": "one_finger", "turning_body": "turning_body"}
# Joints whose offsets move the receptors as well.
UNOBSERVABLE = {"torus": (0,), "sphere": (0,), "turning_body": (0, 2, 3)}
STEPS = 4000


def gentle_touches(world: World) -> tuple[np.ndarray, np.ndarray]:
    """`(n, J)` postures at the first touch of a skin from outside, and `(n, S)` N sensations."""
    body, fields = DrakeBody(world), world.skins[0].fields
    mesh = trimesh.Trimesh(fields.vertices, fields.faces, process=False)
    found, number, walk = [], 0, 0
    while number < NUM_TOUCHES:
        path = random_walk(world.experiment, body, walk).steps(STEPS)
        felt, walk = body.feel(path), walk + 1
        total = np.zeros(len(path))
        total[: len(felt.sensation)] = felt.sensation.sum(axis=1)
        comes = felt.reached[1:] & felt.reached[:-1] & (total[:-1] == 0) & (total[1:] > FORCE)
        free, touching = path[:-1][comes], path[1:][comes]
        for _ in range(14):
            middle = (free + touching) / 2
            firm = (world.probe.sensations(middle).sum(axis=1) > FORCE)[:, None]
            free, touching = np.where(firm, free, middle), np.where(firm, middle, touching)
        X_WL, X_WF = world.robot.kinematics.poses(touching).swapaxes(0, 1)
        centre = np.einsum("nji,nj->ni", X_WL[:, :, :3], X_WF[:, :, 3] - X_WL[:, :, 3])
        _, near = mesh.kdtree.query(centre)
        outside = np.einsum("nx,nx->n", centre - mesh.vertices[near], mesh.vertex_normals[near]) > 0
        found.append(touching[outside])
        number += int(outside.sum())
    q = np.concatenate(found)[:NUM_TOUCHES]
    return q, world.probe.sensations(q)


def measure(name: str, seed: int, exchange: bool) -> dict[str, float]:
    """One row of the table."""
    experiment = load_experiment(name, {"seed": seed})
    world, rng = World(experiment), np.random.default_rng(seed)
    q, sensation = gentle_touches(world)
    ((_, toucher),) = experiment.touching.items()
    joints = world.robot.joint_names
    kinematics, columns = read_kinematics(
        MODELS / f"{MODEL[name]}.dmd.yaml", joints, "body", toucher.frame, toucher.radius
    )
    true, offsets = world.skins[0].fields.p_LS, rng.uniform(-OFFSET, OFFSET, len(joints))
    offsets[list(UNOBSERVABLE[name])] = 0.0
    bad, order = int(DEAD * len(true)), rng.permutation(len(true))
    sensation[:, order[:bad]] = sensation[:, order[bad : 2 * bad]] if exchange else 0.0
    strong = sensation > 0.5 * sensation.max(axis=1, keepdims=True)
    placed = strong.sum(axis=0) >= 4
    touched = sensation[:, placed].any(axis=1)
    felt = sensation[np.ix_(touched, placed)].astype(float)
    contacts = ModelledTouches(
        kinematics,
        columns,
        q[touched] - offsets,
        toucher.radius,
        felt.sum(1),
        np.zeros(len(joints)),
    )
    found = calibrate(contacts, felt)
    wrong_ones = np.isin(np.flatnonzero(placed), order[:bad])
    off = (found.places - true[placed])[~wrong_ones]
    apart = 1e3 * np.linalg.norm(off, axis=1)
    observable = np.ones(len(joints), dtype=bool)
    observable[list(UNOBSERVABLE[name])] = False
    wrong = np.abs(found.offsets - offsets)[observable]
    return {
        "touches": int(touched.sum()),
        "receptors": int(placed.sum()),
        "places median, mm": float(np.median(apart)),
        "places rms, mm": float(np.sqrt(np.mean(apart**2))),
        "places cover": float(np.mean(np.abs(off) <= found.place_interval[~wrong_ones])),
        "offsets rms, mrad": float(1e3 * np.sqrt(np.mean(wrong**2))),
        "offsets worst, mrad": float(1e3 * wrong.max()),
        "offsets cover": float(np.mean(wrong <= found.offset_interval[observable])),
        "unobservable": len(found.unobservable),
        "wrong": int(wrong_ones.sum()),
        "found": int((wrong_ones & found.suspect).sum()),
        "others suspected": int((~wrong_ones & found.suspect).sum()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--experiment", choices=list(MODEL), default="torus")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--wrong", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("build/calibration.md"))
    given = parser.parse_args()
    rows: list[dict[str, float]] = []
    lines: list[str] = []
    for seed in range(given.first, given.first + given.seeds):
        rows.append(measure(given.experiment, seed, given.wrong))
        cells = [f"{value:.3g}" for value in rows[-1].values()]
        if not lines:
            lines += [f"| seed | {' | '.join(rows[-1])} |", "|---" * (len(cells) + 1) + "|"]
            print(*lines, sep="\n")
        lines.append(f"| {seed} | {' | '.join(cells)} |")
        print(lines[-1], flush=True)
    means = [f"{np.mean([row[key] for row in rows]):.3g}" for key in rows[0]]
    lines.append(f"| mean | {' | '.join(means)} |")
    print(lines[-1])
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
