"""Commands that make a run, whole or stage by stage, and many runs."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from selftouch_drake.cli.opening import begin, in_a_body, of_a_run
from selftouch_drake.cli.options import SCHEDULER, WORKERS, of_an_experiment
from selftouch_drake.cli.stages import babble_with_bar, learn_with_bar, progress_bar

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from selftouch_drake.run.directory import RunDirectory


@click.command()
@of_an_experiment
@WORKERS
@SCHEDULER
def run(workers: int | None, scheduler: str | None, **given: Any) -> None:
    """Do everything, from babbling to the report.

    EXPERIMENT is the name of a shipped experiment (see `selftouch experiments`; by default cube) or
    a YAML file. Finished stages are skipped: a stopped run resumes.
    """
    from selftouch_drake.run.executors import local_executor

    with local_executor(workers) as executor:
        directory = begin(**given, executor=executor)

        from selftouch_drake.run import stages
        from selftouch_drake.show.outputs import write_report

        if not stages.has_babbled(directory):
            babble_with_bar(directory, executor, scheduler)
            _draw_first_picture(directory)
        if not (stages.has_learned(directory) and stages.has_modelled(directory)):
            _get_ready_to_evaluate(directory, executor)
            learn_with_bar(directory, scheduler)
        if not stages.has_evaluated(directory):
            with progress_bar("plan, execute, evaluate") as progress:
                stages.evaluate(directory, progress, executor)
        with progress_bar("report") as progress:
            report = write_report(directory, progress)
    _print_headline(directory)
    if directory.babbling.exists():
        click.echo(f"babbling: {directory.babbling}")
    click.echo(f"report: {report}")


@click.command()
@of_an_experiment
@WORKERS
@SCHEDULER
def babble(workers: int | None, scheduler: str | None, **given: Any) -> None:
    """Walk at random through motor space and keep every touch.

    EXPERIMENT is the name of a shipped experiment (by default cube) or a YAML file.
    """
    from selftouch_drake.run.executors import local_executor

    directory = begin(**given)
    with local_executor(workers) as executor:
        babble_with_bar(directory, executor, scheduler)
    click.echo(f"experience: {directory.experience}")


@click.command()
@of_a_run
@click.option(
    "--add",
    is_flag=True,
    help="Learn also from touches that a body of your own met in practice, execution and life.",
)
@SCHEDULER
def learn(directory: "RunDirectory", add: bool, scheduler: str | None) -> None:
    """Learn the quotient graph, recover the body and model it.

    Reads the touches of the run directory RUN, never the truth (where the robot was touched). If
    only the body model is missing, only that is made.
    """
    from selftouch_drake.run.worlds import add_met

    if add:
        click.echo(f"added so far: {add_met(directory):,} touches that a body of your own met")
    learn_with_bar(directory, scheduler)
    click.echo(f"representation: {directory.representation}")


@click.command()
@of_a_run
@in_a_body
@WORKERS
def evaluate(directory: "RunDirectory", workers: int | None) -> None:
    """Score the recovered shape and random plans.

    Compares the run directory RUN with the truth, which the agent never sees.
    """
    from selftouch_drake.run import stages
    from selftouch_drake.run.executors import local_executor

    if click.get_current_context().params["body"] is not None:
        workers = 1  # a body that is given is in one process
    with progress_bar("evaluate") as progress, local_executor(workers) as executor:
        stages.evaluate(directory, progress, executor)
    _print_headline(directory)


@click.command()
@of_a_run
@click.option("--vector", is_flag=True, help="Also write the figures as PDF, for papers.")
def report(directory: "RunDirectory", vector: bool) -> None:
    """Draw the figures of RUN and write its report.

    RUN is a run directory. The report is RUN/report.html.
    """
    from selftouch_drake.show.outputs import write_report

    with progress_bar("report") as progress:
        path = write_report(directory, progress, vector=vector)
    click.echo(f"report: {path}")


@click.command()
@click.argument("sweep", metavar="SWEEP")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder of the sweep. A stopped sweep resumes.  [default: runs/sweeps/NAME]",
)
@WORKERS
@SCHEDULER
def sweep(sweep: str, out: Path | None, workers: int | None, scheduler: str | None) -> None:
    """Run many experiments and compare them.

    SWEEP is the name of a shipped sweep (see `selftouch experiments`) or a YAML file, as in
    `{experiments: [cube], seeds: [0, 1, 2], grid: {skins.body.num_receptors: [50, 100]}}`.
    Runs that share an experience or a representation compute it once.
    """
    from selftouch_drake.run.executors import dask_executor, local_executor
    from selftouch_drake.sweep.design import load_sweep
    from selftouch_drake.sweep.directory import SweepDirectory
    from selftouch_drake.sweep.figures import draw_sweep_figures
    from selftouch_drake.sweep.runs import run_sweep
    from selftouch_drake.sweep.table import gather

    loaded = load_sweep(sweep)
    num_runs = len(loaded.experiments)
    directory = SweepDirectory.create(out or Path("runs") / "sweeps" / loaded.name, loaded)
    chosen = dask_executor(scheduler) if scheduler else local_executor(workers)
    num_pending = num_runs if scheduler else 2 * (workers or os.cpu_count() or 1)
    with directory.writing():
        with progress_bar(f"{num_runs} runs") as progress, chosen as executor:
            failed = run_sweep(loaded, directory, executor, progress, num_pending=num_pending)
        table = gather(loaded, directory, failed)
        draw_sweep_figures(table, directory.figures)
    for name, reason in failed.items():
        click.echo(f"failed: {name}: {reason}", err=True)
    click.echo(f"table: {directory.table}\nfigures: {directory.figures}")


def _draw_first_picture(directory: "RunDirectory") -> None:
    """Draws the figures that need no more than experience, and prints where they are."""
    from selftouch_drake.show.outputs import write_figures

    for picture in write_figures(directory).values():
        if isinstance(picture, Path):
            click.echo(f"first picture: {picture}")


def _get_ready_to_evaluate(directory: "RunDirectory", executor: "Executor") -> None:
    """Lets a worker build the bodies that evaluation needs while this process learns."""
    from selftouch_drake.run import stages
    from selftouch_drake.run.executors import InTurn

    if directory.experiment.has_truth and not isinstance(executor, InTurn):
        executor.submit(stages.compile_for_evaluation, directory)


def _print_headline(directory: "RunDirectory") -> None:
    """Prints the metrics of a run that matter most, those of its motions, and its body model."""
    from rich.console import Console
    from rich.table import Table

    from selftouch_drake.run.artifacts import load_body_model
    from selftouch_drake.run.metrics import MOTION_COLUMNS, motions, tiles
    from selftouch_drake.run.model_text import headline, is_off

    found = directory.metrics()
    console = Console()
    table = Table("metric", "value", title=directory.experiment.name, title_justify="left")
    for tile in tiles(found):
        table.add_row(tile.name, tile.value)
    console.print(table)
    if rows := motions(found):
        table = Table(*MOTION_COLUMNS)
        for row in rows:
            table.add_row(row.name, *row.cells)
        console.print(table)
    model = load_body_model(directory)
    click.echo(f"body model: {headline(model)}")
    if not is_off(model):
        click.echo(f"its joints: selftouch model {directory.path}")
