"""Collects experience: random walks, and keeps their touching configurations."""

from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor
from functools import partial
from pathlib import Path
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from selftouch_drake.agent.body import Body, Felt
from selftouch_drake.experience.store import (
    Contacts,
    Shard,
    StoreError,
    WalkCounts,
    read_counts,
    shard_name,
    shards_of,
    write_shard,
)
from selftouch_drake.experience.walk import Joints, RandomWalk, Walker, strides, walk_range
from selftouch_drake.experiment import Experiment
from selftouch_drake.files import remove_unfinished

# A walk without a touch in this many steps is given up.
PATIENCE = 2_000_000

#: Number of touches in a first round of the active strategy, in the kinematic world and under
#: dynamics, where each round begins at rest.
_FIRST_ROUND = {"kinematic": 50, "dynamic": 250}

#: Number of touches in a later round, as a share of all so far.
_ROUND_GROWS = 0.1


@runtime_checkable
class BabblingBody(Protocol):
    """A body that leads itself along the random walks of its experiment."""

    def babble(self, walk: int) -> Callable[[], Felt]:
        """Begins a walk by its number; each call of what is returned goes on, and feels."""
        ...


class NeverTouchesError(ValueError):
    """The random walk touches no skin."""


def walk_sizes(experiment: Experiment) -> list[int]:
    """Number of touches to keep of each walk; they sum to `babbling.num_samples`.

    A walk ends where the body changes. With the active strategy a walk is one round, during which
    the agent learns nothing new; rounds grow with the experience.
    """
    size, total = experiment.babbling.walk_size, experiment.babbling.num_samples
    active = experiment.babbling.strategy == "active"
    first = _FIRST_ROUND[experiment.babbling.mode]
    moments = {change.after for change in experiment.changes if 0 < change.after < total}
    sizes, done = list[int](), 0
    for end in (*sorted(moments), total):
        while done < end:
            grown = max(first, int(_ROUND_GROWS * done)) if active else size
            sizes.append(min(grown, size, end - done))
            done += sizes[-1]
    return sizes


def random_walk(experiment: Experiment, body: Joints, walk: int) -> RandomWalk:
    """Walk number `walk` of an experiment, in the range in which its body babbles."""
    babbling, (lower, upper) = experiment.babbling, walk_range(body)
    return RandomWalk(
        lower=lower,
        upper=upper,
        step_size=strides(body, babbling.step_size),
        persistence=babbling.persistence,
        seed=experiment.random_stream("walk", walk),
    )


def walker_of(experiment: Experiment, body: Body) -> Walker:
    """Leads the body of an experiment."""
    babbling = experiment.babbling
    return Walker(body, timed=babbling.mode == "dynamic", step_duration=babbling.step_duration)


def collect_walk(
    body: Body, experiment: Experiment, walk: int, num_rows: int, most_s: float = np.inf
) -> Shard:
    """Walks until `num_rows` touching configurations that the body can take are found.

    After `most_s` s of the body's own time, the walk ends with what it has. A body that can
    `babble` leads itself along the same walk.

    Raises:
        NeverTouchesError: there was no touch in `PATIENCE` steps.
    """
    if isinstance(body, BabblingBody):
        next_steps = body.babble(walk)
    else:
        walker, path = walker_of(experiment, body), random_walk(experiment, body, walk)
        if walker.timed:
            walker.begin_at(path.steps(1)[0])

        def next_steps() -> Felt:
            return walker.walk(path.steps(walker.batch))

    try:
        return keep_touches(next_steps, body, walk, num_rows, most_s)
    except NeverTouchesError as error:
        # Thresholds of skins may be the reason as well.
        thresholds = "".join(
            f", or lower skins.{name}.reading.threshold, which is {skin.reading.threshold:g} N"
            for name, skin in experiment.skins.items()
            if skin.reading.threshold is not None
        )
        raise NeverTouchesError(f"{error}{thresholds}") from None


