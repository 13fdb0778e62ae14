"""Running a sweep: each run is a directory of its own, and shared stages are computed once."""

import hashlib
import os
import shutil
import warnings
from collections import defaultdict, deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import yaml
from threadpoolctl import threadpool_limits

from selftouch_drake.experiment import Experiment, dump_experiment
from selftouch_drake.files import locked, write_text_whole, written_whole
from selftouch_drake.run import stages
from selftouch_drake.run.directory import Inside, RunDirectory, RunError
from selftouch_drake.run.executors import InTurn
from selftouch_drake.run.metrics import keys_of
from selftouch_drake.sweep.design import Sweep

_HEADER = "# A sweep of selftouch_drake, format 1\n"


class RunWarning(UserWarning):
    """A warning of one run of a sweep; the text begins with the run's name."""


@dataclass(frozen=True, slots=True)
class SweepDirectory:
    """Where a sweep keeps its runs, its table and its figures."""

    path: Path

    table = Inside("table.parquet", "All metrics of all runs.")
    figures = Inside("figures", "Pictures.")

    @staticmethod
    def create(path: Path, sweep: Sweep) -> "SweepDirectory":
        """Begins or resumes a sweep; existing runs are kept.

        Raises:
            RunError: the folder is not empty, and is not a sweep of that name.
        """
        header = f"{_HEADER}name: {sweep.name}\n"
        file = path / "sweep.yaml"
        if file.is_file():
            if not file.read_bytes().startswith(header.encode()):
                raise RunError(f"{path} belongs to another sweep; choose another --out")
        elif path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise RunError(f"{path} is neither a sweep nor empty; choose another --out")
        path.mkdir(parents=True, exist_ok=True)
        names = [run_name(experiment) for experiment in sweep.experiments]
        content = {"fields": list(sweep.fields), "runs": names}
        write_text_whole(file, header + yaml.safe_dump(content, sort_keys=False))
        return SweepDirectory(path)

    def writing(self) -> AbstractContextManager[None]:
        """Locks the sweep for one writer, as `locked`; a RunError refuses a second one."""
        reason = "is being run by another process; wait for it, or choose another --out"
        return locked(self.path, RunError(f"{self.path} {reason}"))

    def run(self, experiment: Experiment) -> RunDirectory:
        """The run of an experiment, whether it exists or not."""
        return RunDirectory(self.path.resolve() / "runs" / run_name(experiment), experiment)


def run_name(experiment: Experiment) -> str:
    """The name of a run in its sweep: the experiment's, its seed, and a digest of all fields."""
    digest = hashlib.sha256(dump_experiment(experiment).encode()).hexdigest()[:8]
    word = "".join(c if c.isalnum() else "_" for c in experiment.name)[:40]
    return f"{word}-s{experiment.seed}-{digest}"


def run_sweep(
    sweep: Sweep,
    directory: "SweepDirectory",
    executor: Executor,
    progress: Callable[[float, str], None] = stages.silent,
    *,
    num_pending: int = 8,
) -> dict[str, str]:
    """Runs the missing parts of a sweep.

    Runs that share their experience share its files, as hard links where the disk has them; so do
    those that share what is learned. The workers of the executor must see the directory; of
    `num_pending` jobs at a time, twice their number keep them busy.

    Returns:
        The reason for each run that failed by a mistake of its own, by the run's name.

    Warns:
        RunWarning: what the stages of a run warn of, with the name of the run.

    Raises:
        ChildProcessError: a process of the executor was killed.
    """
    ready = deque(_jobs(sweep, directory))
    failed: dict[str, str] = {}
    pending: dict[Future, _Job] = {}
    num_done = 0
    num_jobs = len(ready) + sum(len(job.then) for job in ready) + len(sweep.experiments)
    try:
        while ready or pending:
            while ready and len(pending) < num_pending:
                job = ready.popleft()
                runs = [run for run in job.runs if run.path.name not in failed]
                pending[executor.submit(_do, job.stage, runs)] = job
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                job = pending.pop(future)
                fallen, warned = future.result()
                failed |= fallen
                for text in warned:
                    warnings.warn(text, RunWarning, stacklevel=2)
                num_done += 1
                progress(num_done / num_jobs, f"{job.stage} {job.runs[0].path.name}")
                # Unfinished runs go first: a sweep that is cut short has some whole runs, not many
                # half ones.
                ready.extendleft(reversed(job.then))
    except BrokenExecutor:
        raise ChildProcessError(
            "a process of the sweep was killed, perhaps because memory ran out; repeat the command "
            "with fewer --workers: it continues from the finished stages"
        ) from None
    finally:
        for future in pending:
            future.cancel()
    return failed


