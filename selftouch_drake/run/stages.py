"""The stages of a run: babble, learn, plan, execute, rehearse, evaluate.

Each is a function of the run that reads and writes its directory; other packages compute. A stage
that runs again replaces what it made and drops what was made from it. A stage imports what it alone
needs, so that the others start sooner.
"""

import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body import Body
from selftouch_drake.agent.motions import Motion
from selftouch_drake.agent.planning.novelty import Recorded
from selftouch_drake.agent.planning.touch_model import TouchModel
from selftouch_drake.agent.representation.embedded import EmbeddedRepresentation
from selftouch_drake.agent.tries import Try, best, judged_try
from selftouch_drake.bodies.embodiment import World, bodies_of, pilot_in
from selftouch_drake.bodies.user_body import UserBody
from selftouch_drake.experience.collect import (
    NeverTouchesError,
    collect,
    how_to_collect,
    require_complete,
    robot_s,
)
from selftouch_drake.experience.store import WalkCounts
from selftouch_drake.files import load_arrays, save_arrays
from selftouch_drake.run.artifacts import (
    load_agent,
    load_body,
    load_body_model,
    load_motion,
    load_representation,
    save_learned,
    save_memory,
    save_plan,
    stored_sensations,
)
from selftouch_drake.run.directory import RunDirectory, RunError
from selftouch_drake.run.executors import SHARDS_AHEAD, InTurn, map_ahead
from selftouch_drake.run.naming import free_start
from selftouch_drake.run.touches import touch_metrics, warn_of_changes
from selftouch_drake.run.trials import trial_metrics, trial_table, try_pairs
from selftouch_drake.run.worlds import babbling_body, keep_bodies, make_world, run_bodies

# Touches and targets of a trial run of `evaluate`: enough to plan a step, and learned in a second.
_READY_TOUCHES, _READY_TARGETS = 1000, 50

# Share of the time of learning after which the body model begins, roughly.
_UNTIL_MODEL = 0.4

#: Called with the fraction of the stage that is done and what it is doing.
Progress = Callable[[float, str], None]


def silent(fraction: float, doing: str) -> None:
    """Reports progress to nobody."""


def babble(run: RunDirectory, executor: Executor, progress: Progress = silent) -> None:
    """Collects the experience of the run; stored walks are kept.

    Random walks are made by the executor. An agent that explores does so in this process, and so
    does a body that cannot be in two places.

    Raises:
        NeverTouchesError: nothing is touched; a run without a touch leaves nothing.

    Warns:
        NeverTouchedWarning: a skin was never touched, or a toucher never touched anything.
    """
    began = time.perf_counter()
    wall_before = run.metrics().get("babbling_wall_s", 0.0)
    bodies = run_bodies(run)
    if bodies.world is not None:
        _save_skin(run, bodies.world)
    elif isinstance(bodies, UserBody) and run.known_baseline() is None:
        progress(0.0, "readings at rest")
        run.keep_baseline(bodies.find_baseline(run.experiment))
    keep_bodies(run, bodies)
    _require_own_time(run, bodies.babbling)
    try:
        counts = _collected(run, bodies.babbling, executor, progress)
    except NeverTouchesError:
        run.discard()
        raise
    found: dict[str, Any] = {
        "babbling_num_samples": counts.num_rows,
        "babbling_num_steps": counts.num_steps,
        "babbling_touch_rate": counts.num_rows / counts.num_steps,
        "babbling_num_impossible": counts.num_impossible,
    }
    if counts.robot_s:
        found["babbling_robot_s"] = counts.robot_s
    found["babbling_wall_s"] = wall_before + time.perf_counter() - began
    if bodies.world is not None:
        found |= touch_metrics(run, bodies.world)
    run.add_metrics(found)


def _save_skin(run: RunDirectory, world: World) -> None:
    """Saves the surfaces of a robot's skins, and which of them each reading comes from."""
    arrays = {"receptor_skin": world.receptor_skin}
    for skin in world.skins:
        arrays[f"{skin.name}_vertices"] = skin.fields.vertices
        arrays[f"{skin.name}_faces"] = skin.fields.faces
        arrays[f"{skin.name}_p_LS"] = skin.fields.p_LS
    save_arrays(run.skin, arrays | run.body_stamp())


