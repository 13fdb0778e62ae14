"""Running a sweep: each run is a directory of its own, and shared stages are computed once."""

import warnings
from collections import defaultdict, deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass

from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.sweep.design import Sweep
from selftouch_drake.sweep.directory import SweepDirectory
from selftouch_drake.sweep.sharing import do_stage


class RunWarning(UserWarning):
    """A warning of one run of a sweep; the text begins with the run's name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Job:
    """One stage for runs that share it, and the jobs that follow.

    Attributes:
        stage: its name.
        runs: the first does the work.
        then: jobs that can begin when this one has ended.
    """

    stage: str
    runs: list[RunDirectory]
    then: "list[_Job]"

    def size(self) -> int:
        """The number of jobs, with all that follow."""
        return 1 + sum(job.size() for job in self.then)


def run_sweep(
    sweep: Sweep,
    directory: SweepDirectory,
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
    num_jobs = sum(job.size() for job in ready)
    num_done = 0
    failed: dict[str, str] = {}
    pending: dict[Future, _Job] = {}
    try:
        while ready or pending:
            while ready and len(pending) < num_pending:
                job = ready.popleft()
                runs = [run for run in job.runs if run.path.name not in failed]
                pending[executor.submit(do_stage, job.stage, runs)] = job
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                job = pending.pop(future)
                outcome = future.result()
                failed |= outcome.failed
                for text in outcome.warned:
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


def _jobs(sweep: Sweep, directory: SweepDirectory) -> list[_Job]:
    """Babbling for all runs that share it, then learning from it, then evaluation."""
    # By what decides the experience, then by what decides what is learned from it.
    groups: dict[str, dict[str, list[RunDirectory]]] = defaultdict(lambda: defaultdict(list))
    for experiment in sweep.experiments:
        run = directory.run(experiment)
        groups[run.fingerprint()][run.learning_fingerprint()].append(run)
    return [_babbling_job(list(by_learning.values())) for by_learning in groups.values()]


def _babbling_job(learners: list[list[RunDirectory]]) -> _Job:
    """Babbling for runs in groups, each of which shares what is learned."""
    return _Job(
        stage="babble",
        runs=[run for runs in learners for run in runs],
        then=[_learning_job(runs) for runs in learners],
    )


def _learning_job(runs: list[RunDirectory]) -> _Job:
    evaluations = [_Job(stage="evaluate", runs=[run], then=[]) for run in runs]
    return _Job(stage="learn", runs=runs, then=evaluations)
