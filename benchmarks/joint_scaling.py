"""Effect of joint scaling on shape and contact. Run it as a script on runs that have babbled.

    python benchmarks/joint_scaling.py runs/torus runs/cube runs/sphere --unit 0.2 1 5 1 1 1

Candidates, all brought to the same spread of configurations, so that lengths mean the same:

- `none`: the robot's own units;
- `deviation`, `range`, `median`: each joint over the standard deviation, the range, the median
  distance from the median of what touched;
- `feel`: by how much each joint changes the sensation, as the agent does it.

`--unit` multiplies the stored angles first, as if joints were measured in other units. The table
stands in docs/joint_scaling.md.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import numpy as np

from selftouch_drake.agent.planning import Planner
from selftouch_drake.agent.representation import QuotientLearner, joint_scale
from selftouch_drake.agent.shape import recover
from selftouch_drake.evaluation.kernels import kernel_truth
from selftouch_drake.evaluation.shape import shape_errors
from selftouch_drake.experience import ExperienceReader
from selftouch_drake.robot.world import World
from selftouch_drake.run.directory import RunDirectory

Scaling = Callable[[np.ndarray, np.ndarray], np.ndarray]
METRICS = ("motor", "sensorimotor", "learned")
# rad of path length between configurations at which contact is looked for.
STEP = 0.02
# Root mean square over joints of the standard deviation of scaled configurations.
SPREAD = 1.6


def even(factor: Callable[[np.ndarray], np.ndarray]) -> Scaling:
    """A scaling by some measure of each joint, normalised to the common spread."""

    def scaling(q: np.ndarray, sensation: np.ndarray) -> np.ndarray:
        scale = 1.0 / factor(q.astype(float))
        return scale * SPREAD / np.sqrt(np.mean(np.square(q.std(axis=0) * scale)))

    return scaling


SCALINGS: dict[str, Scaling] = {
    "none": lambda q, sensation: np.ones(q.shape[1]),
    "deviation": even(lambda q: q.std(axis=0)),
    "range": even(lambda q: np.ptp(q, axis=0)),
    "median": even(lambda q: np.median(np.abs(q - np.median(q, axis=0)), axis=0)),
    "feel": joint_scale,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--scalings", nargs="+", choices=SCALINGS, default=list(SCALINGS))
    parser.add_argument("--unit", nargs="+", type=float, default=[1.0])
    parser.add_argument("--targets", type=int, default=300)
    parser.add_argument("--pairs", type=int, default=40)
    arguments = parser.parse_args()
    print("| run | scaling |", " | ".join(f"{m}, %" for m in METRICS), "| contact, % | worst, % |")
    print("|---|---|" + "---|" * (len(METRICS) + 2))
    for path in arguments.runs:
        for name in arguments.scalings:
            row = measured(RunDirectory.open(path), SCALINGS[name], arguments)
            print(f"| {path.name} | {name} |", " | ".join(f"{v:.2f}" for v in row), "|", flush=True)


def measured(run: RunDirectory, scaling: Scaling, arguments: argparse.Namespace) -> list[float]:
    """Shape error by each metric, mean and worst contact of planned paths, in percent."""
    reader = ExperienceReader(run.experience)
    unit = np.broadcast_to(arguments.unit, reader.read("q").shape[1])
    sensation, q = reader.read("sensation"), (reader.read("q") * unit).astype(np.float32)
    learner = QuotientLearner(arguments.targets, random_state=0)
    with (
        mock.patch("selftouch_drake.agent.representation.learning.joint_scale", scaling),
        warnings.catch_warnings(action="ignore"),
    ):
        known = learner.fit(sensation, q).representation_
    truth = kernel_truth(known, ExperienceReader(run.truth).take_contacts(known.kernel_row))
    errors = [
        np.mean(
            list(shape_errors(recover(known, m, holes=False).positions, known.part, truth).values())
        )
        for m in METRICS
    ]
    planner, probe = Planner(known), World(run.experiment).probe
    rng, contact = np.random.default_rng(5), []
    for _ in range(arguments.pairs):
        start, goal = (int(target) for target in rng.choice(known.num_targets, 2, replace=False))
        members = known.kernel_q[known.members(start)]
        plan = planner.plan(members[rng.integers(len(members))], [start, goal])
        length = plan.waypoint_s[-1]
        path = plan.path(np.linspace(0.0, length, max(2, int(length / STEP))))
        contact.append(probe.sensations(path / unit).any(axis=1).mean())
    return [100.0 * float(v) for v in (*errors, np.mean(contact), np.min(contact))]


if __name__ == "__main__":
    main()