def _require_own_time(run: RunDirectory, body: Body) -> None:
    """Raises a `RunError` if babbling is to take hours of a body that keeps no time."""
    hours = run.experiment.babbling.robot_hours
    if hours is not None and not hasattr(body, "robot_s"):
        raise RunError(
            f"babbling.robot_hours is {hours:g}, but the body is set to its postures and keeps no "
            "time: leave it out, or give babbling.mode: dynamic"
        )


def _collected(run: RunDirectory, body: Body, executor: Executor, progress: Progress) -> WalkCounts:
    """Collects the missing experience of a run; returns what all of its walks took."""
    wanted, stored = run.experiment.babbling.num_samples, 0

    def count(num_rows: int) -> None:
        nonlocal stored
        stored += num_rows
        lived = robot_s(body)
        of_robot = f", {lived / 3600:.2f} h of the robot" if lived else ""
        progress(stored / wanted, f"{stored:,} of {wanted:,} touches{of_robot}")

    how: dict[str, Any] = {
        "fingerprint": run.fingerprint(),
        "progress": count,
        "body_of": partial(babbling_body, run),
    }
    if run.experiment.babbling.strategy == "active":
        # Other stages need not wait for its imports.
        from selftouch_drake.experience.exploration import Exploration, explore

        return explore(Exploration(run.experiment, body), run.path, **how)
    executor = executor if body.jumps else InTurn()
    return collect(run.experiment, run.path, executor=executor, **how)


def learn(
    run: RunDirectory, progress: Progress = silent, executor: Executor | None = None
) -> EmbeddedRepresentation:
    """Builds the quotient representation from the experience, recovers the body, and models it.

    If all but the body model is there, because an older version learned or learning was
    interrupted, only the model is made. The executor, whose processes see the run, reads the
    experience and takes the starts of the model's fit; by default this process does.

    Raises:
        RunError: the experience is not complete.
        ValueError: it cannot be learned from.

    Warns:
        ChangedBodyWarning: the body changed in the middle of the experience.
    """
    from selftouch_drake.run.modelling import find_model

    require_experience(run)
    warn_of_changes(run)
    share = 1.0 if run.experiment.representation.body_model == "off" else _UNTIL_MODEL
    representation = _without_model(run)
    if representation is None:
        representation = _learn_quotient(run, _part(progress, 0.0, share), executor)
    find_model(run, representation, progress=_part(progress, share, 1.0), executor=executor)
    progress(1.0, "learned")
    return representation


def _part(progress: Progress, start: float, end: float) -> Progress:
    """Reports the progress of a part of a stage, from one fraction of the stage to another."""
    return lambda fraction, doing: progress(start + (end - start) * fraction, doing)


def _without_model(run: RunDirectory) -> EmbeddedRepresentation | None:
    """The representation of a run that has learned everything but the body model; else None."""
    if not has_learned(run) or has_modelled(run):
        return None
    try:
        representation = load_representation(run)
        load_body(run, representation)
    except (ValueError, OSError):
        return None  # damaged, or of other settings: it is learned again
    # Touches that were added since must be learned from first.
    is_whole = representation.num_touches == run.touches().num_rows
    return representation if is_whole else None


def _learn_quotient(
    run: RunDirectory, progress: Progress, executor: Executor | None
) -> EmbeddedRepresentation:
    """Builds the quotient representation, and recovers the body from it (the paper)."""
    from selftouch_drake.agent.representation.learning import learn as learn_quotient
    from selftouch_drake.agent.shape.recovery import recover
    from selftouch_drake.run.scores import found_metrics

    began = time.perf_counter()
    settings, seed = run.experiment.representation, run.experiment.seed
    touches = run.touches()
    learned = learn_quotient(
        touches.stored if executor else touches.touches,
        num_targets=settings.num_targets,
        max_kernel_size=settings.max_kernel_size,
        seed=seed,
        progress=lambda fraction, doing: progress(0.6 * fraction, doing),
        each=partial(map_ahead, executor, SHARDS_AHEAD) if executor else map,
    )
    body = recover(
        learned.representation,
        settings.metric,
        seed=seed,
        progress=lambda fraction: progress(0.6 + 0.2 * fraction, "shape and holes"),
    )
    progress(0.8, "ways between touches")
    touch_model = TouchModel.learn(
        learned.representation,
        lambda: stored_sensations(run, learned.representation),
        seed=seed,
    )
    representation = body.embed(learned.representation)
    body.warn_of_misfit()
    save_learned(run, representation, body, touch_model)
    sizes = np.diff(representation.kernel_offsets)
    bridges = learned.bridges.tolist()
    run.add_metrics(
        {
            "representation_num_targets": representation.num_targets,
            "representation_num_set_aside": representation.num_set_aside,
            "kernel_size_min": int(sizes.min()),
            "kernel_size_median": float(np.median(sizes)),
            "kernel_size_max": int(sizes.max()),
            "graph_component_sizes": np.bincount(learned.component).tolist(),
            **({"graph_bridges": bridges} if bridges else {}),
            **found_metrics(run, representation, body),
            "learning_wall_s": time.perf_counter() - began,
        }
    )
    return representation


