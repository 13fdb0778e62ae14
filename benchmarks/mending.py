"""How soon an agent notices that its body changed, and how well it mends. Run it as a script.

    python benchmarks/mending.py --out docs/data/mending.csv
    python benchmarks/mending.py --bodies torus --seeds 0 1 --kinds link joint

All lives are random walks in the kinematic world. For each body and seed an agent lives `--touches`
touches. Then, for each kind of change, this life goes on with the changed body until the agent has
regained its quality, or for half as many touches. Quality is the error of the shape, the holes, and
contact on 20 planned paths, in the world as it then is. It is regained if the error is at most 1.15
times that of before, the holes are the same, and contact is at most two hundredths lower; the
quality of an unchanged body differs by so much. For comparison, an agent learns anew: the table
says after how many touches, out of a few numbers, it has the quality that the other had before.

Every combination is a row of the CSV file. Rows that are already in the file are not computed
again. At the end all rows of the file are printed as a table.
"""

from __future__ import annotations

import argparse
import copy
import csv
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from selftouch_drake.agent.living import Life, LivingLearner
from selftouch_drake.agent.living.surprise import surprise
from selftouch_drake.evaluation.life import planned_contact, quality
from selftouch_drake.experience import collect_walk
from selftouch_drake.experience.sources import KinematicSource
from selftouch_drake.experiment import Experiment, load_experiment
from selftouch_drake.robot import World

BODIES = ("sphere", "cube", "torus")
WALK = 2500
#: Shares of `--touches` at which the agent that learns anew is scored.
LADDER = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1)
#: Touches of the changed body before which no agent is scored, even if it did not notice.
UNNOTICED = 2500


def changes(kind: str, patch: list[int]) -> tuple[list[dict], list[dict]]:
    """The changes that the body has from birth, and those that it has after the change."""
    skin: dict[str, dict[str, Any]] = {
        "dead": {"dead_share": 0.1},
        "swapped": {"swapped_share": 0.1},
        "turned": {"rpy_deg": [0, 0, 10]},
        "slipped": {"translation": [0.02, 0, 0]},
        "stretched": {"stretch": 1.15},
        "new": {"new": patch},
    }
    if kind in skin:
        before = [{"skins": {"body": {"dead": patch}}}] if kind == "new" else []
        return before, [*before, {"skins": {"body": skin[kind]}}]
    whole: dict[str, dict] = {
        "link": {"links": {"forearm": 0.1}},
        "joint": {"joints": {"elbow_pitch": 0.1}},
        "none": {},
    }
    return [], [whole[kind]]


KINDS = ("dead", "swapped", "turned", "slipped", "stretched", "new", "link", "joint")


