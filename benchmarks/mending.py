"""How soon an agent notices that its body changed, and how well it mends. Run it as a script.

    python benchmarks/mending.py --out docs/data/mending.csv
    python benchmarks/mending.py --bodies torus --seeds 0 1 --kinds link joint

All lives are random walks in the kinematic world. For each body and seed an agent lives `--touches`
touches. Then, for each kind of change, this life goes on with the changed body until the agent has
regained its quality and is as good as one that learned the changed body anew, or for half as many
touches. Quality is the error of the shape, the holes, and contact on 100 planned paths, in the
world as it then is, every 1000 touches. One quality is as good as another if the error is at most
1.15 times the other's, the holes are the same or right, and contact is at most two hundredths
lower; the quality of an unchanged body differs by so much. For comparison, an agent learns the
changed body anew: the table says after how many touches, out of a few numbers, it has the quality
that the other had before, and how good it is after as many touches as the other had before.

Every combination is a row of the CSV file. Rows that are already in the file are not computed
again. At the end the whole file is printed as a table, one line per kind of change.
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

from selftouch_drake.agent.lifelong import Life, OnlineLearner
from selftouch_drake.agent.lifelong.expectation import cosine_distance
from selftouch_drake.evaluation.life import planned_contact, quality
from selftouch_drake.experience import collect_walk
from selftouch_drake.experience.sources import KinematicSource
from selftouch_drake.experiment import Experiment, load_experiment
from selftouch_drake.robot import World

#: Bodies with their holes.
BODIES = {"sphere": "1 0 1", "cube": "1 0 1", "torus": "1 2 1"}
#: Touches between two looks at the quality.
LOOK = 1000
#: Shares of `--touches` after which the agent that learns anew is scored, at the next look.
LADDER = (1 / 2, 3 / 4, 1)


def changes(kind: str, patch: list[int]) -> tuple[list[dict], list[dict]]:
    """The changes that the body has from birth, and those that it has after the change."""
    skin: dict[str, dict[str, Any]] = {
        "one": {"dead": patch[:1]},
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


KINDS = ("one", "dead", "swapped", "turned", "slipped", "stretched", "new", "link", "joint")


def touches(
    world: World, first_walk: int, walk_size: int = 2 * LOOK
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """What is felt where, in half walks, without end."""
    source, walk, half = KinematicSource(world), first_walk, walk_size // 2
    while True:
        shard = collect_walk(source, world.experiment, walk, walk_size)
        for rows in (slice(half), slice(half, None)):
            yield shard.q[rows], shard.sensation[rows]
        walk += 1


def scored(life: Life | OnlineLearner, world: World, num_pairs: int) -> dict[str, Any]:
    """Error of the shape, holes, and contact on planned paths, measured in `world`."""
    learner = life.learner if isinstance(life, Life) else life
    found = quality(learner, world, num_pairs)
    holes = " ".join(map(str, found.holes))
    return {"error": found.error, "holes": holes, "contact": found.contact}


def still_true(q: np.ndarray, sensation: np.ndarray, world: World) -> tuple[float, float]:
    """Share of touches that still touch; median cosine distance to what is felt there now."""
    felt = world.probe.sensations(q)
    touching = felt.any(axis=1)
    return float(touching.mean()), float(np.median(cosine_distance(felt, sensation)[touching]))


def as_good(one: dict[str, Any], other: dict[str, Any], right: str) -> bool:
    """Whether a quality is nearly as good as another, or better; `right` are the true holes."""
    return (
        one["error"] <= 1.15 * other["error"]
        and one["holes"] in (right, other["holes"])
        and one["contact"] >= other["contact"] - 0.02
    )


def qualities(
    was: dict[str, Any],
    at_once: float,
    now: dict[str, Any],
    anew: list[dict[str, Any]],
    reached: dict[str, int],
    wanted: dict[str, Any],
    right: str,
) -> dict[str, Any]:
    """Columns of a row: how good the agent was and is, beside one that learns the body anew.

    Args:
        was: quality before the change.
        at_once: contact in the changed body before the agent mends.
        now: quality at the end.
        anew: qualities of an agent that learns anew, in order; if none, `was` takes their place.
        reached: number of touches since the change after which quality was as good as before the
            change (`touches`), and as good as that of the other agent (`touches_as_anew`).
        wanted: quality that the agent that learns anew is to reach.
        right: true holes.
    """
    last = anew[-1] if anew else was
    return {
        "error_before": was["error"],
        "error": now["error"],
        "holes_before": was["holes"],
        "holes": now["holes"],
        "contact_before": was["contact"],
        "contact_unmended": at_once,
        "contact": now["contact"],
        "touches": reached.get("touches", ""),
        "anew": next((one["touches"] for one in anew if as_good(one, wanted, right)), ""),
        "error_anew": last["error"],
        "holes_anew": last["holes"],
        "contact_anew": last["contact"],
        "touches_as_anew": reached.get("touches_as_anew", ""),
    }


class Bench:
    """The lives of one body and seed."""

    def __init__(self, body: str, seed: int, args: argparse.Namespace):
        self.body, self.seed, self.args = body, seed, args
        p_LS = World(load_experiment(body, {"seed": seed})).skins[0].fields.p_LS
        farthest = p_LS[p_LS[:, 0].argmax()]
        near = np.argsort(np.linalg.norm(p_LS - farthest, axis=1))
        self.patch = near[: len(p_LS) // 10].tolist()
        self._lives: dict[bool, tuple[Life, dict[str, Any]]] = {}

    def world(self, made: list[dict]) -> World:
        """A world whose body has these changes from birth."""
        experiment: Experiment = load_experiment(self.body, {"seed": self.seed, "changes": made})
        return World(experiment)

    def new_life(self) -> Life:
        """An agent that knows nothing."""
        num_targets = self.args.targets
        return Life(lambda: OnlineLearner(num_targets, seed=self.seed), seed=self.seed)

    def anew(self, world: World) -> list[dict[str, Any]]:
        """The quality of an agent that learns this world's body anew, at several moments."""
        learner = OnlineLearner(self.args.targets, seed=self.seed)
        walks, scores = touches(world, 500), []
        for rung in (int(share * self.args.touches) for share in LADDER):
            while learner.num_touches < rung:
                learner.take(*next(walks))
            found = scored(learner, world, self.args.pairs)
            scores.append(found | {"touches": learner.num_touches})
            print(self.body, self.seed, "anew", scores[-1], flush=True)
        return scores

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
        anew, right = self.anew(world), BODIES[self.body]
        walks, start = touches(world, 200), life.num_touches
        now: dict[str, Any] = {}
        reached: dict[str, int] = {}
        while life.num_touches - start < self.args.touches // 2 and len(reached) < 2:
            life.take(*next(walks))
            if life.has_doubts:
                continue
            now, num = scored(life, world, self.args.pairs), life.num_touches - start
            print(self.body, self.seed, kind, num, now, flush=True)
            for name, aim in (("touches", wanted), ("touches_as_anew", anew[-1])):
                if as_good(now, aim, right):
                    reached.setdefault(name, num)
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
            **qualities(was, at_once, now, anew, reached, wanted, right),
            "false": was["false"] + max(len(noticed) - 1, 0) + life.has_doubts,
            "cpu_s": time.process_time() - began,
        }


