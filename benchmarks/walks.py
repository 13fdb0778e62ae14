"""What the parameters of the random walk do to touch rate and coverage. Run it as a script.

Every row collects the same number of touches of one body; the table stands in docs/experience.md.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from selftouch_drake.evaluation import coverage
from selftouch_drake.experience import ExperienceReader, collect
from selftouch_drake.experiment import load_experiment
from selftouch_drake.geometry import build_body
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.executors import local_executor

WALKS = [
    *({"step_size": step, "persistence": 0.9} for step in (0.003, 0.01, 0.05, 0.15, 0.6)),
    *({"step_size": 0.15, "persistence": share} for share in (0.0, 0.99)),
    {"step_size": 0.15, "persistence": 0.9, "mode": "dynamic"},
]


def measure(body: str, walk: dict, num_samples: int, executor) -> str:
    """Collects one run and returns its line of the table."""
    babbling = {**walk, "num_samples": num_samples, "walk_size": max(num_samples // 8, 1)}
    experiment = load_experiment(body, {"babbling": babbling})
    _, fields = build_body(experiment)
    with tempfile.TemporaryDirectory() as folder:
        run = RunDirectory.create(Path(folder) / "run", experiment)
        began = time.perf_counter()
        num_steps = collect(run, executor=executor)
        wall = time.perf_counter() - began
        p_WF = ExperienceReader(run.truth).read("p_WF")
        force = ExperienceReader(run.experience).read("sensation").sum(axis=1)
    covered = coverage(fields.vertices, fields.faces, [p_WF.reshape(-1, 3)])
    return (
        f"| {walk.get('mode', 'kinematic')} | {walk['step_size']} | {walk['persistence']} "
        f"| {num_samples / num_steps:.1%} | {covered['coverage_share_10_touches']:.1%} "
        f"| {covered['coverage_evenness']:.3f} | {np.median(force):.1f} / {force.max():.1f} "
        f"| {num_samples / wall:,.0f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--body", default="cube")
    parser.add_argument("--touches", type=int, default=50_000)
    arguments = parser.parse_args()
    print("| mode | step size (rad) | persistence | touch rate | skin touched ≥ 10 times ", end="")
    print("| evenness | force, median / max (N) | touches/s |")
    print("|---" * 8 + "|")
    for walk in WALKS:
        with local_executor() as executor:
            print(measure(arguments.body, walk, arguments.touches, executor), flush=True)


if __name__ == "__main__":
    main()