def compile_for_evaluation(run: RunDirectory) -> None:
    """Has an idle worker do all that `evaluate` needs in small, so that numba compiles it."""
    bodies = run_bodies(run)
    sensation, q = next(run.touches().touches())
    num_touches = min(len(q), _READY_TOUCHES)
    with suppress(ValueError), warnings.catch_warnings():  # there may be no way
        warnings.simplefilter("ignore")
        agent = Agent.learn(q[:num_touches], sensation[:num_touches], num_targets=_READY_TARGETS)
        pilot = pilot_in(bodies, agent, run.experiment)
        pilot.execute(pilot.plan(*agent.representation.edges[0].tolist()).motion)


def plan(run: RunDirectory, *targets: int, q_start: np.ndarray | None = None) -> Motion:
    """Plans through target sensations, from a configuration of the first; keeps the plan.

    From any `(J,)` `q_start`, touching or not, it plans to a single target; then the file of the
    plan names both.

    Raises:
        RunError: there is no such target sensation, or nothing was learned.
        ValueError: no plan exists, or `q_start` is not a configuration within the limits.
    """
    motion = _planned_in_body(run, *targets, q_start=q_start)
    if q_start is None:
        save_plan(run, motion, *targets)
    else:
        save_plan(run, motion, free_start(q_start), *targets)
    return motion


def planned(run: RunDirectory, *targets: int) -> Motion:
    """The motion that `plan` makes, or `plan_imported` where there is no body; keeps nothing."""
    if run.experiment.imported is not None and not bodies_of.knows(
        run.experiment.after(0), run.fingerprint()
    ):
        return _planned_imported(run, *targets)[0]
    return _planned_in_body(run, *targets)


def _planned_in_body(run: RunDirectory, *targets: int, q_start: np.ndarray | None = None) -> Motion:
    pilot = pilot_in(run_bodies(run), load_agent(run), run.experiment)
    _require_targets(run, targets)
    planned = pilot.plan(*targets) if q_start is None else pilot.plan_from(q_start, *targets)
    return planned.motion


def plan_imported(run: RunDirectory, *targets: int) -> tuple[Motion, float]:
    """Plans through target sensations of an imported run, as `plan`, in no body.

    The plan starts at the touch of the first target from which it strays least from what was
    recorded. Without a model of the robot, nobody knows whether its rigid parts run into each other
    on the way.

    Returns:
        The motion, and how far it strays; see `Recorded.novelty`.
    """
    motion, novelty = _planned_imported(run, *targets)
    save_plan(run, motion, *targets, plan_novelty=novelty)
    return motion, novelty


def _planned_imported(run: RunDirectory, *targets: int) -> tuple[Motion, float]:
    from selftouch_drake.run.imported import timed  # with all readers of recordings

    imported = run.experiment.imported
    assert imported is not None
    agent = load_agent(run, predicts=True)
    _require_targets(run, targets)
    free = load_arrays(run.free)["q"] if run.free.exists() else None
    recorded = Recorded(agent.representation, free)
    plan, *_ = recorded.surest(targets, agent.plan)
    return timed(agent, plan, imported), recorded.novelty(plan)


def execute(run: RunDirectory, *targets: int | str) -> Try:
    """Executes a stored plan in the agent's body, and saves the sensations with it.

    The targets name the plan, as in `load_motion`.

    Returns:
        The agent's own judgement of it.

    Raises:
        RunError: there is no such target sensation, or no such plan.
    """
    agent = load_agent(run)
    _require_targets(run, targets)
    pilot = pilot_in(run_bodies(run), agent, run.experiment)
    execution, _ = pilot.execute(load_motion(run, *targets))
    save_plan(run, execution, *targets)
    return judged_try(execution, agent.representation)


