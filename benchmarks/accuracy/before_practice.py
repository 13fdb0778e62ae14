"""Plans that nobody followed: imagined by the body model, and over the paper's representation.

    python benchmarks/accuracy/before_practice.py cube --seeds 21 22 --pairs 40
    python benchmarks/accuracy/before_practice.py infant --seeds 2 --pairs 100 --set '{...}'
    python benchmarks/accuracy/before_practice.py runs/mine --pairs 40
    python benchmarks/accuracy/before_practice.py torus --ways checked practised no_slides no_bends

A name of an experiment is babbled and learned for each seed (or taken from --runs, if it is there);
a folder is a run that has learned. Random pairs of sensations on one part are planned from the same
starts in several ways, and judged by the experimenter without dynamics: contact (mean and worst),
goals felt, postures and plans in which rigid parts overlap, perfect plans (contact throughout, the
goal felt, no overlap), the path on the true skin over the shortest (median and worst), motion of
the joints, prediction error, milliseconds of processor time for a plan with times and prediction,
plans that leave the skin on purpose (their time in the air is not lost contact), the share of
the plans that the model knew a way for, and how many plans had doubts, how many of these were not
perfect, and how many of the others.

Ways: `imagined` and `paper` as above; `checked` is an imagined plan after practice, `practised` one
of the paper after it; `no_...` are `practised` without one of the methods of practice, or without
the network that bends steps: what it is worth where no body model is accepted.
"""

import argparse
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.memory import RehearsalMemory
from selftouch_drake.agent.practice.practise import NoWayError
from selftouch_drake.agent.practice.sliding import Slider
from selftouch_drake.bodies.embodiment import Bodies, pilot_in
from selftouch_drake.evaluation.motion import random_pairs, score_motion
from selftouch_drake.evaluation.paths import TruePaths
from selftouch_drake.experiment import load_experiment
from selftouch_drake.experiment.loading import merged, parse_fields
from selftouch_drake.run.artifacts import load_agent
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.worlds import run_bodies

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.babbled import learned


class Row(NamedTuple):
    """What became of one plan."""

    contact: float
    reached: bool
    overlap: float
    over_shortest: float
    motion: float
    error: float
    seconds: float
    lifts_off: bool
    imagined: bool
    doubted: bool

    @property
    def perfect(self) -> bool:
        """Contact throughout, the goal felt, no overlap."""
        return self.contact == 1.0 and self.reached and self.overlap == 0.0


Pairs = list[tuple[int, int]]

#: Where practice found no way, nothing is touched.
NO_WAY = Row(0.0, False, 0.0, np.nan, 0.0, np.nan, np.nan, False, False, False)


def run_of(name: str, seed: int, folder: Path, changes: str) -> RunDirectory:
    """The run of an experiment and seed; one that is missing is made, and learns."""
    path = folder / f"{name}-{seed}"
    if (path / "body_model.npz").exists():
        return RunDirectory.open(path)
    return learned(path, load_experiment(name, merged({"seed": seed}, parse_fields(changes))))


#: What each way plans with: whether the body model counts, whether plans are practised, and what is
#: taken away.
WAYS: dict[str, tuple[bool, bool, dict[tuple[object, str], object]]] = {
    "imagined": (True, False, {}),
    "paper": (False, False, {}),
    "checked": (True, True, {}),
    "practised": (False, True, {}),
    "no_slides": (False, True, {(Slider, "slide"): lambda *_: None}),
    "no_detours": (False, True, {(Slider, "detour"): lambda *_: None}),
    "no_costs": (False, True, {(RehearsalMemory, "avoiding"): lambda memory, _: memory}),
    "no_missed": (False, True, {(RehearsalMemory, "missing"): lambda memory, _: memory}),
    "no_bends": (False, True, {}),
}


def planned_in(way: str, agent: Agent, bodies: Bodies, run: RunDirectory, pairs: Pairs):
    """As `planned`, in one of `WAYS`."""
    has_model, practises, taken_away = WAYS[way]
    agent = agent if has_model else agent.without_model()
    if way == "no_bends":
        agent = Agent.of(
            agent.representation, kernel_sensation=agent.kernel_sensation, prefer=agent.prefer
        )
    with ExitStack() as stack:
        for (owner, name), instead in taken_away.items():
            stack.enter_context(mock.patch.object(owner, name, instead))
        yield from planned(agent, bodies, run, pairs, practises=practises)


