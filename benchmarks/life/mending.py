"""How soon an agent notices that its body changed, and how well it mends. Run it as a script.

    python benchmarks/life/mending.py --bodies sphere torus cube --seeds 6
    python benchmarks/life/mending.py --lives active --kinds link joint dead --seeds 6 7
    python benchmarks/life/mending.py --lives dynamic --bodies torus cube \\
        --kinds link joint dead swapped --seeds 31
    python benchmarks/life/mending.py --lives unchanged --seeds 6 --targets 200
    python benchmarks/life/mending.py --lives unchanged --stored runs/cube-6 runs/torus-6

Lives are in the kinematic world, or (`dynamic`) under dynamics, where the body travels. For each
body and seed an agent lives `--touches` touches of random walks, or (`active`, `dynamic`) of its
own exploration, by what it knows. Under dynamics the body is felt 50 times a second; a touch is one
of five that follow each other. Then, for each kind of change, this life goes on with the changed
body until the agent has explained the change and regained its quality, or for `--watched` touches.
Quality is the error of the shape, the holes, and contact on `--pairs` planned paths before
practice, in the world as it then is: at once, as soon as the change is explained, and every 1000
touches. One quality is as good as another if the error is at most 1.15 times the other's, the holes
are the same or right, and contact is at most two hundredths lower; the quality of an unchanged body
differs by so much. It is regained after 0 touches if the change cost nothing. An explanation is
right if it names what changed and nothing else; of receptors, at least half of those that changed,
and no other. Explanations that were withdrawn since are counted.

With `--anew` another agent learns the changed body from nothing, in the same way, and the life goes
on until it is as good as that one, too.

`unchanged` lives 100,000 touches of a body that does not change, or `--stored` ones of a run: a row
holds the number of alarms, which are false, and the greatest evidence of a change as a share of
what raises an alarm: by surprise or by misplaced touches, silent receptors, new receptors.

Every life is a row of a CSV file.
"""

from __future__ import annotations

import argparse
import copy
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from selftouch_drake.agent.body_model.chain_change import Change
from selftouch_drake.agent.lifelong.body_change import BodyChange
from selftouch_drake.agent.lifelong.expectation import NUM_STEPS, TouchSet, cosine_distance
from selftouch_drake.agent.lifelong.learner import OnlineLearner
from selftouch_drake.agent.lifelong.life import Life
from selftouch_drake.bodies.drake import DrakeBodies
from selftouch_drake.evaluation.life import quality
from selftouch_drake.experience.collect import collect_walk
from selftouch_drake.experience.exploration import Exploration, new_life
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World
from selftouch_drake.robot.imperfections import ImperfectSkin
from selftouch_drake.run.directory import RunDirectory

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.results import results

#: Bodies with their holes.
BODIES = {"sphere": "1 0 1", "cube": "1 0 1", "torus": "1 2 1"}
#: Touches between two looks at the quality, and those after which an explanation is noticed.
LOOK, STEP = 1000, 50
#: Shares of `--touches` after which the agent that learns anew is scored.
LADDER = (1 / 2, 3 / 4, 1)
#: Fewest and most touches in each round of exploration; in between, a tenth of those before.
ROUND = 250, 1000
#: Name of the table of each kind of lives.
TABLES = {
    "random": "mending",
    "active": "active_lives",
    "dynamic": "mending_dynamic",
    "unchanged": "false_alarms",
}
KINDS = ("one", "dead", "swapped", "turned", "slipped", "stretched", "new", "link", "joint")
#: What a change of joints and skin is to be called.
RIGHT = {
    "turned": Change.TURNED_SKIN,
    "slipped": Change.SKIN,
    "stretched": Change.STRETCHED_SKIN,
    "link": Change.LINK,
    "joint": Change.ZERO,
}


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
    }
    return [], [whole[kind]]


def rewiring(world: World) -> tuple[np.ndarray, np.ndarray]:
    """`(S,)` the receptor that each reading of the first skin comes from, and whether it lives."""
    skin = ImperfectSkin.of(world.experiment, 0, world.skins[0])
    number = world.skins[0].fields.num_receptors
    if skin is None:
        return np.arange(number), np.ones(number, dtype=bool)
    return skin.source, skin.alive