def keep_touches(
    next_steps: Callable[[], Felt], body: Body, walk: int, num_rows: int, most_s: float = np.inf
) -> Shard:
    """As `collect_walk`, of a walk whose `next_steps` move the body by some steps."""
    kept_step, kept_felt = [], list[Felt]()
    num_kept = num_steps = last_touch = num_impossible = 0
    began = robot_s(body)
    while num_kept < num_rows and robot_s(body) - began < most_s:
        felt = next_steps()
        touching, touches = felt.touches()
        possible = touches.reached
        num_wanted = num_rows - num_kept
        rows = np.flatnonzero(possible)[:num_wanted]
        kept = touching[rows]
        # A full walk ends with its last touch: what came after it does not count.
        considered = touching <= kept[-1] if len(kept) == num_wanted else np.True_
        num_impossible += int(np.sum(~possible & considered))
        kept_step.append(num_steps + kept)
        kept_felt.append(touches.of_rows(rows))
        num_kept += len(kept)
        if len(kept):
            last_touch = num_steps + int(kept[-1])
        num_steps += len(felt.q)
        if num_kept < num_rows and num_steps - last_touch >= PATIENCE:
            never_possible = 0 if num_kept else num_impossible
            raise _nothing_touched(num_steps - last_touch, touches, never_possible)
    if not num_kept:
        raise NeverTouchesError(
            f"babbling touched nothing in {robot_s(body) - began:.0f} s of the robot's time; give "
            "more babbling.robot_hours, or bring what touches nearer to the skin"
        )
    step = np.concatenate(kept_step)
    # Where a body has a truth, it comes with what was felt.
    contacts = [part.contacts for part in kept_felt if hasattr(part, "contacts")]
    return Shard(
        walk=walk,
        num_steps=int(step[-1]) + 1,
        num_impossible=num_impossible,
        step=step,
        q=np.concatenate([part.q for part in kept_felt]).astype(np.float32),
        sensation=np.concatenate([part.sensation for part in kept_felt]).astype(np.float32),
        contacts=Contacts.joined(contacts) if contacts else None,
        robot_s=robot_s(body) - began,
    )


def _nothing_touched(num_steps: int, touches: Felt, num_impossible: int) -> NeverTouchesError:
    """The error of a walk without a touch in so many steps, but for impossible ones."""
    of_drake = hasattr(touches, "contacts")
    how = "`selftouch robot EXPERIMENT --show`" if of_drake else "`selftouch body EXPERIMENT`"
    if num_impossible:
        return NeverTouchesError(
            f"babbling touched nothing in {num_steps} steps but in {num_impossible} postures that "
            f"the body cannot take, because parts of it run into each other; see which with {how}"
        )
    return NeverTouchesError(
        f"babbling touched nothing in {num_steps} steps; see what can touch what with {how}, or "
        "make babbling.step_size larger"
    )


def robot_s(body: Body) -> float:
    """s, time that a body has lived; 0 if it keeps no time of its own."""
    return float(getattr(body, "robot_s", 0.0))


def collect(
    experiment: Experiment,
    folder: Path,
    *,
    fingerprint: str,
    executor: Executor,
    body_of: Callable[[Experiment, str], Body],
    progress: Callable[[int], None] = lambda num_rows: None,
) -> WalkCounts:
    """Collects the missing random walks of a run and returns the number of steps of all walks.

    Walks that are already stored in the folder of the run are kept. Every executor gives the same
    bytes. Every shard carries the fingerprint; `body_of` makes the body of an experiment and a
    fingerprint, in whichever process walks; `progress` is called with the number of new rows each
    time a walk is stored.

    Raises:
        ChildProcessError: a process of the executor was killed.
        NeverTouchesError: a walk touches nothing.
        StoreError: a stored shard is damaged, or belongs to another experiment.
    """
    counts, missing = stored_walks(experiment, folder, fingerprint=fingerprint, progress=progress)
    store = partial(_collect_and_store, folder.resolve(), fingerprint, body_of)
    try:
        if experiment.babbling.robot_hours is None:
            for found in executor.map(store, missing):
                counts += found
                progress(found.num_rows)
        else:
            for walk in missing:
                if (left := time_left(experiment, counts)) <= 0:
                    break
                counts += (found := store(walk, left))
                progress(found.num_rows)
    except BrokenExecutor:
        raise ChildProcessError(
            "a babbling process was killed, perhaps because memory ran out; repeat the command "
            "with fewer --workers: it continues from the stored walks"
        ) from None
    for part in ("experience", "truth"):
        remove_unfinished(folder / part)
    return counts