@dataclass(frozen=True, slots=True)
class _Job:
    """One stage for runs that share it, and the jobs that follow; the first run does the work."""

    stage: str
    runs: list[RunDirectory]
    then: "list[_Job]"


def _jobs(sweep: Sweep, directory: "SweepDirectory") -> "list[_Job]":
    """Babbling for all runs that share it, then learning from it, then evaluation."""
    groups: dict[str, dict[str, list[RunDirectory]]] = defaultdict(lambda: defaultdict(list))
    for experiment in sweep.experiments:
        run = directory.run(experiment)
        groups[run.fingerprint()][run.learning_fingerprint()].append(run)
    jobs = []
    for learners in groups.values():
        then = [
            _Job("learn", runs, [_Job("evaluate", [run], []) for run in runs])
            for runs in learners.values()
        ]
        jobs.append(_Job("babble", [run for runs in learners.values() for run in runs], then))
    return jobs


def _do(stage: str, runs: list[RunDirectory]) -> tuple[dict[str, str], list[str]]:
    """Runs a stage for the first of `runs`, and shares it with the others.

    Returns:
        The reason by the name of each run that failed, and warnings that begin with a run's name.
    """
    failed: dict[str, str] = {}
    if not runs:
        return failed, []
    # Runs are many and cores are few: one thread each.
    with threadpool_limits(1), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            _once(stage, [RunDirectory.create(run.path, run.experiment) for run in runs])
        except ValueError as error:
            failed = {run.path.name: " ".join(str(error).split()) for run in runs}
    # Warnings of other packages are for developers.
    ours = [one for one in caught if one.category.__module__.startswith("selftouch_drake.")]
    return failed, [f"{runs[0].path.name}: {one.message}" for one in ours]


def _once(stage: str, runs: list[RunDirectory]) -> None:
    """Does what one of the runs has done already, or the first does, for all of them."""
    done = {
        "babble": stages.has_babbled,
        "learn": _has_learned,
        "evaluate": stages.has_evaluated,
    }[stage]
    donor = next((run for run in runs if done(run)), runs[0])
    if not done(donor):
        with donor.writing():
            if stage == "babble":
                stages.babble(donor, InTurn())
            else:
                getattr(stages, stage)(donor)
    made = [donor.representation, donor.topology, donor.body_distances]
    if stage == "babble":
        shards = (p for folder in ("truth", "experience") for p in (donor.path / folder).iterdir())
        made = [*sorted(shards), donor.skin]
        made += [donor.joints] if donor.joints.exists() else []  # older runs have none
    for run in runs:
        if run is not donor and not done(run):
            of_run = [donor.body_model] if stage == "learn" and _same_model(donor, run) else []
            _share(donor, run, made + of_run, stage)
            if stage == "learn" and not of_run:
                with run.writing():
                    stages.learn(run)  # the representation is there: only the body model is made


def _same_model(one: RunDirectory, other: RunDirectory) -> bool:
    """Whether two runs that share a representation share the body model too."""
    models = [run.experiment.representation.body_model for run in (one, other)]
    return models[0] == models[1]


def _has_learned(run: RunDirectory) -> bool:
    return stages.has_learned(run) and stages.has_modelled(run)


def _share(donor: RunDirectory, run: RunDirectory, files: list[Path], stage: str) -> None:
    """Gives `run` the files of a stage, then its metrics, which mark the stage as done."""
    with run.writing():
        for file in files:
            there = run.path / file.relative_to(donor.path)
            there.parent.mkdir(exist_ok=True)
            there.unlink(missing_ok=True)
            try:
                os.link(file, there)
            except OSError:  # a disk without hard links
                with written_whole(there) as aside:
                    shutil.copyfile(file, aside)
        made = keys_of(stage)
        run.add_metrics({key: value for key, value in donor.metrics().items() if key in made})
