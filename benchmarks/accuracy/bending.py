"""Contact of plans before practice, with straight steps and with steps bent into the skin.

    python benchmarks/accuracy/bending.py --joints 9 12 --seeds 62 63 --touches 20000 60000

Runs are those of `joints.py`, a torus on a neck, with random and with active babbling; one that is
missing is made. The same random pairs of each are planned twice, with and without what the agent
learned of the ways between its touches. Nobody has followed the plans.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np

from selftouch_drake.bodies.embodiment import pilot_in
from selftouch_drake.evaluation.motion import contact_along, random_pairs
from selftouch_drake.experiment import load_experiment
from selftouch_drake.run.artifacts import load_agent
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.worlds import run_bodies

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.accuracy.joints import experiment_file
from benchmarks.shared.babbled import learned
from benchmarks.shared.results import ROOT, add_update_option, results


def run_of(joints: int, seed: int, touches: int, way: str, options: Any) -> RunDirectory:
    """The run of these sizes, after learning; makes it if it is missing."""
    size = {
        "seed": seed,
        "babbling": {"num_samples": touches, "strategy": way},
        "representation": {"num_targets": options.targets, "metric": "sensorimotor"},
    }
    experiment = load_experiment(experiment_file(options.out, joints), size)
    return learned(options.out / f"run_{joints}_{way}_{touches}_{seed}", experiment)


def contacts(run: RunDirectory, num_pairs: int) -> dict[str, float]:
    """Columns of the table: mean and worst contact."""
    agent, bodies, row = load_agent(run), run_bodies(run), dict[str, float]()
    assert bodies.world is not None
    pairs = random_pairs(run.experiment, agent.representation, num_pairs)
    for way, model in (("straight", None), ("bent", agent.touch_model)):
        planning = dataclasses.replace(agent, touch_model=model)
        start_of = pilot_in(bodies, planning, run.experiment).start_of
        plans = [planning.plan(*pair, q_start=start_of(*pair)) for pair in pairs]
        contact = [contact_along(bodies.world, plan) for plan in plans]
        row |= {way: round(float(np.mean(contact)), 4), f"{way}_worst": round(min(contact), 4)}
    return row


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--joints", nargs="+", type=int, default=[9, 12])
    parser.add_argument("--seeds", nargs="+", type=int, default=[62])
    parser.add_argument("--touches", nargs="+", type=int, default=[60_000])
    parser.add_argument("--ways", nargs="+", choices=("random", "active"), default=["random"])
    parser.add_argument("--targets", type=int, default=300)
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "bending", help="the runs")
    add_update_option(parser, "bending")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    cases = [
        (joints, seed, touches, way)
        for joints in options.joints
        for touches in options.touches
        for way in options.ways
        for seed in options.seeds
    ]
    with results("bending", update=options.update) as add:
        for joints, seed, touches, way in cases:
            run = run_of(joints, seed, touches, way, options)
            row: dict[str, Any] = {"joints": joints, "seed": seed, "touches": touches}
            row |= {"way": way, "targets": options.targets, "pairs": options.pairs}
            row |= contacts(run, options.pairs)
            print(row, flush=True)
            add(row)


if __name__ == "__main__":
    main()
