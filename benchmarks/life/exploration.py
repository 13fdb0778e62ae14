"""Compares active babbling with random and goal babbling, and the online with the offline learner.

    python benchmarks/life/exploration.py touches --bodies torus cube sphere --seeds 1 2 3
    python benchmarks/life/exploration.py clock --bodies cube torus --seeds 1 --until 60
    python benchmarks/life/exploration.py infant --metrics --until 300000
    python benchmarks/life/exploration.py learning runs/torus runs/cube

`--until` ends a life: `touches` babbles in the kinematic world until that many touches, `clock`
under dynamics until that many simulated minutes, `infant` until that many touches of the infant.
Each life is scored along the way:

- error of the shape by each metric, holes, and share of planned paths between 60 random pairs that
  is in contact (kinematic, straight from the planner: nothing is practised);
- with `--executed`, contact of so many random pairs under dynamics, mean and worst: first tries as
  `selftouch evaluate` makes them, without rehearsal;
- share of the samples in contact, receptors that felt something, parts of the body that were
  touched (BabyBench's score of self-touch), and CPU seconds of the agent and its world.

Without metrics, only the second group is scored.

`learning` compares an online learner with an offline one, on the same touches, at ten moments of
the stored experience of runs.

There are four ways to babble. The two with goals choose them in the space of sensations (after
Baranes and Oudeyer 2013; Moulin-Frier, Rouanet and Oudeyer 2014), on our interface, not with their
code:

- `random`: as `babbling.strategy: random`;
- `active`: as `babbling.strategy: active`;
- `goals`: a target sensation drawn at random; the agent goes to the posture that felt most like it,
  with noise;
- `progress`: as `goals`, but a target is drawn more often if its competence changed lately.

The rows of each are a table of its own, `exploration_WHAT.csv`, from which `make pictures` draws
the figure.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.lifelong.explorer import ContactExplorer, Moves
from selftouch_drake.agent.lifelong.learner import OnlineLearner
from selftouch_drake.agent.representation.estimator import QuotientLearner
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.shape.recovery import recover
from selftouch_drake.bodies.drake import DrakeBodies
from selftouch_drake.bodies.embodiment import make_bodies, pilot_in
from selftouch_drake.evaluation.motion import random_pairs
from selftouch_drake.evaluation.shape import kernel_truth, shape_errors
from selftouch_drake.experience.collect import collect_walk
from selftouch_drake.experience.exploration import Exploration
from selftouch_drake.experience.store import Contacts, ExperienceReader, Shard
from selftouch_drake.experiment import Experiment, load_experiment
from selftouch_drake.robot import World
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.trials import FirstTries
from selftouch_drake.show.style import BLUE, GREEN, INK, ORANGE, PINK, VERMILION, styled

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.results import results

#: Numbers of touches, and simulated minutes, at which a life is scored.
TOUCHES = (5000, 10_000, 20_000, 100_000)
INFANT = (1000, 2000, 3000, 5000, 10_000, 20_000, 30_000, 50_000, 100_000, 300_000)
MINUTES = (5, 10, 20, 30, 45, 60, 120, 180, 300)
MOMENTS = (1000, 2000, 3000, 5000, 8000, 12_000, 20_000, 35_000, 60_000, 100_000)
#: s between two samples of a robot that babbles under dynamics.
SAMPLE_S = 0.02

#: Noise of goal babbling, in strides; number of last tries over which competence is measured; and
#: chance that a goal is drawn at random all the same.
_NOISE, _RECENT, _AT_RANDOM = 1.0, 8, 0.2


class Goals(ContactExplorer):
    """Random goal babbling: a goal, the posture that is best for it so far, and noise."""

    #: By the number of a target, the cosine between it and what was felt, at each try.
    competence: dict[int, list[float]]

    def moves(self) -> Moves:
        self.competence = {}
        while True:
            if self.agent is None:
                yield from self._wander()
                continue
            known = self.agent.representation
            goal = self.choose(known)
            members = known.members(goal)
            best = members.start + int(known.kernel_error[members].argmin())
            noise = self.rng.standard_normal(len(self.q)) * _NOISE * self.stride
            wanted = (known.kernel_q[best] + noise).clip(self.lower, self.upper)
            yield from self._straight(wanted)
            alike = float(self.felt @ known.target_sensations[goal])
            norm = float(np.linalg.norm(self.felt))
            self.competence.setdefault(goal, []).append(alike / norm if norm else 0.0)

    def choose(self, known: QuotientRepresentation) -> int:
        return int(self.rng.integers(known.num_targets))


class Progress(Goals):
    """Goals by learning progress: where the last tries went better, or worse, than those before."""

    def choose(self, known: QuotientRepresentation) -> int:
        if self.rng.random() < _AT_RANDOM:
            return super().choose(known)
        interest = np.ones(known.num_targets)
        for goal, tries in self.competence.items():
            before, after = np.array_split(np.array(tries[-_RECENT:]), 2)
            if len(after):
                interest[goal] = 0.01 + abs(after.mean() - before.mean())
        return int(self.rng.choice(len(interest), p=interest / interest.sum()))


WAYS = {"active": None, "goals": Goals, "progress": Progress}


def babbled(experiment: Experiment, way: str, ends: Sequence[int] = ()) -> Iterator[Shard]:
    """Rounds without end; one ends at each number of touches in `ends`."""
    body = make_bodies(experiment).babbling
    life = None if way == "random" else Exploration(experiment, body, WAYS[way])
    done, number = 0, 0
    while True:
        size = max(250, min(done // 10, 2000))
        size = min([size, *(end - done for end in ends if end > done)])
        if life is not None:
            shard = life.explore(size)
            life.remember(shard.q, shard.sensation)
        else:
            shard = collect_walk(body, experiment, number, size)
        done, number = done + size, number + 1
        yield shard


@dataclass(slots=True, kw_only=True, eq=False)
class Score:
    """Scores what was collected against the truth."""

    world: World
    num_targets: int
    num_executed: int

    def __call__(self, shards: list[Shard], metrics: list[str]) -> dict[str, Any]:
        q = np.concatenate([shard.q for shard in shards])
        sensation = np.concatenate([shard.sensation for shard in shards])
        contacts = Contacts.joined([shard.contacts for shard in shards if shard.contacts])
        felt = sensation.any(axis=0)
        found: dict[str, Any] = {
            "share": round(len(q) / sum(shard.num_steps for shard in shards), 3),
            "last_share": round(len(shards[-1].q) / shards[-1].num_steps, 3),
            "receptors_felt": int(felt.sum()),
            "skins_touched": len(np.unique(contacts.skin)),
            "pairs_touched": len(np.unique(contacts.skin.astype(int) * 100 + contacts.toucher)),
        }
        learner = QuotientLearner(min(self.num_targets, len(q) // 4))
        try:
            representation = learner.fit(sensation, q).representation_
        except ValueError:
            return found  # too few distinct sensations
        found["parts"] = representation.num_parts
        if not metrics:
            return found
        found |= scores(representation, contacts, self.world, metrics)
        return found | executed(representation, self.world, self.num_executed)


def executed(
    representation: QuotientRepresentation, world: World, num_pairs: int
) -> dict[str, float]:
    """Contact under dynamics, mean and worst, of first tries between random pairs."""
    pairs = random_pairs(world.experiment, representation)[:num_pairs]
    if not pairs:
        return {}
    bodies = DrakeBodies(world)
    pilot = pilot_in(bodies, Agent.of(representation), world.experiment)
    tries = FirstTries(pilot, bodies)
    made = (tries.first(*pair) for pair in pairs)
    kept = [0.0 if one is None else one[0].executed.contact for one in made]
    return {"executed": round(float(np.mean(kept)), 4), "executed_worst": round(min(kept), 4)}


def scores(
    representation: QuotientRepresentation, contacts: Contacts, world: World, metrics: list[str]
) -> dict[str, Any]:
    """Error and holes by each metric, and share of planned paths that is in contact."""
    truth = kernel_truth(representation, contacts[representation.kernel_row], world.receptor_skin)
    found: dict[str, Any] = {}
    for metric in metrics:
        body = recover(representation, metric)
        errors = shape_errors(body.positions, representation.part, truth)
        betti = [part.topology.betti if part.topology else () for part in body.parts]
        found[f"error_{metric}"] = round(max(errors.values(), default=np.nan), 4)
        found[f"betti_{metric}"] = ", ".join(" ".join(map(str, one)) for one in betti)
    agent, rng, kept = Agent.of(representation), np.random.default_rng(0), []
    large = np.flatnonzero(representation.part == 0)
    for _ in range(60):
        start, goal = rng.choice(large, 2, replace=False)
        plan = agent.plan(int(start), int(goal))
        q = plan.path(np.linspace(0.0, plan.waypoint_s[-1], 200))
        kept.append(world.probe.sensations(q).any(axis=1).mean())
    return found | {"contact": round(float(np.mean(kept)), 4)}


def lives(what: str, body: str, seed: int, way: str, arguments: argparse.Namespace) -> Iterator:
    """The rows of one life."""
    mode = "dynamic" if what == "clock" else "kinematic"
    experiment = load_experiment(body, {"seed": seed, "babbling": {"mode": mode}})
    score = Score(
        world=World(experiment), num_targets=arguments.targets, num_executed=arguments.executed
    )
    all_marks = arguments.at or {"clock": MINUTES, "infant": INFANT}.get(what, TOUCHES)
    marks = [mark for mark in all_marks if mark <= arguments.until]
    shards, began, scoring = list[Shard](), time.process_time(), 0.0
    ends = () if what == "clock" else marks
    for shard in babbled(experiment, way, ends):
        shards.append(shard)
        touches = sum(len(one.q) for one in shards)
        minutes = sum(one.num_steps for one in shards) * SAMPLE_S / 60
        at = minutes if what == "clock" else touches
        if at < marks[0]:
            continue
        marks = [mark for mark in marks if mark > at]
        here = time.process_time()
        row = {"what": what, "body": body, "seed": seed, "way": way, "touches": touches}
        row |= {"minutes": round(minutes, 2) if what == "clock" else None}
        row |= {"cpu_s": round(here - began - scoring, 1)} | score(
            shards, arguments.metrics if arguments.at or not marks else arguments.metrics[:1]
        )
        scoring += time.process_time() - here
        yield row
        if not marks:
            return


def learning(path: Path, metrics: list[str], num_targets: int) -> Iterator[dict[str, Any]]:
    """Scores an online learner and an offline one at ten moments."""
    run = RunDirectory.open(path)
    reader = ExperienceReader(run.experience)
    q, sensation = reader.read("q"), reader.read("sensation")
    contacts = Contacts.joined(list(ExperienceReader(run.truth).contacts()))
    world, learner = World(run.experiment), OnlineLearner(num_targets)
    taken, cpu_s = 0, 0.0
    for moment in (moment for moment in MOMENTS if moment <= len(q)):
        began = time.process_time()
        while taken < moment:
            rows = slice(taken, min(taken + 500, moment))
            learner.take(q[rows], sensation[rows])
            taken = rows.stop
        known = {"online": learner.representation}
        cpu_s += time.process_time() - began
        offline = QuotientLearner(num_targets).fit(sensation[:moment], q[:moment])
        for way, representation in {**known, "offline": offline.representation_}.items():
            row = {"what": "learning", "body": run.experiment.name, "way": way}
            row |= {"seed": run.experiment.seed, "touches": moment, "cpu_s": round(cpu_s, 1)}
            yield row | scores(representation, contacts, world, metrics)


@styled
def picture(rows: list[dict[str, str]]) -> Figure:
    """The error of the shape, over touches (mean of the seeds) and over simulated minutes.

    A colour is a body, filled marks and full lines are active babbling, open marks and broken lines
    random babbling.
    """
    figure = Figure(figsize=(10, 4), layout="constrained")
    scored = [row for row in rows if row["error_sensorimotor"] and row["way"] in LINES]
    bodies = sorted({row["body"] for row in scored if row["what"] in PANELS})
    colors = dict(zip(bodies, (BLUE, ORANGE, GREEN, VERMILION, PINK), strict=False))
    for axes, (what, (x, scale)) in zip(figure.subplots(1, 2), PANELS.items(), strict=True):
        curves: dict[tuple[str, str, str], dict[float, list[float]]] = {}
        for row in scored:
            if row["what"] == what:
                seed = row["seed"] if what == "clock" else ""
                points = curves.setdefault((row["body"], row["way"], seed), {})
                points.setdefault(float(row[x]), []).append(100 * float(row["error_sensorimotor"]))
        for (body, way, _), points in sorted(curves.items()):
            at, style = sorted(points), {"color": colors[body], "markersize": 5}
            means = [np.mean(points[one]) for one in at]
            face = colors[body] if way == "active" else "white"
            axes.plot(at, means, LINES[way], markerfacecolor=face, **style)
        axes.set(xscale=scale, xlabel=x, ylabel="shape error, % (sensorimotor)", ylim=(0, None))
    axes = figure.axes[1]
    for body in bodies:
        axes.plot([], [], color=colors[body], label=body)
    for way, line in LINES.items():
        face = INK if way == "active" else "white"
        axes.plot([], [], line, color=INK, markerfacecolor=face, markersize=5, label=way)
    axes.legend()
    return figure


# What is measured: over what, and the scale of that axis; and the line of each way to babble.
PANELS = {"touches": ("touches", "log"), "clock": ("minutes", "linear")}
LINES = {"active": "o-", "random": "o--"}
FIELDS = (
    *("what", "body", "seed", "way", "touches", "minutes", "cpu_s", "share", "last_share"),
    *("receptors_felt", "skins_touched", "pairs_touched", "parts", "contact"),
    *("executed", "executed_worst"),
    *("error_sensorimotor", "betti_sensorimotor", "error_learned", "betti_learned"),
)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("touches", "clock", "infant", "learning"))
    parser.add_argument("runs", nargs="*", type=Path, help="for `learning`: that have babbled")
    parser.add_argument("--bodies", nargs="+", default=["torus", "cube", "sphere"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[1])
    parser.add_argument("--ways", nargs="+", choices=("random", *WAYS), default=["random", *WAYS])
    parser.add_argument("--until", type=float, default=20_000, help="touches, or minutes")
    parser.add_argument(
        "--metrics", nargs="*", default=["sensorimotor"], help="the first along the way, all last"
    )
    parser.add_argument(
        "--at", nargs="+", type=int, help="touches, or minutes, to score at, by all metrics"
    )
    parser.add_argument("--executed", type=int, default=0, help="pairs to execute under dynamics")
    parser.add_argument("--targets", type=int, default=300)
    parser.add_argument("--update", action="store_true", help="replace the shipped table")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")  # graphs in pieces, as long as little is known

    def made() -> Iterator[dict[str, Any]]:
        for path in arguments.runs:
            yield from learning(path, arguments.metrics, arguments.targets)
        if arguments.what in ("touches", "clock", "infant"):
            for body in ["infant"] if arguments.what == "infant" else arguments.bodies:
                for seed in arguments.seeds:
                    for way in arguments.ways:
                        yield from lives(arguments.what, body, seed, way, arguments)

    with results(f"exploration_{arguments.what}", update=arguments.update) as add:
        for row in made():
            add(dict.fromkeys(FIELDS) | row)
            print(
                *(f"{key} {value}" for key, value in row.items() if value is not None), flush=True
            )


if __name__ == "__main__":
    main()