def rightly_named(kind: str, change: BodyChange, before: World, after: World) -> bool:
    """Whether a change is explained by what changed, and by nothing else."""
    source, silent, new = change.source, change.silent, change.new.receptors
    swapped = source != np.arange(len(source))
    if change.displacement or change.offset.any():
        return False
    parts = [] if change.chain is None else list(change.chain.parts)
    if kind in RIGHT:
        if swapped.any() or silent.any() or new.any() or len(parts) != 1:
            return False
        assert change.chain is not None
        first = change.chain.before.joints[0]
        # A turn of the skin about the first joint's axis is that joint's: touch tells no more.
        turns = kind == "turned" and parts[0].kind == Change.ZERO and parts[0].joint == first
        joint = after.robot.joint_names[parts[0].joint] if parts[0].kind == Change.ZERO else ""
        wrong_joint = kind == "joint" and joint != "elbow_pitch"
        return (parts[0].kind == RIGHT[kind] and not wrong_joint) or turns
    (was, lived), (now, lives) = rewiring(before), rewiring(after)
    truth = {
        "swapped": was != now,
        "silent": lived & ~lives & (was == now),
        "new": ~lived & lives,
    }
    said = {"swapped": swapped, "silent": silent, "new": new}
    names = all(
        not (said[what] & ~truth[what]).any() and 2 * said[what].sum() >= truth[what].sum()
        for what in truth
    )
    return names and not parts