def touches(world: World, first_walk: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """What is felt where, walk by walk, without end."""
    source, walk = KinematicSource(world), first_walk
    while True:
        shard = collect_walk(source, world.experiment, walk, WALK)
        yield shard.q, shard.sensation
        walk += 1


def scored(life: Life | LivingLearner, world: World, num_pairs: int) -> dict[str, Any]:
    """Error of the shape, holes, and contact on planned paths, measured in `world`."""
    learner = life.learner if isinstance(life, Life) else life
    found = quality(learner, world, num_pairs)
    holes = " ".join(map(str, found.holes))
    return {"error": found.error, "holes": holes, "contact": found.contact}


def still_true(q: np.ndarray, sensation: np.ndarray, world: World) -> tuple[float, float]:
    """Share of touches that still touch; median cosine distance to what is felt there now."""
    felt = world.probe.sensations(q)
    touching = felt.any(axis=1)
    return float(touching.mean()), float(np.median(surprise(felt, sensation)[touching]))


def regained(now: dict[str, Any], before: dict[str, Any]) -> bool:
    """Whether quality is nearly as good as before."""
    return (
        now["error"] <= 1.15 * before["error"]
        and now["holes"] == before["holes"]
        and now["contact"] >= before["contact"] - 0.02
    )


class Bench:
    """The lives of one body and seed."""

    def __init__(self, body: str, seed: int, args: argparse.Namespace):
        self.body, self.seed, self.args = body, seed, args
        p_LS = World(load_experiment(body, {"seed": seed})).skins[0].fields.p_LS
        farthest = p_LS[p_LS[:, 0].argmax()]
        near = np.argsort(np.linalg.norm(p_LS - farthest, axis=1))
        self.patch = near[: len(p_LS) // 10].tolist()
        self._lives: dict[bool, tuple[Life, dict[str, Any]]] = {}
        self._anew: list[dict[str, Any]] | None = None

    def world(self, made: list[dict]) -> World:
        """A world whose body has these changes from birth."""
        experiment: Experiment = load_experiment(self.body, {"seed": self.seed, "changes": made})
        return World(experiment)

    def new_life(self) -> Life:
        """An agent that knows nothing."""
        num_targets = self.args.targets
        return Life(lambda: LivingLearner(num_targets, seed=self.seed), seed=self.seed)

    def anew(self, wanted: dict[str, Any]) -> int | None:
        """Number of touches after which an agent that learns anew has the wanted quality."""
        if self._anew is None:
            self._anew = []
            world = self.world([])
            learner = LivingLearner(self.args.targets, seed=self.seed)
            walks, rungs = touches(world, 500), [int(s * self.args.touches) for s in LADDER]
            for rung in rungs:
                while learner.num_touches < rung:
                    learner.take(*next(walks))
                found = scored(learner, world, self.args.pairs) | {"touches": rung}
                self._anew.append(found)
                print(self.body, self.seed, "anew", found, flush=True)
        return next((row["touches"] for row in self._anew if regained(row, wanted)), None)

    def life(self, before: list[dict]) -> tuple[Life, dict[str, Any]]:
        """A life up to the change, and its quality."""
        key = bool(before)
        if key not in self._lives:
            world, life = self.world(before), self.new_life()
            walks = touches(world, 0)
            while life.num_touches < self.args.touches:
                life.take(*next(walks))
            found = scored(life, world, self.args.pairs)
            found |= {"false": len(life.noticed) + life.has_doubts}
            print(self.body, self.seed, "before", found, flush=True)
            self._lives[key] = life, found
        life, found = self._lives[key]
        fresh = copy.deepcopy(life)
        return fresh, found

    def measure(self, kind: str) -> dict[str, Any]:
        """One row of the table."""
        before, after = changes(kind, self.patch)
        life, was = self.life(before)
        wanted = self.life([])[1] if kind == "new" else was
        world, began = self.world(after), time.process_time()
        at_once = planned_contact(life.learner, world, self.args.pairs)
        held = life.learner.remembered().columns
        some = np.random.default_rng(0).choice(len(held["q"]), 3000)
        old = held["q"][some], held["sensation"][some]
        walks, start = touches(world, 200), life.num_touches
        looked, now, most = 0, was, self.args.touches // 2
        while life.num_touches - start < most:
            life.take(*next(walks))
            settled = life.num_touches - start >= UNNOTICED and not life.has_doubts
            if settled and life.num_touches - start >= 2 * looked:
                looked = life.num_touches - start
                now = scored(life, world, self.args.pairs)
                if regained(now, wanted):
                    break
        noticed = [one for one in life.noticed if one.row >= start]
        mended = noticed[0].mending.mended(*old) if noticed else old
        (touch_at_once, off_at_once), (touch, off) = (
            still_true(*rows, world) for rows in (old, mended)
        )
        return {
            "body": self.body,
            "seed": self.seed,
            "kind": kind,
            "noticed": noticed[0].row + 1 - start if noticed else "",
            "found": noticed[0].mending.in_words if noticed else "",
            "touch_at_once": touch_at_once,
            "touch": touch,
            "off_at_once": off_at_once,
            "off": off,
            "error_before": was["error"],
            "error": now["error"],
            "holes_before": was["holes"],
            "holes": now["holes"],
            "contact_before": was["contact"],
            "contact_unmended": at_once,
            "contact": now["contact"],
            "touches": looked if regained(now, wanted) else "",
            "anew": self.anew(wanted) or "",
            "false": was["false"] + max(len(noticed) - 1, 0),
            "cpu_s": time.process_time() - began,
        }


def table(rows: list[dict[str, str]]) -> Iterator[str]:
    """The rows in columns."""
    yield (
        "| body | seed | change | noticed | touches that hold at once, mended % "
        "| error before, mended % "
        "| contact before, at once, mended % | holes | mended | anew |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|"
    for row in rows:
        error = ", ".join(f"{100 * float(row[k]):.1f}" for k in ("error_before", "error"))
        hold = ", ".join(f"{100 * float(row[k]):.0f}" for k in ("touch_at_once", "touch"))
        contact = ", ".join(
            f"{100 * float(row[k]):.1f}" for k in ("contact_before", "contact_unmended", "contact")
        )
        yield (
            f"| {row['body']} | {row['seed']} | {row['kind']} | {row['noticed'] or 'no'} | {hold} "
            f"| {error} | {contact} | {row['holes']} | {row['touches'] or 'no'} "
            f"| {row['anew'] or 'no'} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bodies", nargs="+", default=BODIES)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=[*KINDS, "none"])
    parser.add_argument("--touches", type=int, default=15_000)
    parser.add_argument("--targets", type=int, default=200)
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--out", type=Path, default=Path("docs/data/mending.csv"))
    args = parser.parse_args()
    rows = list(csv.DictReader(args.out.open())) if args.out.exists() else []
    done = {(row["body"], int(row["seed"]), row["kind"]) for row in rows}
    for body in args.bodies:
        for seed in args.seeds:
            bench = Bench(body, seed, args)
            for kind in args.kinds:
                if (body, seed, kind) not in done:
                    rows.append({k: str(v) for k, v in bench.measure(kind).items()})
                    with args.out.open("w", newline="") as file:
                        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
                        writer.writeheader()
                        writer.writerows(rows)
    print(*table(rows), sep="\n")


if __name__ == "__main__":
    main()