def kept(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file; none if there is no file."""
    return list(csv.DictReader(path.open())) if path.exists() else []


def store(rows: list[dict[str, str]], path: Path) -> None:
    """Writes rows that have the same columns."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def table(rows: list[dict[str, str]]) -> Iterator[str]:
    """One line per kind of change: medians of all lives, the worst, or one number for each life."""
    lives = sorted({(row["body"], row["seed"]) for row in rows})
    names = ", ".join(f"{body} {seed}" for body, seed in lives)
    yield (
        "| change | noticed: median, worst | touches that hold: at once, mended % "
        "| shape error: before, mended, anew % | contact: before, at once, mended, anew % "
        f"| regained after: {names} | anew | as good as anew after |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    for kind in (kind for kind in KINDS if any(row["kind"] == kind for row in rows)):
        found = {(row["body"], row["seed"]): row for row in rows if row["kind"] == kind}
        noticed = [float(row["noticed"] or "inf") for row in found.values()]
        shown = [kind, f"{np.median(noticed):.0f}, {max(noticed):.0f}"]
        for columns, digits in (
            (("touch_at_once", "touch"), 0),
            (("error_before", "error", "error_anew"), 1),
            (("contact_before", "contact_unmended", "contact", "contact_anew"), 0),
        ):
            medians = [np.median([float(row[name]) for row in found.values()]) for name in columns]
            shown.append(", ".join(f"{100 * median:.{digits}f}" for median in medians))
        for name in ("touches", "anew", "touches_as_anew"):
            shown.append(", ".join(found[one][name] or "no" for one in lives if one in found))
        yield f"| {' | '.join(shown)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bodies", nargs="+", default=BODIES)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=[*KINDS, "none"])
    parser.add_argument("--touches", type=int, default=15_000)
    parser.add_argument("--targets", type=int, default=300)
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--out", type=Path, default=Path("docs/data/mending.csv"))
    args = parser.parse_args()
    rows = kept(args.out)
    done = {(row["body"], int(row["seed"]), row["kind"]) for row in rows}
    for body in args.bodies:
        for seed in args.seeds:
            bench = Bench(body, seed, args)
            for kind in args.kinds:
                if (body, seed, kind) not in done:
                    rows.append({k: str(v) for k, v in bench.measure(kind).items()})
                    store(rows, args.out)
    print(*table(rows), sep="\n")


if __name__ == "__main__":
    main()
