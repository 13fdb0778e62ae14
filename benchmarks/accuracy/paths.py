"""How much longer plans are on the skin than the shortest way along it, before and after practice.

    for seed in 101 102 103; do
        for body in torus cube turning_body two_arms; do
            selftouch babble $body --out runs/$body-$seed \
                --set "{seed: $seed, babbling: {num_samples: 100000},
                    representation: {num_targets: 300}}"
            selftouch learn runs/$body-$seed
        done
    done
    python benchmarks/accuracy/paths.py runs/*-10?

The table has the two arms with 400,000 touches and 500 targets. The same random pairs
of each run are planned and practised twice, from the same starts: with routes that keep the motion
of the joints short (`planning.prefer: joints`), and with those that keep the path on the body
short.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.motions import Plan
from selftouch_drake.agent.practice import NoWayError, practise
from selftouch_drake.agent.practice.sliding import Slider
from selftouch_drake.bodies.drake import DrakeBodies
from selftouch_drake.bodies.embodiment import pilot_in
from selftouch_drake.evaluation.motion import jerk_reduction, random_pairs
from selftouch_drake.evaluation.paths import OwnPaths, TruePaths
from selftouch_drake.run.artifacts import load_agent
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.worlds import run_bodies

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.results import add_update_option, results

# rad of path, between samples of a plan.
_SAMPLED = 0.02


class Judge:
    """Scores plans of one run."""

    def __init__(self, agent: Agent, bodies: DrakeBodies):
        self._body, self._scale = bodies.still, agent.representation.joint_scale
        self._own = OwnPaths(agent.representation)
        self._true = TruePaths([skin.fields for skin in bodies.world.skins])

    def __call__(self, plan: Plan) -> tuple[float, float, float, float]:
        """Contact, path over the shortest by the truth and by the agent, and jerk reduction.

        Ratios are NaN where they mean nothing.
        """
        length = plan.waypoint_s[-1]
        s = np.linspace(0.0, length, 2 + int(length / _SAMPLED))
        felt, touching = self._body.feel(plan.path(s)), plan.touching(s)
        ratios: list[float | None] = [None, None]
        if touching.all():
            ratios = [
                self._true.over_shortest(felt.contacts),
                self._own.over_shortest(felt.sensation),
            ]
        true, own = (np.nan if ratio is None else ratio for ratio in ratios)
        contact = float(felt.sensation[touching].any(axis=1).mean())
        return contact, true, own, jerk_reduction(plan, self._scale)


def measured(run: RunDirectory, prefer: Any, num_pairs: int) -> dict[str, Any]:
    """A row of the table."""
    bodies = run_bodies(run)
    assert isinstance(bodies, DrakeBodies)
    agent = dataclasses.replace(load_agent(run), prefer=prefer)
    known = agent.representation
    pilot, judge = pilot_in(bodies, agent, run.experiment), Judge(agent, bodies)
    slider = Slider(bodies.practice, known.joint_scale)
    scores: dict[str, list[tuple[float, float, float, float]]] = {
        "unpractised": [],
        "practised": [],
    }
    for pair in random_pairs(run.experiment, known, num_pairs):
        try:
            found = practise(agent, slider, pair, q_start=pilot.start_of(*pair))
        except NoWayError:
            continue
        scores["unpractised"].append(judge(found.unpractised))
        scores["practised"].append(judge(found.plan))
    row: dict[str, Any] = {
        "seed": run.experiment.seed,
        "body": run.experiment.name,
        "prefer": prefer,
        "pairs": len(scores["practised"]),
    }
    for name, found in scores.items():
        contact, true, own, jerk = np.array(found).T
        for whose, ratio in (("", true), ("own_", own)):
            row[f"{name}_{whose}path_over_shortest"] = round(float(np.nanmedian(ratio)), 3)
            row[f"{name}_{whose}path_over_shortest_worst"] = round(float(np.nanmax(ratio)), 3)
        row[f"{name}_contact"] = round(float(contact.mean()), 4)
        row[f"{name}_contact_worst"] = round(float(contact.min()), 4)
        row[f"{name}_jerk_reduction"] = round(float(np.median(jerk)), 1)
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, nargs="+", help="runs that have learned")
    parser.add_argument("--pairs", type=int, default=30)
    add_update_option(parser, "paths")
    options = parser.parse_args()
    with results("paths", update=options.update) as add:
        for path in options.runs:
            for prefer in ("joints", "body"):
                row = measured(RunDirectory.open(path), prefer, options.pairs)
                print(row, flush=True)
                add(row)


if __name__ == "__main__":
    main()
