"""Touches of a lesson until the body is accepted: `selftouch teach` with a body that moves itself.

    python benchmarks/accuracy/teaching.py torus --seeds 1 2 3

For each seed the robot of an experiment is taught from its first touch on. Printed are the touches
after which a body was first accepted, those after which the lesson ended, whether the run that is
made of it has an accepted body, and the seconds of processor time.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from selftouch_drake.bodies.embodiment import make_bodies
from selftouch_drake.experiment import load_experiment
from selftouch_drake.run.artifacts import load_body_model
from selftouch_drake.run.streams import MovingBody
from selftouch_drake.run.teaching import Lesson, Look, columns_of, teach_and_learn


def taught(name: str, seed: int, most: int, folder: Path) -> list[str]:
    """The cells of a row."""
    body = make_bodies(load_experiment(name, {"seed": seed})).babbling
    lesson = Lesson(
        folder=folder / f"{name}-{seed}",
        how=columns_of(body.joint_names) | {"offset": 0.0, "threshold": 1e-6},
        most=most,
        limits=np.stack([body.lower, body.upper]),
        seed=seed,
    )
    looks: list[Look] = []
    began = time.process_time()
    last, run = teach_and_learn(
        lesson,
        lambda stored: MovingBody(body, seed + len(stored), bool(stored)),
        looks.append,
        lambda done, doing: None,
    )
    seconds = time.process_time() - began
    first = next((str(n.known.num_touches) for n in looks if n.known.accepted), "never")
    ended = "no touch" if last is None else str(last.known.num_touches)
    enough = "yes" if last is not None and last.known.is_enough else "no"
    accepted = "no run" if run is None else str(load_body_model(run).accepted)
    return [first, ended, enough, accepted, f"{seconds:.0f}"]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("experiments", nargs="+")
    parser.add_argument("--seeds", nargs="+", type=int, default=list(range(1, 6)))
    parser.add_argument("--touches", type=int, default=1500, help="after which a lesson ends")
    parser.add_argument("--out", type=Path, help="folder of the lessons")
    args = parser.parse_args()
    print("experiment      seed  accepted at  ended at  enough  run accepted  s")
    with tempfile.TemporaryDirectory() as aside:
        for name in args.experiments:
            for seed in args.seeds:
                cells = taught(name, seed, args.touches, args.out or Path(aside))
                print(
                    f"{name:14s}  {seed:4d}  {cells[0]:11s}  {cells[1]:8s}  {cells[2]:6s}",
                    f"{cells[3]:12s}  {cells[4]}",
                    sep="  ",
                    flush=True,
                )


if __name__ == "__main__":
    main()
