"""The stages of a run: babble, learn, plan, execute, evaluate.

Each is a function of the run, reads and writes its directory, and leaves what it computes to the
packages. A stage that runs again replaces what it made and drops what was made from it.
"""

from __future__ import annotations

import dataclasses
import shutil
import time
from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np

from selftouch_drake.acting.rehearsal import Try
from selftouch_drake.babbling import collect, require_complete
from selftouch_drake.evaluation import (
    coverage,
    kernel_positions,
    kernel_spread,
    neighbour_agreement,
    shape_rms_fraction,
)
from selftouch_drake.experience import ExperienceReader
from selftouch_drake.files import save_arrays
from selftouch_drake.motions import (
    Motion,
    Pilot,
    World,
    execute,
    judged,
    load_representation,
    rehearse_motion,
)
from selftouch_drake.representation import QuotientLearner, QuotientRepresentation
from selftouch_drake.run_directory import RunDirectory, RunError
from selftouch_drake.shape import (
    METRICS,
    intrinsic_dimension,
    recover,
    topology,
)
from selftouch_drake.trials import score_motions

__all__ = [
    "Pilot",
    "World",
    "babble",
    "evaluate",
    "execute",
    "has_babbled",
    "has_evaluated",
    "has_learned",
    "judged",
    "learn",
    "load_representation",
    "rehearse",
]

# Told the fraction of the stage that is done and what it is doing.
Progress = Callable[[float, str], None]


def silent(fraction: float, doing: str) -> None:
    """Reports progress to nobody."""


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
    force = np.concatenate(
        [felt.sum(axis=1) for felt in ExperienceReader(run.experience).batches("sensation")]
    )
    run.add_metrics(
        {
            "babbling_num_samples": wanted,
            "babbling_num_steps": num_steps,
            "babbling_touch_rate": wanted / num_steps,
            "babbling_force_median_N": float(np.median(force)),
            "babbling_force_max_N": float(force.max()),
            "babbling_wall_s": run.metrics().get("babbling_wall_s", 0.0) + wall,
        }
    )


def learn(run: RunDirectory, progress: Progress = silent) -> QuotientRepresentation:
    """Builds the quotient representation from the experience, and reads off what it tells."""
    began = time.perf_counter()
    _require_experience(run)
    shutil.rmtree(run.path / "plans", ignore_errors=True)
    run.rehearsal.unlink(missing_ok=True)
    run.drop_metrics("representation", "kernel", "learning", "topology", "intrinsic")
    run.drop_metrics("neighbour", "shape", "planning", "execution", "rehearsal")
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
        progress=lambda fraction, doing: progress(0.6 * fraction, doing),
    )
    body = recover(
        learner.representation_,
        settings.metric,
        seed=run.experiment.seed,
        progress=lambda fraction: progress(0.6 + 0.3 * fraction, "shape"),
    )
    representation = dataclasses.replace(
        learner.representation_, embedding=body.embedding.positions
    )
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
            "intrinsic_dimension": intrinsic_dimension(body.distances),
            "learning_wall_s": time.perf_counter() - began,
        }
    )
    progress(1.0, "learned")
    return representation


def rehearse(
    run: RunDirectory, world: World, start: int, goal: int, max_tries: int
) -> list[Try[Motion]]:
    """Plans and executes until contact is never lost, and remembers for every later plan.

    Returns:
        The tries, in order; the plan of the best is stored.
    """
    pilot = Pilot(run)
    tries = rehearse_motion(pilot, world, start, goal, max_tries=max_tries)
    pilot.memory.save(run.rehearsal)
    return tries


def evaluate(run: RunDirectory, world: World, progress: Progress = silent) -> None:
    """Scores what was learned against the truth, and random plans as felt in the world."""
    progress(0.0, "against the truth")
    run.add_metrics(_score_against_truth(run, world, load_representation(run)))
    figures = score_motions(
        run, world, lambda fraction, doing: progress(0.1 + 0.9 * fraction, doing)
    )
    run.add_metrics(figures)
    progress(1.0, "evaluated")


def _score_against_truth(
    run: RunDirectory, world: World, representation: QuotientRepresentation
) -> dict[str, object]:
    p_WF = ExperienceReader(run.truth).read("p_WF")
    _, fields = world.body
    positions = kernel_positions(representation, p_WF)
    spread = kernel_spread(representation, p_WF)
    chosen = run.experiment.representation.metric
    asked = run.experiment.evaluation.shape_metrics
    if asked is None:
        asked = [name for name, metric in METRICS.items() if metric.naive]
    by_metric = {}
    for metric in [name for name in METRICS if name == chosen or name in asked]:
        found = representation.embedding
        if metric != chosen:
            found = recover(representation, metric, seed=run.experiment.seed).embedding.positions
        by_metric[metric] = shape_rms_fraction(found, positions)
    return {
        **coverage(fields.vertices, fields.faces, p_WF.reshape(-1, 3)),
        "kernel_spread_median_m": float(np.median(spread)),
        "kernel_spread_worst_m": float(spread.max()),
        "neighbour_agreement": neighbour_agreement(representation.set_distance, positions),
        "shape_rms_fraction": by_metric[chosen],
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


def _require_experience(run: RunDirectory) -> None:
    """Refuses experience that is not there, or only in part."""
    if not has_babbled(run):
        raise RunError(
            f"{run.path} is half-finished: babbling has not come to its end; "
            f"resume it with `selftouch babble {run.path / 'experiment.yaml'} --out {run.path}`"
        )
    require_complete(run)
