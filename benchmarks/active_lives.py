"""How soon an active agent notices that its body changed, and how well it mends. Run as a script.

    python benchmarks/active_lives.py --bodies torus cube --seeds 6 7

All lives are in the kinematic world, with `babbling.strategy: active`: the agent explores by what
it knows, also by what it mended. For each body and seed an agent lives `--touches` touches. Then,
for each kind of change, this life goes on with the changed body until the agent has regained its
quality and is as good as one that learned the changed body anew, also by active exploration, or for
`--watched` touches. Quality is what it is in `mending.py`, measured every 1000 touches. `none` is a
body that does not change, and goes on for `--watched` touches; then each alarm is false.

Every life is a row of the CSV file. Rows that are already in the file are not computed again.
"""

from __future__ import annotations

import argparse
import copy
import time
from pathlib import Path
from typing import Any

import numpy as np
from mending import (
    BODIES,
    LADDER,
    LOOK,
    Bench,
    as_good,
    changes,
    kept,
    qualities,
    scored,
    store,
)

from selftouch_drake.agent.lifelong import Life, OnlineLearner
from selftouch_drake.evaluation.life import planned_contact
from selftouch_drake.experiment import load_experiment
from selftouch_drake.exploration import Exploration
from selftouch_drake.robot import World

#: Fewest and most touches in each round of exploration; in between, a tenth of those before.
ROUND = 250, 1000


def born(bench: Bench, world: World) -> Exploration:
    """An agent that knows nothing, and watches its body as if that might change."""
    settings = {
        "seed": bench.seed,
        "representation": {"num_targets": bench.args.targets},
        "changes": [{"after": 10 * bench.args.touches}],
    }
    return Exploration(load_experiment(bench.body, settings), world=world)


def explore(exploration: Exploration, until: int) -> None:
    """Makes rounds until the agent has so many touches."""
    while (taken := exploration.num_touches) < until:
        shard = exploration.explore(min(int(np.clip(taken // 10, *ROUND)), until - taken))
        exploration.remember(shard.q, shard.sensation)


def life_of(exploration: Exploration) -> Life:
    """The life of an agent that watches its body."""
    assert isinstance(exploration.mind, Life)
    return exploration.mind


def in_another_body(exploration: Exploration, world: World) -> Exploration:
    """The same agent in another world; the first one stays as it is."""
    other = copy.copy(exploration)
    other.mind = copy.deepcopy(exploration.mind)
    other.enter(world)
    return other


def anew(bench: Bench, world: World) -> list[dict[str, Any]]:
    """The quality of an active agent that learns this world's body anew, at several moments."""
    exploration, scores = born(bench, world), []
    exploration.mind = OnlineLearner(bench.args.targets, seed=bench.seed)
    for rung in (int(share * bench.args.touches) for share in LADDER):
        explore(exploration, rung)
        scores.append(scored(exploration.learner, world, bench.args.pairs) | {"touches": rung})
        print(bench.body, bench.seed, "anew", scores[-1], flush=True)
    return scores


def measure(
    bench: Bench, kind: str, exploration: Exploration, was: dict[str, Any], watched: int
) -> dict[str, Any]:
    """One row: the life goes on in a body that changed, or did not."""
    world, right = bench.world(changes(kind, bench.patch)[1]), BODIES[bench.body]
    exploration = in_another_body(exploration, world)
    life, num_before = life_of(exploration), len(life_of(exploration).noticed)
    began, start = time.process_time(), exploration.num_touches
    at_once = planned_contact(life.learner, world, bench.args.pairs)
    reached: dict[str, int] = {}
    now, others, taken = was, [] if kind == "none" else anew(bench, world), 0
    new = others[-1] if others else was
    while taken < watched and (kind == "none" or len(reached) < 2):
        taken += LOOK
        explore(exploration, start + taken)
        if kind == "none" or life.has_doubts:
            continue
        now = scored(life, world, bench.args.pairs)
        print(bench.body, bench.seed, kind, taken, now, flush=True)
        for name, aim in (("touches", was), ("touches_as_anew", new)):
            if as_good(now, aim, right):
                reached.setdefault(name, taken)
    alarms = life.noticed[num_before:]
    return {
        "body": bench.body,
        "seed": bench.seed,
        "kind": kind,
        "before": start,
        "watched": taken,
        "noticed": alarms[0].row + 1 - start if alarms else "",
        "found": alarms[0].mending.in_words if alarms else "",
        "false_before": num_before,
        "alarms": len(alarms) + life.has_doubts,
        "surprise": float(np.nanmean(np.concatenate(life.surprise)[start : start + 1000])),
        **qualities(was, at_once, now, others, reached, was, right),
        "cpu_s": time.process_time() - began,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bodies", nargs="+", default=["sphere", "cube", "torus"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--kinds", nargs="+", default=["link", "joint", "dead", "none"])
    parser.add_argument("--touches", type=int, default=15_000)
    parser.add_argument("--watched", type=int, default=6000)
    parser.add_argument("--targets", type=int, default=300)
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--out", type=Path, default=Path("docs/data/active_lives.csv"))
    args = parser.parse_args()
    rows = kept(args.out)
    done = {(row["body"], int(row["seed"]), row["kind"], int(row["before"])) for row in rows}
    for body in args.bodies:
        for seed in args.seeds:
            kinds = [kind for kind in args.kinds if (body, seed, kind, args.touches) not in done]
            if not kinds:
                continue
            bench = Bench(body, seed, args)
            world = bench.world([])
            exploration = born(bench, world)
            explore(exploration, args.touches)
            was = scored(life_of(exploration), world, args.pairs)
            print(body, seed, "before", was, flush=True)
            for kind in kinds:
                row = measure(bench, kind, exploration, was, args.watched)
                rows.append({key: str(value) for key, value in row.items()})
                store(rows, args.out)
                print(row, flush=True)


if __name__ == "__main__":
    main()
