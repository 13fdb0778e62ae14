"""The stages of a run: babble, learn, plan, execute, rehearse, evaluate.

Each is a function of the run, reads and writes its directory, and leaves what it computes to the
packages. A stage that runs again replaces what it made and drops what was made from it.
"""

from __future__ import annotations

import shutil
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import Executor

import numpy as np

from selftouch_drake.agent.motions import Motion
from selftouch_drake.agent.rehearsal import Try, best
from selftouch_drake.agent.representation import QuotientLearner, QuotientRepresentation
from selftouch_drake.agent.shape import recover
from selftouch_drake.experience import ExperienceReader, collect, require_complete
from selftouch_drake.experiment import Experiment, ExperimentError
from selftouch_drake.files import save_arrays
from selftouch_drake.robot import World
from selftouch_drake.run.acting import Pilot
from selftouch_drake.run.directory import RunDirectory, RunError
from selftouch_drake.run.figures import keys_of
from selftouch_drake.run.knowledge import (
    load_agent,
    load_body,
    load_motion,
    save_learned,
    save_memory,
    save_plan,
)
from selftouch_drake.run.scores import found_figures, score_body, trial_figures, trial_table
from selftouch_drake.run.trials import try_pairs

# mN; what presses harder counts as so much where the median is found.
_MOST_FORCE_MN = 1_000_000

#: Called with the fraction of the stage that is done and what it is doing.
Progress = Callable[[float, str], None]


class NeverTouchedWarning(UserWarning):
    """A skin was never touched, or something that touches never touched."""


def silent(fraction: float, doing: str) -> None:
    """Reports progress to nobody."""


def build_world(experiment: Experiment) -> World:
    """The world of an experiment, with its robot built.

    Raises:
        ExperimentError: Drake refuses it; the text is Drake's own.
        ValueError: the experiment names what the robot does not have, or a skin cannot be made.
    """
    world = World(experiment)
    try:
        _ = world.robot
    # Some of Drake's checks log what is wrong and then raise SystemExit.
    except (RuntimeError, SystemExit) as error:
        reason = " ".join(str(error).split())[:500]
        raise ExperimentError(f"robot.directives gives what Drake refuses: {reason}") from error
    return world


def make_world(run: RunDirectory) -> World:
    """The world of a run.

    Raises:
        RunError: a model was edited since the run was begun.
        ValueError: as `build_world`.
    """
    run.require_models()
    return build_world(run.experiment)