def rehearse(run: RunDirectory, start: int, goal: int, max_tries: int) -> list[Try]:
    """Plans and executes until contact is never lost, and remembers for every later plan.

    Returns:
        The tries, in order; the best is kept.
    """
    pilot = pilot_in(run_bodies(run), load_agent(run), run.experiment)
    _require_targets(run, (start, goal))
    tries = pilot.rehearse(start, goal, max_tries=max_tries)
    save_plan(run, best(tries).execution, start, goal)
    save_memory(run, pilot.agent.memory)
    return tries


def evaluate(
    run: RunDirectory, progress: Progress = silent, executor: Executor | None = None
) -> None:
    """Scores what was learned against the truth, and random plans by what is felt.

    The executor executes the plans; by default this process does, one after another.

    Raises:
        ChildProcessError: a process of the executor was killed.
        StoreError: the truth is missing or incomplete.
    """
    # Damaged files are refused before the long work.
    load_body(run, load_representation(run))
    load_body_model(run)
    if run.experiment.has_truth:
        require_complete(run.experiment, run.path, fingerprint=run.fingerprint(), truth=True)
    run.metrics()
    agent, bodies = load_agent(run, predicts=True), run_bodies(run)
    keep_bodies(run, bodies)
    executor = executor if executor and bodies.acting.jumps else InTurn()
    scores = None if bodies.world is None else executor.submit(_score_body, run)
    trials, without_way = try_pairs(
        run, bodies, agent, lambda fraction, doing: progress(0.9 * fraction, doing), executor
    )
    if scores is not None:
        progress(0.9, "against the truth")
        run.add_metrics(scores.result())
    if trials:
        save_arrays(run.trials, trial_table(trials) | run.stamp())
    run.add_metrics({"planning_num_without_way": len(without_way)} | trial_metrics(trials))
    progress(1.0, "evaluated")


def _score_body(run: RunDirectory) -> dict[str, Any]:
    from selftouch_drake.run.scores import score_body, score_model

    representation = load_representation(run)
    body, model, world = load_body(run, representation), load_body_model(run), make_world(run)
    return {
        **score_body(run, world, representation, body),
        **score_model(run, world, representation, model),
    }


def has_babbled(run: RunDirectory) -> bool:
    """Whether all of the run's experience is there."""
    found, babbling = run.metrics(), run.experiment.babbling
    hours, lived = babbling.robot_hours, found.get("babbling_robot_s", 0.0)
    done = found.get("babbling_num_samples") == babbling.num_samples
    return (done or (hours is not None and lived >= 3600.0 * hours)) and run.experience.is_dir()


def has_learned(run: RunDirectory) -> bool:
    """Whether `learn` has made the representation; the body model follows, see `has_modelled`."""
    made = (run.representation, run.topology, run.body_distances)
    return "learning_wall_s" in run.metrics() and all(path.exists() for path in made)


def has_modelled(run: RunDirectory) -> bool:
    """Whether a body model of this version is there, accepted or not."""
    try:
        load_body_model(run)
    except (ValueError, OSError):
        return False
    return True


def has_evaluated(run: RunDirectory) -> bool:
    """Whether `evaluate` has finished."""
    wanted = run.experiment.evaluation.num_pairs
    return ("execution_num_pairs" if wanted else "coverage_evenness") in run.metrics()


def _require_targets(run: RunDirectory, targets: Sequence[int | str]) -> None:
    """Refuses target sensations that a run does not have."""
    num_targets = run.experiment.representation.num_targets
    names = ["--from", "--to"] if len(targets) < 3 else ["--through"] * len(targets)
    for name, target in zip(names[-len(targets) :], targets, strict=True):
        if isinstance(target, int) and not 0 <= target < num_targets:
            raise RunError(
                f"{name} is {target}; this run has target sensations 0 to {num_targets - 1}"
            )


def require_experience(run: RunDirectory) -> None:
    """Refuses experience that is missing or incomplete."""
    if not has_babbled(run):
        what = "babbling" if run.experiment.imported is None else "the import"
        raise RunError(
            f"{run.path} is half-finished: {what} has not come to its end; "
            f"resume it with `{how_to_collect(run.experiment, run.path)}`"
        )
    require_complete(run.experiment, run.path, fingerprint=run.fingerprint())
