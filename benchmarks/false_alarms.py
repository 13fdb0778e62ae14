"""How often an agent takes a body that stays as it is for one that changed. Run it as a script.

    python benchmarks/false_alarms.py --out docs/data/false_alarms.csv
    python benchmarks/false_alarms.py --bodies torus --seeds 1 2 3

All lives are random walks in the kinematic world. For each body and seed an agent lives `--touches`
touches of a body that does not change. A row of the CSV file holds the number of alarms, and the
greatest statistic of each test as a share of what raises the alarm: of the sum of surprise, of
receptors that may have fallen silent, and of receptors that may be new. Rows that are already in
the file are not computed again.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
from mending import BODIES, kept, store, touches

from selftouch_drake.agent.lifelong import Life, OnlineLearner
from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World

#: Touches in each walk.
WALK = 2500


def lived(body: str, seed: int, args: argparse.Namespace) -> dict[str, Any]:
    """One row of the table."""
    world, began = World(load_experiment(body, {"seed": seed})), time.process_time()
    life = Life(lambda: OnlineLearner(args.targets, seed=seed), seed=seed)
    walks = touches(world, 0, WALK)
    while life.num_touches < args.touches:
        life.take(*next(walks))
    alarm, silenced, newcomers = np.max(life.doubts, axis=0)
    return {
        "body": body,
        "seed": seed,
        "touches": life.num_touches,
        "alarms": len(life.noticed) + life.has_doubts,
        "surprise": alarm,
        "silenced": silenced,
        "newcomers": newcomers,
        "cpu_s": time.process_time() - began,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bodies", nargs="+", default=BODIES)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--touches", type=int, default=100_000)
    parser.add_argument("--targets", type=int, default=200)
    parser.add_argument("--out", type=Path, default=Path("docs/data/false_alarms.csv"))
    args = parser.parse_args()
    rows = kept(args.out)
    done = {(row["body"], int(row["seed"])) for row in rows}
    for seed in args.seeds:
        for body in args.bodies:
            if (body, seed) not in done:
                rows.append({k: str(v) for k, v in lived(body, seed, args).items()})
                store(rows, args.out)
                print(rows[-1], flush=True)


if __name__ == "__main__":
    main()
