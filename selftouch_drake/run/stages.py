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

from selftouch_drake.agent.rehearsal import Try
from selftouch_drake.agent.representation import QuotientLearner, QuotientRepresentation
from selftouch_drake.agent.shape import (
    METRICS,
    intrinsic_dimension,
    recover,
    topology,
    warn_of_misfit,
)
from selftouch_drake.evaluation import (
    coverage,
    distance_distortion,
    kernel_positions,
    kernel_spread,
    neighbour_agreement,
    shape_rms_fraction,
    surface_distances,
    trustworthiness,
)
from selftouch_drake.experience import ExperienceReader, collect, require_complete
from selftouch_drake.files import load_arrays, save_arrays, written_whole
from selftouch_drake.run.directory import RunDirectory, RunError
from selftouch_drake.run.motions import (
    Motion,
    Pilot,
    World,
    execute,
    judged,
    load_representation,
    rehearse_motion,
    tracking_rms,
)
from selftouch_drake.run.trials import score_motions

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
    "tracking_rms",
]

#: What the names of the figures that a stage leaves begin with.
BABBLED = ("babbling",)
LEARNED = (
    "learning",
    "representation",
    "kernel_size",
    "graph",
    "topology",
    "intrinsic",
    "embedding",
)

# mN; what presses harder counts as so much where the median is found.
_MOST_FORCE_MN = 1_000_000

# Told the fraction of the stage that is done and what it is doing.
Progress = Callable[[float, str], None]


def silent(fraction: float, doing: str) -> None:
    """Reports progress to nobody."""


def babble(
    run: RunDirectory, world: World, executor: Executor, progress: Progress = silent
) -> None:
    """Collects the experience of the run; walks that are stored already are kept."""
    began = time.perf_counter()
    wall_before = run.metrics().get("babbling_wall_s", 0.0)
    _, fields = world.body
    surface = {"p_BS": fields.p_BS, "vertices": fields.vertices, "faces": fields.faces}
    save_arrays(run.skin, surface | run.body_stamp())
    wanted, stored = run.experiment.babbling.num_samples, 0

    def count(num_rows: int) -> None:
        nonlocal stored
        stored += num_rows
        progress(stored / wanted, f"{stored:,} of {wanted:,} touches")

    num_steps = collect(run, executor=executor, progress=count)
    wall = time.perf_counter() - began
    median, largest = _force_figures(run)
    run.add_metrics(
        {
            "babbling_num_samples": wanted,
            "babbling_num_steps": num_steps,
            "babbling_touch_rate": wanted / num_steps,
            "babbling_force_median_N": median,
            "babbling_force_max_N": largest,
            "babbling_wall_s": wall_before + wall,
        }
    )


def _force_figures(run: RunDirectory) -> tuple[float, float]:
    """Median, to a millinewton, and largest force of the touches, in memory that does not grow."""
    counts, largest = np.zeros(_MOST_FORCE_MN + 1, dtype=np.int64), 0.0
    for felt in ExperienceReader(run.experience).batches("sensation"):
        force = felt.sum(axis=1)
        largest = max(largest, float(force.max()))
        bins = np.rint(1e3 * force).astype(np.int64).clip(0, _MOST_FORCE_MN)
        counts += np.bincount(bins, minlength=len(counts))
    return int(np.searchsorted(np.cumsum(counts), counts.sum() / 2)) / 1e3, largest


