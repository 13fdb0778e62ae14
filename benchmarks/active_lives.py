"""Whether an agent that explores actively notices that its body changed. Run it as a script.

    python benchmarks/active_lives.py --bodies torus cube --seeds 6 7

All lives are in the kinematic world, with `babbling.strategy: active`. For each body and seed an
agent lives `--touches` touches. Then, for each kind of change, this life goes on with the changed
body until the agent has found out what changed, or for `--watched` touches. `none` is a body that
does not change, and goes on for as long; then each alarm is false. Every life is a row of the CSV
file. Rows that are already in the file are not computed again.
"""

from __future__ import annotations

import argparse
import copy
import time
from pathlib import Path
from typing import Any

import numpy as np
from mending import Bench, changes, kept, store

from selftouch_drake.agent.living import Life
from selftouch_drake.experience import Shard
from selftouch_drake.experience.sources import KinematicSource
from selftouch_drake.exploration import Exploration
from selftouch_drake.robot import World

#: Fewest and most touches in each round of exploration; in between, a tenth of those before.
ROUND = 250, 2000


def explored(exploration: Exploration, num_touches: int) -> Shard:
    """The next round of an agent that has so many touches."""
    shard = exploration.explore(int(np.clip(num_touches // 10, *ROUND)))
    exploration.remember(shard.q, shard.sensation)
    return shard


def in_another_body(exploration: Exploration, world: World) -> Exploration:
    """The same agent in another world; the first one stays as it is."""
    other = copy.copy(exploration)
    other.learner, other.source = copy.deepcopy(exploration.learner), KinematicSource(world)
    return other


def measure(
    bench: Bench, kind: str, exploration: Exploration, life: Life, watched: int
) -> dict[str, Any]:
    """One row: the life goes on in a body that changed, or did not."""
    began, born = time.process_time(), life.num_touches
    if kind != "none":
        exploration = in_another_body(exploration, bench.world(changes(kind, bench.patch)[1]))
    before, life = len(life.noticed), copy.deepcopy(life)
    taken = born
    while taken - born < watched and len(life.noticed) == before:
        shard = explored(exploration, taken)
        life.take(shard.q, shard.sensation)
        taken += len(shard.q)
    alarms = life.noticed[before:]
    return {
        "body": bench.body,
        "seed": bench.seed,
        "kind": kind,
        "before": born,
        "watched": taken - born,
        "noticed": alarms[0].row + 1 - born if alarms else "",
        "found": alarms[0].mending.in_words if alarms else "",
        "false_before": before,
        "surprise": float(np.nanmean(np.concatenate(life.surprise)[born : born + 1000])),
        "cpu_s": time.process_time() - began,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bodies", nargs="+", default=["sphere", "cube", "torus"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--kinds", nargs="+", default=["link", "joint", "dead", "none"])
    parser.add_argument("--touches", type=int, default=8000)
    parser.add_argument("--watched", type=int, default=12_000)
    parser.add_argument("--targets", type=int, default=300)
    parser.add_argument("--out", type=Path, default=Path("docs/data/active_lives.csv"))
    args = parser.parse_args()
    rows = kept(args.out)
    done = {(row["body"], int(row["seed"]), row["kind"]) for row in rows}
    for body in args.bodies:
        for seed in args.seeds:
            kinds = [kind for kind in args.kinds if (body, seed, kind) not in done]
            if not kinds:
                continue
            bench = Bench(body, seed, args)
            exploration, life = Exploration(bench.world([]).experiment), bench.new_life()
            while (taken := exploration.learner.num_touches) < args.touches:
                shard = explored(exploration, taken)
                life.take(shard.q, shard.sensation)
            for kind in kinds:
                row = measure(bench, kind, exploration, life, args.watched)
                rows.append({key: str(value) for key, value in row.items()})
                store(rows, args.out)
                print(row, flush=True)


if __name__ == "__main__":
    main()
