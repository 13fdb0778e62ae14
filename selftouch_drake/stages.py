"""The stages of a run: babble, learn, plan, execute, evaluate.

Each is a function of the run, reads and writes its directory, and leaves what it computes to the
packages. A stage that runs again replaces what it made and drops what was made from it.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import time
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor
from functools import cached_property

import numpy as np

from selftouch_drake.acting.execution import LOG_PERIOD, DynamicWorld
from selftouch_drake.acting.timing import time_path
from selftouch_drake.babbling import collect
from selftouch_drake.body import HollowSkin, ReceptiveFields, build_body
from selftouch_drake.evaluation import (
    coverage,
    kernel_positions,
    kernel_spread,
    neighbour_agreement,
    score_motion,
    shape_rms_fraction,
    summarise,
)
from selftouch_drake.experience import ExperienceReader
from selftouch_drake.experiment import Experiment
from selftouch_drake.files import load_arrays, save_arrays
from selftouch_drake.planning import Planner, jerk_reduction, predict_sensation
from selftouch_drake.representation import QuotientLearner, QuotientRepresentation
from selftouch_drake.run_directory import RunDirectory, RunError
from selftouch_drake.shape import (
    METRICS,
    body_distances,
    embed,
    embed_representation,
    intrinsic_dimension,
    topology,
)
from selftouch_drake.world.probe import ContactProbe

# Told the fraction of the stage that is done and what it is doing.
Progress = Callable[[float, str], None]


def silent(fraction: float, doing: str) -> None:
    """Reports progress to nobody."""


class World:
    """The world of an experiment, each part built when first asked for."""

    def __init__(self, experiment: Experiment):
        self._experiment = experiment

    @cached_property
    def body(self) -> tuple[HollowSkin, ReceptiveFields]:
        """The skin and its receptive fields."""
        return build_body(self._experiment)

    @cached_property
    def probe(self) -> ContactProbe:
        """What is felt at given configurations."""
        return ContactProbe(self._experiment, *self.body)

    @cached_property
    def dynamic(self) -> DynamicWorld:
        """The agent under dynamics."""
        return DynamicWorld(self._experiment, *self.body)


def local_executor(num_workers: int | None = None) -> Executor:
    """A pool of processes, one a core by default; they leave Ctrl-C to the main process."""
    return ProcessPoolExecutor(
        num_workers or os.cpu_count(),
        mp_context=multiprocessing.get_context("spawn"),
        initializer=signal.signal,
        initargs=(signal.SIGINT, signal.SIG_IGN),
    )


def babble(
    run: RunDirectory, world: World, executor: Executor, progress: Progress = silent
) -> None:
    """Collects the experience of the run; walks that are stored already are kept."""
    began = time.perf_counter()
    _, fields = world.body
    save_arrays(run.skin, {"p_BS": fields.p_BS, "vertices": fields.vertices, "faces": fields.faces})
    wanted, stored = run.experiment.babbling.num_samples, 0

    def count(num_rows: int) -> None:
        nonlocal stored
        stored += num_rows
        progress(stored / wanted, f"{stored:,} of {wanted:,} touches")

    num_steps = collect(run, executor=executor, progress=count)
    wall = time.perf_counter() - began
    run.add_metrics(
        {
            "babbling_num_samples": wanted,
            "babbling_num_steps": num_steps,
            "babbling_wall_s": run.metrics().get("babbling_wall_s", 0.0) + wall,
        }
    )


def learn(run: RunDirectory, progress: Progress = silent) -> QuotientRepresentation:
    """Builds the quotient representation from the experience, and reads off what it tells."""
    began = time.perf_counter()
    _require_experience(run)
    shutil.rmtree(run.path / "plans", ignore_errors=True)
    run.drop_metrics("representation", "kernel", "learning", "topology", "intrinsic")
    run.drop_metrics("neighbour", "shape", "planning", "execution")
    experience = ExperienceReader(run.experience)
    settings = run.experiment.representation
    learner = QuotientLearner(
        num_targets=settings.num_targets,
        max_kernel_size=settings.max_kernel_size,
        random_state=run.experiment.seed,
    )
    learner.fit(
        experience.read("sensation"),
        experience.read("q"),
        progress=lambda fraction, doing: progress(0.8 * fraction, doing),
    )
    progress(0.8, "shape")
    distances = body_distances(learner.representation_, settings.metric)
    representation = embed_representation(learner.representation_, settings.metric)
    progress(0.9, "holes")
    found = topology(representation.embedding)
    representation.save(run.representation)
    save_arrays(run.topology, {f"diagram_{dim}": bars for dim, bars in enumerate(found.diagram)})
    sizes = np.diff(representation.kernel_offsets)
    run.add_metrics(
        {
            "representation_num_targets": representation.num_targets,
            "kernel_size_min": int(sizes.min()),
            "kernel_size_median": float(np.median(sizes)),
            "kernel_size_max": int(sizes.max()),
            "topology_betti": list(found.betti),
            "topology_margin": found.margin,
            "intrinsic_dimension": intrinsic_dimension(distances),
            "learning_wall_s": time.perf_counter() - began,
        }
    )
    progress(1.0, "learned")
    return representation


class Pilot:
    """Plans over a run's representation, with timing, and keeps the plans in the run.

    Args:
        run: a run that has learned.
    """

    def __init__(self, run: RunDirectory):
        self.run = run
        self.representation = load_representation(run)
        self._planner = Planner(
            self.representation, knot_spacing=run.experiment.planning.knot_spacing
        )
        self.query_s: list[float] = []
        self.jerk_reduction: list[float] = []

    def plan(self, start: int, goal: int) -> dict[str, np.ndarray]:
        """Plans from a configuration of `start`, drawn from the seed, to `goal`, and stores it."""
        q_start = self._some_configuration(start, goal)
        limits = self.run.experiment.execution
        began = time.perf_counter()
        plan = self._planner.plan(q_start, start, goal)
        num_joints = len(q_start)
        timed = time_path(
            plan.path,
            velocity_limit=np.full(num_joints, limits.max_velocity),
            acceleration_limit=np.full(num_joints, limits.max_acceleration),
            rate_hz=1 / LOG_PERIOD,
        )
        self.query_s.append(time.perf_counter() - began)
        self.jerk_reduction.append(jerk_reduction(plan))
        arrays = {
            "nodes": plan.nodes,
            "waypoints_q": plan.waypoints_q,
            "time_s": timed.time_s,
            "q": timed.q,
            "v": timed.v,
            "predicted": predict_sensation(self.representation, plan, timed.s),
        }
        save_arrays(self.run.plan(start, goal), arrays)
        return arrays

    def _some_configuration(self, start: int, goal: int) -> np.ndarray:
        """Where the arm is when it is asked: any configuration of the start kernel."""
        _require_targets(self.representation, start, goal)
        members = self.representation.kernel_q[self.representation.members(start)]
        stream = self.run.experiment.random_stream("start", start, goal)
        return members[np.random.default_rng(stream).integers(len(members))].astype(float)


def execute(run: RunDirectory, world: World, start: int, goal: int) -> dict[str, np.ndarray]:
    """Executes a stored plan in the dynamic world and stores what was felt beside it."""
    _require_targets(load_representation(run), start, goal)
    if not run.plan(start, goal).exists():
        raise RunError(
            f"{run.path} has no plan from {start} to {goal}; make one with "
            f"`selftouch plan {run.path} --from {start} --to {goal}`"
        )
    plan = load_arrays(run.plan(start, goal), ("time_s", "q", "v", "predicted"))
    done = world.dynamic.execute(plan["time_s"], plan["q"], plan["v"])
    kinematics = world.probe.kinematics
    plan |= {
        "felt": done.felt,
        "q_measured": done.q_measured,
        "v_measured": done.v_measured,
        "torque": done.torque,
        "p_WF_planned": kinematics.positions(plan["q"]).reshape(len(plan["q"]), -1),
        "p_WF_measured": kinematics.positions(done.q_measured).reshape(len(done.q_measured), -1),
    }
    save_arrays(run.plan(start, goal), plan)
    return plan


def evaluate(run: RunDirectory, world: World, progress: Progress = silent) -> None:
    """Scores what was learned against the truth, and random plans as felt in the world."""
    pilot = Pilot(run)
    progress(0.0, "against the truth")
    run.add_metrics(_score_against_truth(run, world, pilot.representation))
    targets = pilot.representation.target_sensations
    planned, executed, tracking, force = [], [], [], []
    pairs = random_pairs(run)
    for number, (start, goal) in enumerate(pairs):
        progress(0.1 + 0.9 * number / len(pairs), f"sensation {start} to {goal}")
        plan = pilot.plan(start, goal)
        felt = world.probe.sensations(plan["q"])
        planned.append(score_motion(felt, plan["predicted"], targets, goal))
        plan = execute(run, world, start, goal)
        executed.append(score_motion(plan["felt"], plan["predicted"], targets, goal))
        tracking.append(np.sqrt(np.mean(np.square(plan["q_measured"] - plan["q"]))))
        force.append(plan["felt"].sum(axis=1).max())
    if pairs:
        query_ms = 1e3 * np.array(pilot.query_s)
        run.add_metrics(
            {
                **summarise(planned, "planning"),
                "planning_jerk_reduction": float(np.median(pilot.jerk_reduction)),
                "planning_query_ms_median": float(np.median(query_ms)),
                "planning_query_ms_p95": float(np.percentile(query_ms, 95)),
                **summarise(executed, "execution"),
                "execution_tracking_rms_rad": float(np.sqrt(np.mean(np.square(tracking)))),
                "execution_force_max_N": float(np.max(force)),
            }
        )
    progress(1.0, "evaluated")


def random_pairs(run: RunDirectory) -> list[tuple[int, int]]:
    """The pairs of start and goal that `evaluate` plans, drawn from the seed without repetition."""
    num_targets = run.experiment.representation.num_targets
    random = np.random.default_rng(run.experiment.random_stream("pairs"))
    wanted = min(run.experiment.evaluation.num_pairs, num_targets * (num_targets - 1))
    codes = random.choice(num_targets * (num_targets - 1), size=wanted, replace=False)
    starts, goals = codes // (num_targets - 1), codes % (num_targets - 1)
    return [(int(i), int(j + (j >= i))) for i, j in zip(starts, goals, strict=True)]


def load_representation(run: RunDirectory) -> QuotientRepresentation:
    """The representation of a run that has learned."""
    if not run.representation.exists():
        raise RunError(f"{run.path} has learned nothing yet; run `selftouch learn {run.path}`")
    return QuotientRepresentation.load(run.representation)


def _score_against_truth(
    run: RunDirectory, world: World, representation: QuotientRepresentation
) -> dict[str, object]:
    p_WF = ExperienceReader(run.truth).read("p_WF")
    _, fields = world.body
    positions = kernel_positions(representation, p_WF)
    spread = kernel_spread(representation, p_WF)
    by_metric = {
        metric: shape_rms_fraction(embed(representation, metric).positions, positions)
        for metric in METRICS
    }
    return {
        **coverage(p_WF, fields.vertices, fields.faces),
        "kernel_spread_median_m": float(np.median(spread)),
        "kernel_spread_worst_m": float(spread.max()),
        "neighbour_agreement": neighbour_agreement(representation.set_distance, positions),
        "shape_rms_fraction": by_metric[run.experiment.representation.metric],
        "shape_rms_fraction_by_metric": by_metric,
    }


def has_babbled(run: RunDirectory) -> bool:
    """Whether all of the run's experience is there."""
    return (
        run.metrics().get("babbling_num_samples") == run.experiment.babbling.num_samples
        and run.experience.is_dir()
    )


def has_learned(run: RunDirectory) -> bool:
    """Whether `learn` came to its end."""
    return "learning_wall_s" in run.metrics() and run.representation.exists()


def has_evaluated(run: RunDirectory) -> bool:
    """Whether `evaluate` came to its end."""
    wanted = run.experiment.evaluation.num_pairs
    done = "execution_num_pairs" if wanted else "shape_rms_fraction"
    return done in run.metrics()


def _require_targets(representation: QuotientRepresentation, start: int, goal: int) -> None:
    num_targets = representation.num_targets
    for name, target in (("--from", start), ("--to", goal)):
        if not 0 <= target < num_targets:
            raise RunError(
                f"{name} is {target}; this run has target sensations 0 to {num_targets - 1}"
            )


def _require_experience(run: RunDirectory) -> None:
    """Refuses experience that is not there, or only in part."""
    if not has_babbled(run):
        raise RunError(
            f"{run.path} is half-finished: babbling has not come to its end; "
            f"resume it with `selftouch babble {run.path / 'experiment.yaml'} --out {run.path}`"
        )