def planned(agent: Agent, bodies: Bodies, run: RunDirectory, pairs: Pairs, *, practises=False):
    """Plans of pairs, scored as they are felt slowly."""
    pilot = pilot_in(bodies, agent, run.experiment)
    pilot.prepare_queries()
    assert bodies.still is not None
    assert bodies.world is not None
    true = TruePaths([skin.fields for skin in bodies.world.skins])
    for start, goal in pairs:
        began = time.process_time()
        if practises:
            try:
                found = pilot.plan(start, goal)
            except NoWayError:
                yield NO_WAY
                continue
            plan, motion = found.plan, found.motion
        else:
            plan = agent.plan(start, goal, q_start=pilot.start_of(start, goal))
            motion = pilot.motion(plan)
        seconds = time.process_time() - began
        felt = bodies.still.feel(motion.q)
        score = score_motion(motion, felt.sensation, agent.representation)
        over = true.over_shortest(felt.contacts) if motion.touching.all() else None
        yield Row(
            contact=score.contact,
            reached=score.reached,
            overlap=float(np.mean(~felt.reached)),
            over_shortest=np.nan if over is None else over,
            motion=float(np.linalg.norm(np.diff(motion.q, axis=0), axis=1).sum()),
            error=score.prediction_error,
            seconds=seconds,
            lifts_off=bool(plan.in_air.any()),
            imagined=plan.is_imagined,
            doubted=bool(plan.doubts),
        )


def printed(name: str, way: str, rows: list[Row]) -> None:
    """One line of figures."""
    values = np.array(rows, dtype=float)
    contact, reached, overlap, over, motion, error, seconds, lifts, imagined, doubted = values.T
    failed = np.array([not row.perfect for row in rows])
    sure = doubted == 0
    known = over[np.isfinite(over)]
    paths = f"{np.median(known):5.2f} / {known.max():5.2f}" if len(known) else "    -        "
    print(
        f"{name:>16} {way:>10} {len(rows):4d} {100 * contact.mean():6.2f} / "
        f"{100 * contact.min():5.1f} {100 * reached.mean():5.0f} {100 * overlap.mean():7.2f} "
        f"({np.sum(overlap > 0):d}) {100 * np.mean(~failed):6.0f} {paths} "
        f"{np.median(motion):6.2f} {np.nanmean(error):8.4f} {1e3 * np.nanmedian(seconds):6.0f} / "
        f"{1e3 * np.nanquantile(seconds, 0.95):4.0f} {lifts.sum():5.0f} "
        f"{100 * imagined.mean():8.0f} {doubted.sum():7.0f} ({failed[~sure].sum():d}) "
        f"{failed[sure].sum():d}",
        flush=True,
    )


def main() -> None:
    """Prints two lines for each run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="+", help="experiments, or folders of runs")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=["imagined", "paper"])
    parser.add_argument("--runs", type=Path, default=Path("runs/before_practice"))
    parser.add_argument("--set", default="{}", help="changes of experiments, as in `selftouch run`")
    args = parser.parse_args()
    print(
        f"{'':>16} {'way':>10} {'num':>4} {'contact, worst':>15} {'goals':>5} {'overlaps':>11} "
        f"{'perfect':>6} {'path, worst':>13} {'motion':>6} {'error':>8} {'ms, 95 %':>13} "
        f"{'lifts':>5} imagined doubted (failed), others"
    )
    for name in args.names:
        if Path(name).is_dir():
            runs = [RunDirectory.open(Path(name))]
        else:
            runs = [run_of(name, seed, args.runs, args.set) for seed in args.seeds]
        for run in runs:
            bodies, agent = run_bodies(run), load_agent(run, predicts=True)
            pairs = random_pairs(run.experiment, agent.representation, args.pairs)
            for way in args.ways:
                printed(run.path.name, way, list(planned_in(way, agent, bodies, run, pairs)))


if __name__ == "__main__":
    main()
