"""Effect of the random walk's parameters on touch rate and coverage. Run it as a script.

Every row collects the same number of touches of one robot; the table stands in docs/experience.md.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from selftouch_drake.bodies.embodiment import body_of
from selftouch_drake.evaluation.coverage import coverage
from selftouch_drake.evaluation.parts import TouchCounts
from selftouch_drake.experience.collect import collect
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.executors import local_executor

WALKS = [
    *({"step_size": step, "persistence": 0.9} for step in (0.003, 0.01, 0.05, 0.15, 0.6)),
    *({"step_size": 0.15, "persistence": share} for share in (0.0, 0.99)),
    {"step_size": 0.15, "persistence": 0.9, "mode": "dynamic"},
]


def measure(name: str, walk: dict, num_samples: int, executor) -> str:
    """Collects one run and returns its line of the table."""
    babbling = {**walk, "num_samples": num_samples, "walk_size": max(num_samples // 8, 1)}
    targets = {"num_targets": 50}  # nothing is learned
    experiment = load_experiment(name, {"babbling": babbling, "representation": targets})
    fields = [skin.fields for skin in World(experiment).skins]
    with tempfile.TemporaryDirectory() as folder:
        run = RunDirectory.create(Path(folder) / "run", experiment)
        began = time.perf_counter()
        how = {"fingerprint": run.fingerprint(), "executor": executor, "body_of": body_of}
        counts = collect(experiment, run.path, **how)
        wall = time.perf_counter() - began
        touched = TouchCounts(fields, ExperienceReader(run.truth).contacts())
        force = ExperienceReader(run.experience).read("sensation").sum(axis=1)
    covered = coverage(
        [
            (skin.vertices, skin.faces, number)
            for skin, number in zip(fields, touched.counts, strict=True)
        ]
    )
    return (
        f"| {walk.get('mode', 'kinematic')} | {walk['step_size']} | {walk['persistence']} "
        f"| {num_samples / counts.num_steps:.1%} | {covered['coverage_share_10_touches']:.1%} "
        f"| {covered['coverage_evenness']:.3f} | {np.median(force):.1f} / {force.max():.1f} "
        f"| {num_samples / wall:,.0f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--experiment", default="cube", help="name of a shipped one, or a file")
    parser.add_argument("--touches", type=int, default=50_000, help="of each row")
    arguments = parser.parse_args()
    print("| mode | step size (rad) | persistence | touch rate | skin touched ≥ 10 times ", end="")
    print("| evenness | force, median / max (N) | touches/s |")
    print("|---" * 8 + "|")
    for walk in WALKS:
        with local_executor() as executor:
            print(measure(arguments.experiment, walk, arguments.touches, executor), flush=True)


if __name__ == "__main__":
    main()