def learn(run: RunDirectory, progress: Progress = silent) -> QuotientRepresentation:
    """Builds the quotient representation from the experience, and reads off what it tells."""
    began = time.perf_counter()
    _require_experience(run)
    settings = run.experiment.representation
    learner = QuotientLearner(
        num_targets=settings.num_targets,
        max_kernel_size=settings.max_kernel_size,
        random_state=run.experiment.seed,
    )
    learner.fit_batches(
        ExperienceReader(run.experience).touches,
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
    warn_of_misfit(body.embedding)
    progress(0.9, "holes")
    found = topology(body.places)
    diagrams = {f"diagram_{dimension}": bars for dimension, bars in enumerate(found.diagram)}
    dimension = intrinsic_dimension(body.distances)
    sizes = np.diff(representation.kernel_offsets)
    # Written aside first: what was learned before, and all that was made from it, stays as it is
    # until the new is whole.
    with (
        written_whole(run.representation) as new_representation,
        written_whole(run.topology) as new_topology,
        written_whole(run.body_distances) as new_distances,
    ):
        stamp = run.stamp()
        names = [field.name for field in dataclasses.fields(representation)]
        save_arrays(new_representation, {n: getattr(representation, n) for n in names} | stamp)
        save_arrays(new_topology, diagrams | {"parts": body.parts} | stamp)
        distances = body.distances.astype(np.float32)
        save_arrays(new_distances, {"distances": distances} | stamp)
        _forget_learning(run)
    run.add_metrics(
        {
            "representation_num_targets": representation.num_targets,
            "kernel_size_min": int(sizes.min()),
            "kernel_size_median": float(np.median(sizes)),
            "kernel_size_max": int(sizes.max()),
            "graph_component_sizes": np.bincount(learner.component_).tolist(),
            **({"graph_bridges": learner.bridges_.tolist()} if len(learner.bridges_) else {}),
            "topology_betti": list(found.betti),
            "topology_margin": found.margin,
            "embedding_fourth_eigenvalue": body.embedding.fourth_eigenvalue,
            "intrinsic_dimension": dimension,
            "learning_wall_s": time.perf_counter() - began,
        }
    )
    progress(1.0, "learned")
    return representation


def _forget_learning(run: RunDirectory) -> None:
    """Drops the figures of what was learned before, and all that was made from it."""
    run.drop_metrics(*LEARNED, "kernel")
    run.drop_metrics("neighbour", "shape", "trustworthiness", "continuity", "distance")
    run.drop_metrics("planning", "execution", "rehearsal")
    shutil.rmtree(run.path / "plans", ignore_errors=True)
    run.rehearsal.unlink(missing_ok=True)
    run.trials.unlink(missing_ok=True)


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
    """Scores what was learned against the truth, and random plans as felt in the world.

    Raises:
        StoreError: the truth is not there, or only in part.
    """
    representation = load_representation(run)
    require_complete(run, truth=True)
    run.metrics()  # what cannot be added to is refused now
    progress(0.0, "against the truth")
    run.add_metrics(_score_against_truth(run, world, representation))
    figures = score_motions(
        run, world, lambda fraction, doing: progress(0.1 + 0.9 * fraction, doing)
    )
    run.add_metrics(figures)
    progress(1.0, "evaluated")


def _score_against_truth(
    run: RunDirectory, world: World, representation: QuotientRepresentation
) -> dict[str, object]:
    truth = ExperienceReader(run.truth)
    p_WF = truth.take("p_WF", representation.kernel_row)
    _, fields = world.body
    positions = kernel_positions(representation, p_WF)
    spread = kernel_spread(representation, p_WF)
    chosen = run.experiment.representation.metric
    found = {chosen: (representation.embedding, _distances_along_body(run, representation))}
    asked = run.experiment.evaluation.shape_metrics
    if asked is None:
        asked = [name for name, metric in METRICS.items() if metric.naive]
    for name in [name for name in METRICS if name in asked and name != chosen]:
        body = recover(representation, name, seed=run.experiment.seed)
        found[name] = (body.embedding.positions, body.distances)
    shape_error = {
        name: shape_rms_fraction(embedding, positions) for name, (embedding, _) in found.items()
    }
    figures: dict[str, object] = {
        **coverage(
            fields.vertices, fields.faces, (p.reshape(-1, 3) for p in truth.batches("p_WF"))
        ),
        "kernel_spread_median_m": float(np.median(spread)),
        "kernel_spread_worst_m": float(spread.max()),
        "neighbour_agreement": neighbour_agreement(representation.set_distance, positions),
        "shape_rms_fraction": shape_error[chosen],
        "shape_rms_fraction_by_metric": shape_error,
    }
    # With two fingers the quotient space is another than the body's surface.
    if run.experiment.num_fingers == 1:
        true = surface_distances(fields.vertices, fields.faces, positions)
        _, distances = found[chosen]
        distortion = {name: distance_distortion(d, true) for name, (_, d) in found.items()}
        figures |= {
            "trustworthiness": trustworthiness(distances, true),
            "continuity": trustworthiness(true, distances),
            "distance_distortion_median_fraction": distortion[chosen].median,
            "distance_distortion_p95_fraction": distortion[chosen].p95,
            "distance_distortion_median_fraction_by_metric": {
                name: found.median for name, found in distortion.items()
            },
        }
    return figures


def _distances_along_body(run: RunDirectory, representation: QuotientRepresentation) -> np.ndarray:
    """`(K, K)` along the recovered body, as `learn` left them."""
    num_targets = representation.num_targets
    try:
        arrays = load_arrays(run.body_distances, ["distances"])
    except FileNotFoundError:
        raise RunError(
            f"{run.body_distances} is not there; run `selftouch learn {run.path}`"
        ) from None
    run.require_stamp(run.body_distances, arrays)
    distances = arrays["distances"]
    if distances.shape != (num_targets, num_targets):
        raise RunError(
            f"{run.body_distances} has shape {distances.shape}, not {(num_targets, num_targets)}; "
            f"run `selftouch learn {run.path}`"
        )
    return distances


def has_babbled(run: RunDirectory) -> bool:
    """Whether all of the run's experience is there."""
    return (
        run.metrics().get("babbling_num_samples") == run.experiment.babbling.num_samples
        and run.experience.is_dir()
    )


def has_learned(run: RunDirectory) -> bool:
    """Whether `learn` came to its end."""
    made = (run.representation, run.topology, run.body_distances)
    return "learning_wall_s" in run.metrics() and all(path.exists() for path in made)


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