def babble(
    run: RunDirectory, world: World, executor: Executor, progress: Progress = silent
) -> None:
    """Collects the experience of the run; walks that are stored already are kept.

    Warns:
        NeverTouchedWarning: of each skin that was never touched, and each toucher that never did.
    """
    began = time.perf_counter()
    wall_before = run.metrics().get("babbling_wall_s", 0.0)
    surfaces = {"receptor_skin": world.receptor_skin}
    for skin in world.skins:
        surfaces[f"{skin.name}_vertices"] = skin.fields.vertices
        surfaces[f"{skin.name}_faces"] = skin.fields.faces
        surfaces[f"{skin.name}_p_LS"] = skin.fields.p_LS
    save_arrays(run.skin, surfaces | run.body_stamp())
    wanted, stored = run.experiment.babbling.num_samples, 0

    def count(num_rows: int) -> None:
        nonlocal stored
        stored += num_rows
        progress(stored / wanted, f"{stored:,} of {wanted:,} touches")

    counts = collect(
        run.experiment,
        run.path,
        fingerprint=run.fingerprint(),
        executor=executor,
        progress=count,
    )
    wall = time.perf_counter() - began
    median, largest = _force_figures(run)
    by_skin, by_toucher = _touch_counts(run)
    run.add_metrics(
        {
            "babbling_num_samples": wanted,
            "babbling_num_steps": counts.num_steps,
            "babbling_touch_rate": wanted / counts.num_steps,
            "babbling_num_impossible": counts.num_impossible,
            "babbling_touches_by_skin": by_skin,
            "babbling_force_median_N": median,
            "babbling_force_max_N": largest,
            "babbling_wall_s": wall_before + wall,
        }
    )
    never = [f"skins.{name} was never touched" for name, number in by_skin.items() if not number]
    never += [f"touching.{name} never touched" for name, number in by_toucher.items() if not number]
    if never:
        warnings.warn(
            f"{', '.join(never)} in {wanted:,} touches; see what can reach what with `selftouch "
            f"robot {run.path / 'experiment.yaml'} --show`",
            NeverTouchedWarning,
            stacklevel=2,
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


def _touch_counts(run: RunDirectory) -> tuple[dict[str, int], dict[str, int]]:
    """Touches of each skin, and by each toucher; one on two skins counts for both."""
    skins, touchers = list(run.experiment.skins), list(run.experiment.touching)
    of_skin, by_toucher = np.zeros(len(skins), int), np.zeros(len(touchers) + len(skins), int)
    for contacts in ExperienceReader(run.truth).contacts():
        for found, counts in ((contacts.skin, of_skin), (contacts.toucher, by_toucher)):
            pairs = np.unique(contacts.row * len(counts) + found)
            counts += np.bincount(pairs % len(counts), minlength=len(counts))
    # A link that touches with its own skin counts as that skin.
    for number, toucher in enumerate(run.experiment.touching.values()):
        for skin, worn in enumerate(run.experiment.skins.values()):
            if toucher.link is not None and toucher.link == worn.link:
                by_toucher[number] += by_toucher[len(touchers) + skin]
    return (
        dict(zip(skins, of_skin.tolist(), strict=True)),
        dict(zip(touchers, by_toucher[: len(touchers)].tolist(), strict=True)),
    )


def learn(run: RunDirectory, progress: Progress = silent) -> QuotientRepresentation:
    """Builds the quotient representation from the experience, and recovers the body from it.

    Raises:
        RunError: the experience is not complete.
        ValueError: it cannot be learned from.
    """
    began = time.perf_counter()
    _require_experience(run)
    settings, seed = run.experiment.representation, run.experiment.seed
    learner = QuotientLearner(
        num_targets=settings.num_targets,
        max_kernel_size=settings.max_kernel_size,
        random_state=seed,
    )
    learner.fit_batches(
        ExperienceReader(run.experience).touches,
        progress=lambda fraction, doing: progress(0.6 * fraction, doing),
    )
    body = recover(
        learner.representation_,
        settings.metric,
        seed=seed,
        progress=lambda fraction: progress(0.6 + 0.35 * fraction, "shape and holes"),
    )
    representation = body.embed(learner.representation_)
    body.warn_of_misfit()
    save_learned(run, representation, body, forget=lambda: _forget_learning(run))
    sizes = np.diff(representation.kernel_offsets)
    bridges = learner.bridges_.tolist()
    run.add_metrics(
        {
            "representation_num_targets": representation.num_targets,
            "representation_num_set_aside": representation.num_set_aside,
            "kernel_size_min": int(sizes.min()),
            "kernel_size_median": float(np.median(sizes)),
            "kernel_size_max": int(sizes.max()),
            "graph_component_sizes": np.bincount(learner.component_).tolist(),
            **({"graph_bridges": bridges} if bridges else {}),
            **found_figures(run, body),
            "learning_wall_s": time.perf_counter() - began,
        }
    )
    progress(1.0, "learned")
    return representation


def _forget_learning(run: RunDirectory) -> None:
    """Drops the figures of what was learned before, and all that was made from it."""
    run.drop_metrics(keys_of("learn", "evaluate"))
    shutil.rmtree(run.path / "plans", ignore_errors=True)
    run.rehearsal.unlink(missing_ok=True)
    run.trials.unlink(missing_ok=True)


def plan(run: RunDirectory, world: World, *targets: int) -> Motion:
    """Plans through target sensations, from a configuration of the first; keeps the plan.

    Raises:
        RunError: there is no such target sensation, or nothing was learned.
        ValueError: there is no way.
    """
    pilot = Pilot(load_agent(run), world)
    _require_targets(run, targets)
    motion = pilot.plan(*targets).motion
    save_plan(run, motion, *targets)
    return motion


def plan_from(run: RunDirectory, world: World, q_start: np.ndarray, goal: int) -> Motion:
    """Plans from any `(J,)` configuration, touching or not; keeps the plan as `free-GOAL`.

    Raises:
        RunError: there is no such target sensation, or nothing was learned.
        ValueError: `q_start` is no configuration within the limits, or there is no way.
    """
    pilot = Pilot(load_agent(run), world)
    _require_targets(run, (0, goal))
    motion = pilot.plan_from(q_start, goal).motion
    save_plan(run, motion, "free", goal)
    return motion


def execute(run: RunDirectory, world: World, *targets: int | str) -> Try:
    """Executes a stored plan in the dynamic world, and keeps what was felt beside it.

    Args:
        run: a run that has planned.
        world: its world.
        targets: of the plan, in order; `"free", GOAL` for one of `plan_from`.

    Returns:
        What the agent makes of it.

    Raises:
        RunError: there is no such target sensation, or no such plan.
    """
    pilot = Pilot(load_agent(run, predicts=False), world)
    _require_targets(run, targets)
    execution, _ = pilot.execute(load_motion(run, *targets))
    save_plan(run, execution, *targets)
    return pilot.agent.judge(execution)


def rehearse(run: RunDirectory, world: World, start: int, goal: int, max_tries: int) -> list[Try]:
    """Plans and executes until contact is never lost, and remembers for every later plan.

    Returns:
        The tries, in order; the best is kept.
    """
    pilot = Pilot(load_agent(run), world)
    _require_targets(run, (start, goal))
    tries = pilot.rehearse(start, goal, max_tries=max_tries)
    save_plan(run, best(tries).execution, start, goal)
    save_memory(run, pilot.agent.memory)
    return tries


def evaluate(run: RunDirectory, world: World, progress: Progress = silent) -> None:
    """Scores what was learned against the truth, and random plans as felt in the world.

    Raises:
        StoreError: the truth is not there, or only in part.
    """
    agent = load_agent(run)
    require_complete(run.experiment, run.path, fingerprint=run.fingerprint(), truth=True)
    run.metrics()  # what cannot be added to is refused now
    body = load_body(run, agent.representation)
    progress(0.0, "against the truth")
    run.add_metrics(score_body(run, world, agent.representation, body))
    trials = try_pairs(
        run, world, agent, lambda fraction, doing: progress(0.1 + 0.9 * fraction, doing)
    )
    if trials:
        save_arrays(run.trials, trial_table(trials) | run.stamp())
    run.add_metrics(trial_figures(trials, world.robot.turns))
    progress(1.0, "evaluated")


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
    return ("execution_num_pairs" if wanted else "coverage_evenness") in run.metrics()


def _require_targets(run: RunDirectory, targets: Sequence[int | str]) -> None:
    """Refuses target sensations that a run does not have."""
    num_targets = run.experiment.representation.num_targets
    names = ("--from", "--to") if len(targets) == 2 else ("--through",) * len(targets)
    for name, target in zip(names, targets, strict=True):
        if isinstance(target, int) and not 0 <= target < num_targets:
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
    require_complete(run.experiment, run.path, fingerprint=run.fingerprint())