class Walks:
    """An agent that lives, or learns only, from random walks in a world."""

    step = STEP

    def __init__(self, mind: Life | OnlineLearner, world: World, first_walk: int):
        self.mind = mind
        self.enter(world, first_walk)

    def enter(self, world: World, first_walk: int) -> None:
        """From now on, touches are those of this world."""
        self._touches = self._halves(world, first_walk)

    def _halves(self, world: World, walk: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        source = DrakeBodies(world).babbling
        while True:
            shard = collect_walk(source, world.experiment, walk, 2 * LOOK)
            for start in range(0, 2 * LOOK, STEP):
                rows = slice(start, start + STEP)
                yield shard.q[rows], shard.sensation[rows]
            walk += 1

    def live(self, until: int) -> None:
        """Takes touches until there are so many."""
        while self.mind.num_touches < until:
            self.mind.take(*next(self._touches))

    def in_another_body(self, world: World) -> Walks:
        """The same agent in another world; this one stays as it is."""
        return Walks(copy.deepcopy(self.mind), world, 200)


class Explores:
    """An agent that explores a world, by what it knows."""

    step = LOOK

    def __init__(self, exploration: Exploration, every: int):
        self._exploration, self._every = exploration, every

    @property
    def mind(self) -> Life | OnlineLearner:
        """What takes the touches."""
        return self._exploration.mind

    def live(self, until: int) -> None:
        """Makes rounds until there are so many touches; each stands for `every`."""
        until *= self._every
        while (taken := self._exploration.num_touches) < until:
            shard = self._exploration.explore(min(int(np.clip(taken // 10, *ROUND)), until - taken))
            self._exploration.remember(shard.q, shard.sensation)

    def in_another_body(self, world: World) -> Explores:
        """The same agent in another world; this one stays as it is."""
        other = copy.copy(self._exploration)
        other.mind = copy.deepcopy(self._exploration.mind)
        other.enter(DrakeBodies(world).babbling)
        return Explores(other, self._every)


def life_of(agent: Walks | Explores) -> Life:
    """The life of an agent that watches its body."""
    assert isinstance(agent.mind, Life)
    return agent.mind


def scored(mind: Life | OnlineLearner, world: World, num_pairs: int) -> dict[str, Any]:
    """Error of the shape, holes, and contact on planned paths, measured in `world`."""
    found = quality(mind.learner if isinstance(mind, Life) else mind, world, num_pairs)
    topology = found.body.parts[0].topology
    holes = " ".join(map(str, () if topology is None else topology.betti))
    return {"error": found.error, "holes": holes, "contact": found.contact}


def as_good(one: dict[str, Any], other: dict[str, Any], right: str) -> bool:
    """Whether a quality is nearly as good as another, or better; `right` are the true holes."""
    return (
        one["error"] <= 1.15 * other["error"]
        and one["holes"] in (right, other["holes"])
        and one["contact"] >= other["contact"] - 0.02
    )


def still_true(touches: TouchSet, world: World) -> tuple[float, float]:
    """Share of touches that still touch; median cosine distance to what is felt there now."""
    felt = world.probe.sensations(touches.q)
    touching = felt.any(axis=1)
    off = cosine_distance(felt, touches.sensation)[touching]
    return float(touching.mean()), float(np.median(off))


class Bench:
    """The lives of one body and seed."""

    def __init__(self, body: str, seed: int, args: argparse.Namespace):
        self.body, self.seed, self.args = body, seed, args
        p_LS = self.world([]).skins[0].fields.p_LS
        farthest = p_LS[p_LS[:, 0].argmax()]
        near = np.argsort(np.linalg.norm(p_LS - farthest, axis=1))
        self.patch = near[: len(p_LS) // 10].tolist()
        self._lives: dict[bool, tuple[Walks | Explores, dict[str, Any]]] = {}
        self._first: list[dict[str, Any]] = []

    def world(self, made: list[dict]) -> World:
        """A world whose body has these changes from birth."""
        settings: dict[str, Any] = {"seed": self.seed, "changes": made}
        if self.args.lives == "dynamic":
            settings["babbling"] = {"mode": "dynamic", "jumps": False}
        return World(load_experiment(self.body, settings))

    def born(self, world: World, first_walk: int, *, lives: bool = True) -> Walks | Explores:
        """An agent that knows nothing, and watches its body if it lives."""

        def learner() -> OnlineLearner:
            return OnlineLearner(self.args.targets, seed=self.seed)

        world_of_all = self.world([])
        every = new_life(world_of_all.experiment).every
        steps = self.args.steps
        mind = Life(learner, seed=self.seed, num_steps=steps, every=every) if lives else learner()
        if self.args.lives not in ("active", "dynamic"):
            return Walks(mind, world, first_walk)
        exploration = Exploration(world_of_all.experiment, DrakeBodies(world).babbling)
        exploration.mind = mind
        return Explores(exploration, every)

    def anew(self, world: World) -> list[dict[str, Any]]:
        """The quality of an agent that learns this world's body anew, at several moments."""
        if not self.args.anew:
            return []
        if self.args.lives == "dynamic":
            return self._first
        return self._grows(self.born(world, 500, lives=False), world, "anew")

    def _grows(self, agent: Walks | Explores, world: World, what: str) -> list[dict[str, Any]]:
        """The quality of an agent at several moments of its youth."""
        scores = []
        for rung in (int(share * self.args.touches) for share in LADDER):
            agent.live(rung)
            found = scored(agent.mind, world, self.args.pairs)
            scores.append(found | {"touches": agent.mind.num_touches})
            print(self.body, self.seed, what, scores[-1], flush=True)
        return scores

    def life(self, before: list[dict]) -> tuple[Walks | Explores, dict[str, Any]]:
        """A life up to the change, and its quality."""
        if bool(before) not in self._lives:
            world = self.world(before)
            agent = self.born(world, 0)
            if self.args.lives == "dynamic" and self.args.anew:
                self._first = self._grows(agent, world, "first life")
            agent.live(self.args.touches)
            life = life_of(agent)
            found = scored(life, world, self.args.pairs)
            found |= {"false": len(life.noticed) + life.has_doubts}
            print(self.body, self.seed, "before", found, flush=True)
            self._lives[bool(before)] = agent, found
        return self._lives[bool(before)]

    def changed(self, kind: str) -> dict[str, Any]:
        """One row: a life goes on in a body that changed."""
        before, after = changes(kind, self.patch)
        world, began = self.world(after), time.process_time()
        agent, was = self.life(before)
        wanted, right = self.life([])[1] if kind == "new" else was, BODIES[self.body]
        agent = agent.in_another_body(world)
        life, held = life_of(agent), life_of(agent).learner.remembered().columns
        some = np.random.default_rng(0).choice(len(held["q"]), 3000)
        old = TouchSet(held["q"], held["sensation"])[some]
        anew = self.anew(world)
        aims = {"touches": wanted} | ({"touches_as_anew": anew[-1]} if anew else {})
        start, explained = life.num_touches, len(life.noticed)
        now = at_once = scored(life, world, self.args.pairs)
        reached = {name: 0 for name, aim in aims.items() if as_good(now, aim, right)}
        while (num := life.num_touches - start) < self.args.watched and not (
            len(life.noticed) > explained and len(reached) == len(aims)
        ):
            before_step = len(life.noticed)
            agent.live(start + num + agent.step)
            num = life.num_touches - start
            fresh = len(life.noticed) > before_step
            if life.has_doubts or not (fresh or num % LOOK == 0):
                continue
            now = scored(life, world, self.args.pairs)
            print(self.body, self.seed, kind, num, now, flush=True)
            for name, aim in aims.items():
                if as_good(now, aim, right):
                    reached.setdefault(name, num)
                else:
                    reached.pop(name, None)
        noticed = [one for one in life.noticed if one.row >= start]
        adapted = noticed[0].change.adapted(old) if noticed else old
        (touch_at_once, off_at_once), (touch, off) = (
            still_true(rows, world) for rows in (old, adapted)
        )
        return {
            "body": self.body,
            "seed": self.seed,
            "kind": kind,
            "before": self.args.touches,
            "noticed": noticed[0].row + 1 - start if noticed else "",
            "explained": noticed[0].explained_at - start if noticed else "",
            "named": bool(
                noticed and rightly_named(kind, noticed[0].change, self.world(before), world)
            ),
            "found": noticed[0].change.in_words if noticed else "",
            "withdrawn": len(noticed[0].withdrawn) if noticed else 0,
            "touch_at_once": touch_at_once,
            "touch": touch,
            "off_at_once": off_at_once,
            "off": off,
            "error_before": was["error"],
            "error_at_once": at_once["error"],
            "error": now["error"],
            "holes_before": was["holes"],
            "holes": now["holes"],
            "contact_before": was["contact"],
            "contact_unmended": at_once["contact"],
            "contact": now["contact"],
            "touches": reached.get("touches", ""),
            "anew": next((one["touches"] for one in anew if as_good(one, wanted, right)), ""),
            "error_anew": anew[-1]["error"] if anew else "",
            "holes_anew": anew[-1]["holes"] if anew else "",
            "contact_anew": anew[-1]["contact"] if anew else "",
            "touches_as_anew": reached.get("touches_as_anew", ""),
            "false": was["false"] + max(len(noticed) - 1, 0) + life.has_doubts,
            "cpu_s": time.process_time() - began,
        }

    def unchanged(self) -> dict[str, Any]:
        """One row: a life in a body that does not change."""
        began, agent = time.process_time(), self.born(self.world([]), 0)
        agent.live(self.args.touches)
        return false_alarms(life_of(agent), self.body, self.seed, began)


def stored(run: Path, args: argparse.Namespace) -> dict[str, Any]:
    """One row: a life through the touches of a run, whose body does not change."""
    began, body = time.process_time(), run.name.rsplit("-", 1)[0]
    seed = RunDirectory.open(run).experiment.seed
    life = Life(partial(OnlineLearner, args.targets, seed=seed), seed=seed, num_steps=args.steps)
    for sensation, q in ExperienceReader(run / "experience").touches():
        life.take(q, sensation)
        if life.num_touches >= args.touches:
            break
    return false_alarms(life, body, seed, began)


def false_alarms(life: Life, body: str, seed: int, began: float) -> dict[str, Any]:
    """The row of a life in a body that did not change."""
    surprise, silenced, newcomers = np.max(life.doubts, axis=0) if life.doubts else [0.0] * 3
    return {
        "body": body,
        "seed": seed,
        "touches": life.num_touches,
        "alarms": len(life.noticed) + life.has_doubts,
        "surprise": surprise,
        "silenced": silenced,
        "newcomers": newcomers,
        "cpu_s": time.process_time() - began,
    }


def table(rows: list[dict[str, Any]]) -> Iterator[str]:
    """One line per kind of change: medians of all lives, the worst, or one number for each life."""
    lives = sorted({(row["body"], row["seed"]) for row in rows})
    names = ", ".join(f"{body} {seed}" for body, seed in lives)
    yield (
        "| change | noticed: median, worst | explained | named | touches that hold: at once, "
        "mended % | shape error: before, at once, mended % | contact: before, at once, mended % "
        f"| regained after: {names} | anew |"
    )
    yield "|---|---|---|---|---|---|---|---|---|"
    for kind in (kind for kind in KINDS if any(row["kind"] == kind for row in rows)):
        found = {(row["body"], row["seed"]): row for row in rows if row["kind"] == kind}
        shown = [kind]
        for name in ("noticed", "explained"):
            when = [number_of(row[name]) for row in found.values()]
            shown.append(f"{np.median(when):.0f}, {max(when):.0f}")
        shown.append(f"{sum(row['named'] for row in found.values())} of {len(found)}")
        for columns, digits in (
            (("touch_at_once", "touch"), 0),
            (("error_before", "error_at_once", "error"), 1),
            (("contact_before", "contact_unmended", "contact"), 0),
        ):
            medians = [np.median([row[name] for row in found.values()]) for name in columns]
            shown.append(", ".join(f"{100 * median:.{digits}f}" for median in medians))
        for name in ("touches", "anew"):
            some = [found[one][name] for one in lives if one in found]
            shown.append(", ".join("no" if one == "" else str(one) for one in some))
        yield f"| {' | '.join(shown)} |"
    noticed = [number_of(row["noticed"]) for row in rows]
    regained = [number_of(row["touches"]) for row in rows]
    yield (
        f"of {len(rows)} changes {int(np.isfinite(noticed).sum())} noticed, "
        f"{sum(row['named'] for row in rows)} named right, regained after "
        f"{np.median(regained):.0f} touches in the median; {sum(row['false'] for row in rows)} "
        "false alarms, "
        f"{sum(row['withdrawn'] for row in rows)} explanations withdrawn"
    )


def number_of(touches: Any) -> float:
    """A number of touches of a row; infinite if it never came to that."""
    return float("inf") if touches == "" else float(touches)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lives", choices=TABLES, default="random")
    parser.add_argument("--bodies", nargs="+", choices=BODIES, default=list(BODIES))
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--touches", type=int, help="15,000, or 100,000 of an unchanged body")
    parser.add_argument("--watched", type=int, default=7500, help="most touches since a change")
    parser.add_argument("--targets", type=int, default=300)
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--steps", type=int, default=NUM_STEPS, help="training of expectations")
    parser.add_argument("--anew", action="store_true", help="another agent learns the changed body")
    parser.add_argument("--stored", nargs="*", type=Path, help="with unchanged: runs with touches")
    parser.add_argument("--table", help="name of the table, if not that of --lives")
    parser.add_argument("--update", action="store_true", help="replace the shipped table")
    args = parser.parse_args()
    unchanged = args.lives == "unchanged"
    args.touches = args.touches or (100_000 if unchanged else 15_000)
    rows: list[dict[str, Any]] = []
    with results(args.table or TABLES[args.lives], update=args.update) as add:
        for row in lived(args):
            rows.append(row)
            add(row)
    print(*(rows if unchanged else table(rows)), sep="\n")


def lived(args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """A row for each life, or for each change of one."""
    if args.stored:
        for run in args.stored:
            yield stored(run, args)
        return
    for body in args.bodies:
        for seed in args.seeds:
            bench = Bench(body, seed, args)
            if args.lives == "unchanged":
                yield bench.unchanged()
                continue
            for kind in args.kinds:
                yield bench.changed(kind)


if __name__ == "__main__":
    main()