def time_left(experiment: Experiment, counts: WalkCounts) -> float:
    """Seconds of the robot's own time that are left to babble, after walks that took `counts`."""
    hours = experiment.babbling.robot_hours
    return np.inf if hours is None else 3600.0 * hours - counts.robot_s


class Walk(NamedTuple):
    """A walk to be made: its number, its number of touches, and the experiment at that time."""

    number: int
    num_rows: int
    experiment: Experiment


def stored_walks(
    experiment: Experiment,
    folder: Path,
    *,
    fingerprint: str,
    progress: Callable[[int], None] = lambda num_rows: None,
) -> tuple[WalkCounts, list[Walk]]:
    """What the walks took that a run has stored, and the walks that are missing.

    Arguments and errors are those of `collect`.
    """
    counts, missing, first = WalkCounts(), list[Walk](), 0
    for number, num_rows, known in _walks(experiment, folder, fingerprint):
        truth = folder / "truth" / shard_name(number)
        if known is None or (experiment.has_truth and not truth.exists()):
            missing.append(Walk(number, num_rows, experiment.after(first)))
        else:
            counts += known
            progress(known.num_rows)
        first += num_rows
    return counts, missing


def _walks(
    experiment: Experiment, run: Path, fingerprint: str, folder: str = "experience"
) -> Iterator[tuple[int, int, WalkCounts | None]]:
    """Number and size of each walk until time is up, and what it took if it is stored."""
    counts, timed = WalkCounts(), experiment.babbling.robot_hours is not None
    for walk, num_rows in enumerate(walk_sizes(experiment)):
        if time_left(experiment, counts) <= 0:
            return
        known = read_counts(
            run, walk, num_rows=num_rows, fingerprint=fingerprint, folder=folder, or_fewer=timed
        )
        yield walk, num_rows, known
        counts += known or WalkCounts()


def how_to_collect(experiment: Experiment, folder: Path) -> str:
    """The command that collects the missing experience of a run."""
    if experiment.imported is not None:
        return f"selftouch import {experiment.imported.source} --out {folder}"
    return f"selftouch babble {folder / 'experiment.yaml'} --out {folder}"


def require_complete(
    experiment: Experiment, folder: Path, *, fingerprint: str, truth: bool = False
) -> None:
    """Checks that all shards of the experience, or of its truth, are present.

    Raises:
        StoreError: a shard is missing, damaged, or belongs to another experiment.
    """
    shards, num_walks = folder / ("truth" if truth else "experience"), 0
    for walk, _, known in _walks(experiment, folder, fingerprint, shards.name):
        if known is None:
            raise StoreError(
                f"{shards / shard_name(walk)} is missing; collect it again with "
                f"`{how_to_collect(experiment, folder)}`"
            )
        num_walks = walk + 1
    if len(shards_of(shards)) > num_walks:
        raise StoreError(
            f"{shards} holds more shards than the {num_walks} of this run; remove "
            f"{shard_name(num_walks)} and those after it"
        )


def _collect_and_store(
    folder: Path,
    fingerprint: str,
    body_of: Callable[[Experiment, str], Body],
    walk: Walk,
    most_s: float = np.inf,
) -> WalkCounts:
    body = body_of(walk.experiment, fingerprint)
    shard = collect_walk(body, walk.experiment, walk.number, walk.num_rows, most_s)
    write_shard(folder, shard, fingerprint=fingerprint)
    return shard.counts
