"""Contact of plans before practice, with straight steps and with steps that are bent into the skin.

    python benchmarks/joints.py --joints 9 12 --seed 7 --out runs/joints_7
    python benchmarks/bending.py runs/joints_7/run_9 runs/joints_7/run_12

The same random pairs of each run are planned twice, with and without what the agent learned of the
ways between its touches. Nobody has followed the plans.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from results import add_update_option, results

from selftouch_drake.evaluation.motion import contact_along, random_pairs
from selftouch_drake.run.artifacts import load_agent
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.worlds import run_bodies


def measured(run: RunDirectory, num_pairs: int) -> dict[str, Any]:
    """A row of the table."""
    agent, bodies = load_agent(run), run_bodies(run)
    assert bodies.world is not None
    known = agent.representation
    row: dict[str, Any] = {
        "joints": known.kernel_q.shape[1],
        "seed": run.experiment.seed,
        "touches": known.num_touches,
        "pairs": num_pairs,
    }
    pairs = random_pairs(run.experiment, known, num_pairs)
    for way, model in (("straight", None), ("bent", agent.touch_model)):
        planner = dataclasses.replace(agent, touch_model=model)
        plans = [planner.tour(pair) for pair in pairs]
        contact = [contact_along(bodies.world, plan) for plan in plans]
        row |= {way: round(float(np.mean(contact)), 4), f"{way}_worst": round(min(contact), 4)}
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, nargs="+", help="runs that have learned")
    parser.add_argument("--pairs", type=int, default=30)
    add_update_option(parser, "bending")
    options = parser.parse_args()
    with results("bending", update=options.update) as add:
        for path in options.runs:
            row = measured(RunDirectory.open(path), options.pairs)
            print(row, flush=True)
            add(row)


if __name__ == "__main__":
    main()
