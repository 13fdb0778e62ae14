"""Stages of a run with a progress bar, here or on the workers of a Dask scheduler."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from selftouch_drake.run.directory import RunDirectory


@contextmanager
def progress_bar(stage: str) -> Iterator[Callable[[float, str], None]]:
    """Shows a progress bar on stderr, with the fraction done and the current task."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.fields[stage]:<24}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=Console(stderr=True)) as bar:
        # Hidden until the first report, so that an early error prints one line only.
        task = bar.add_task("", total=1.0, stage=stage, visible=False)

        def report(fraction: float, doing: str) -> None:
            bar.update(task, completed=fraction, description=doing, visible=True)

        yield report


def babble_with_bar(directory: "RunDirectory", executor: "Executor", scheduler: str | None) -> None:
    """Babbles on the workers of the scheduler, if its address is given, or of the executor."""
    from selftouch_drake.run import stages
    from selftouch_drake.run.executors import dask_executor

    chosen = dask_executor(scheduler) if scheduler else nullcontext(executor)
    with progress_bar("babble") as progress, chosen as workers:
        progress(0.0, "the first walks")  # under dynamics these take minutes
        stages.babble(directory, workers, progress)


def learn_with_bar(directory: "RunDirectory", scheduler: str | None) -> None:
    """Learns on the workers of the scheduler, if its address is given, or in this process."""
    from selftouch_drake.run import stages
    from selftouch_drake.run.executors import dask_executor

    chosen = dask_executor(scheduler) if scheduler else nullcontext()
    with progress_bar("learn") as progress, chosen as workers:
        stages.learn(directory, progress, workers)
