"""Collecting experience: random walks, kept where they touch."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, as_completed
from functools import lru_cache
from pathlib import Path
from threading import Lock

import numpy as np
import yaml

from selftouch_drake.experience.sources import DynamicSource, KinematicSource, Source
from selftouch_drake.experience.store import (
    Shard,
    StoreError,
    read_num_steps,
    shard_name,
    write_shard,
)
from selftouch_drake.experience.walk import RandomWalk
from selftouch_drake.experiment import Experiment, dump_experiment, experiment_from_fields
from selftouch_drake.geometry import ARM_REACH, build_body
from selftouch_drake.robot.joints import remembered
from selftouch_drake.robot.kinematics import FingertipKinematics
from selftouch_drake.run.directory import RunDirectory

# A walk that has touched nothing in so many steps is lost.
PATIENCE = 2_000_000
# Executors may run jobs in threads, as Dask's do, but a world serves one at a time.
_WORLD_LOCK = Lock()


class NeverTouchesError(ValueError):
    """The random walk does not find the body."""


def walk_sizes(experiment: Experiment) -> list[int]:
    """Kept configurations of each walk; they sum to `babbling.num_samples`."""
    size, total = experiment.babbling.walk_size, experiment.babbling.num_samples
    full, rest = divmod(total, size)
    return [size] * full + [rest] * (rest > 0)


def collect_walk(source: Source, experiment: Experiment, walk: int, num_rows: int) -> Shard:
    """Walks until `num_rows` configurations touched.

    Raises:
        NeverTouchesError: there was no touch in very many steps.
    """
    babbling, agent = experiment.babbling, source.agent
    source.begin(
        RandomWalk(
            lower=agent.lower,
            upper=agent.upper,
            step_size=babbling.step_size,
            persistence=babbling.persistence,
            seed=experiment.random_stream("walk", walk),
        )
    )
    kept_step, kept_q, kept_sensation = [], [], []
    num_kept = num_steps = last_touch = 0
    while num_kept < num_rows:
        q, sensation = source.next_steps()
        touching = np.flatnonzero(sensation.any(axis=1))[: num_rows - num_kept]
        kept_step.append(num_steps + touching)
        kept_q.append(q[touching])
        kept_sensation.append(sensation[touching].astype(np.float32))
        num_kept += len(touching)
        if len(touching):
            last_touch = num_steps + int(touching[-1])
        num_steps += len(q)
        if num_kept < num_rows and num_steps - last_touch >= PATIENCE:
            raise NeverTouchesError(
                f"babbling touched nothing in {num_steps - last_touch} steps; "
                f"make the body reachable ({ARM_REACH} m from the shoulder), "
                "or babbling.step_size larger"
            )
    step = np.concatenate(kept_step)
    q = np.concatenate(kept_q)
    p_WF = FingertipKinematics.of(agent).positions(q.astype(float))
    return Shard(
        walk=walk,
        num_steps=int(step[-1]) + 1,
        step=step,
        q=remembered(experiment, q),
        sensation=np.concatenate(kept_sensation),
        p_WF=p_WF.reshape(len(q), -1),
    )


def collect(
    run: RunDirectory,
    *,
    executor: Executor,
    progress: Callable[[int], None] = lambda num_rows: None,
) -> int:
    """Collects what is missing of the run's experience and returns the steps of all walks.

    Walks that are already stored are kept. Any executor gives the same bytes, in any order.

    Args:
        run: the run; its shards are written by the workers.
        executor: where the walks run; its workers must see the run directory.
        progress: called with the number of new rows whenever a walk is stored.

    Raises:
        ChildProcessError: a process of the executor was killed.
        NeverTouchesError: a walk does not find the body.
        StoreError: a stored shard is damaged, or of another experiment.
    """
    fingerprint = run.fingerprint()
    num_steps, futures = 0, {}
    text, folder = dump_experiment(run.experiment), str(run.path.resolve())
    try:
        for walk, num_rows in enumerate(walk_sizes(run.experiment)):
            known = read_num_steps(run.path, walk, num_rows=num_rows, fingerprint=fingerprint)
            if known is None or not (run.truth / shard_name(walk)).exists():
                job = executor.submit(_collect_and_store, text, folder, walk, num_rows, fingerprint)
                futures[job] = num_rows
            else:
                num_steps += known
                progress(num_rows)
        for job in as_completed(futures):
            num_steps += job.result()
            progress(futures[job])
    except BrokenExecutor:
        raise ChildProcessError(
            "a process that babbles was killed, perhaps for want of memory; go on from what is "
            "stored with the same command and fewer --workers"
        ) from None
    finally:
        for job in futures:
            job.cancel()
    return num_steps


def require_complete(run: RunDirectory, *, truth: bool = False) -> None:
    """Refuses experience, or its truth, of which a shard is missing, damaged or foreign.

    Raises:
        StoreError: naming the shard.
    """
    fingerprint, sizes = run.fingerprint(), walk_sizes(run.experiment)
    folder = run.truth if truth else run.experience
    for walk, num_rows in enumerate(sizes):
        known = read_num_steps(
            run.path, walk, num_rows=num_rows, fingerprint=fingerprint, folder=folder.name
        )
        if known is None:
            raise StoreError(
                f"{folder / shard_name(walk)} is missing; collect it again with "
                f"`selftouch babble {run.path / 'experiment.yaml'} --out {run.path}`"
            )
    if len(list(folder.glob("part-*.parquet"))) > len(sizes):
        raise StoreError(f"{folder} holds shards that are not of this run; remove them")


def _collect_and_store(text: str, run: str, walk: int, num_rows: int, fingerprint: str) -> int:
    with _WORLD_LOCK:
        experiment, source = _world(text)
        shard = collect_walk(source, experiment, walk, num_rows)
    write_shard(Path(run), shard, fingerprint=fingerprint)
    return shard.num_steps


@lru_cache(maxsize=1)
def _world(text: str) -> tuple[Experiment, Source]:
    """The world of an experiment, built once a process: Drake's diagrams cannot be pickled."""
    experiment = experiment_from_fields(yaml.safe_load(text))
    sources: dict[str, Callable[..., Source]] = {
        "kinematic": KinematicSource,
        "dynamic": DynamicSource,
    }
    return experiment, sources[experiment.babbling.mode](experiment, *build_body(experiment))
