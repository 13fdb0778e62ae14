"""The command line: `selftouch run` does everything, and each stage is a command of its own.

Slow imports, above all Drake, happen where they are needed, after all checks that do not need them.
"""

import functools
import gc
import itertools
import json
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from selftouch_drake import __version__
from selftouch_drake.run.executors import InTurn, local_executor, one_line_warnings

if TYPE_CHECKING:
    from selftouch_drake.run.directory import RunDirectory


def _fields(ctx: click.Context, option: click.Parameter, text: str) -> dict[str, Any]:
    from selftouch_drake.experiment.loading import parse_fields

    return parse_fields(text)


def _numbers(kind: type) -> Callable[..., list | None]:
    """A reader of numbers that are separated by commas."""

    def read(ctx: click.Context, option: click.Parameter, text: str | None) -> list | None:
        try:
            return None if text is None else [kind(number) for number in text.split(",")]
        except ValueError:
            raise click.BadParameter(
                f"{text!r} is not a list of numbers; give one such as 3,50,120"
            ) from None

    return read


RUN = click.argument("run", metavar="RUN", type=click.Path(path_type=Path))
EXPERIMENT = click.argument("experiment", default="cube")
OUT = click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Run directory. An unfinished run of the same experiment resumes.  "
    "[default: runs/NAME, plus the changes of --set]",
)
SET = click.option(
    "--set",
    "overrides",
    default="{}",
    metavar="YAML",
    callback=_fields,
    help="Fields to change, as in '{babbling: {num_samples: 20000}}'.",
)
WORKERS = click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Number of processes.  [default: one per core]",
)
SCHEDULER = click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Address of a Dask scheduler whose workers do the work, tcp://host:port.",
)
PORT = click.option(
    "--port",
    type=click.IntRange(1024, 65535),
    help="Port of the page.  [default: the first free one]",
)
FROM = click.option(
    "--from", "start", type=int, help="Number of the target sensation to start from."
)
TO = click.option("--to", "goal", type=int, help="Number of the target sensation to reach.")
THROUGH = click.option(
    "--through",
    callback=_numbers(int),
    metavar="I,J,...",
    help="Target sensations to visit in this order, instead of --from and --to.",
)
FROM_Q = click.option(
    "--from-q",
    "q_start",
    callback=_numbers(float),
    metavar="Q1,Q2,...",
    help="Joint positions to start from, in rad or m, touching or not; instead of --from.",
)


BODY = click.option(
    "--body",
    metavar="FILE:CLASS",
    help="Body of your own for the agent, as in my_robot.py:MyRobot; for imported runs.",
)


def of_an_experiment(command: Callable[..., None]) -> Callable[..., None]:
    """Adds the experiment of a run that begins, and the options that decide on it."""
    return EXPERIMENT(OUT(SET(command)))


def of_a_run(command: Callable[..., None]) -> Callable[..., None]:
    """Adds the run of a command that writes in it, as `directory`."""

    @functools.wraps(command)
    def opened(run: Path, **options: Any) -> None:
        from selftouch_drake.run.directory import RunDirectory

        directory = RunDirectory.open(run)
        click.get_current_context().with_resource(directory.writing())
        command(directory=directory, **options)

    return RUN(opened)


def of_a_plan(command: Callable[..., None]) -> Callable[..., None]:
    """Adds the run, and the targets that name one of its plans, as `directory` and `targets`."""

    @functools.wraps(command)
    def named(
        directory: "RunDirectory",
        start: int | None,
        q_start: list[float] | None,
        goal: int | None,
        through: list[int] | None,
        **options: Any,
    ) -> None:
        from selftouch_drake.run.naming import free_start

        begins = [start is not None, q_start is not None, through is not None]
        if sum(begins) != 1 or (goal is None) != (through is not None):
            raise click.UsageError(
                "start or goal is missing, or given twice; give --from and --to, or --from-q and "
                "--to, or --through alone"
            )
        if through is not None and len(through) < 2:
            raise click.UsageError(
                f"--through is {through[0]}; give at least two target sensations"
            )
        targets: list = through or [free_start(q_start) if q_start else start, goal]
        command(directory, targets, **options)

    return of_a_run(FROM(FROM_Q(TO(THROUGH(named)))))


def in_a_body(command: Callable[..., None]) -> Callable[..., None]:
    """Adds the body in which a run lives that has none of Drake's, and keeps what it meets."""

    @functools.wraps(command)
    def living(directory: "RunDirectory", *given: Any, body: str | None, **options: Any) -> None:
        from selftouch_drake.run.worlds import living_in

        with living_in(directory, body):
            command(directory, *given, **options)

    return BODY(living)


class InOrderOfUse(click.Group):
    """Lists the commands in the usual order of use."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Returns the commands in the order of their definition."""
        return list(self.commands)


@click.group(
    cls=InOrderOfUse,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, prog_name="selftouch")
@click.pass_context
def cli(ctx: click.Context) -> None:
    """An agent finds out, by touching itself, that it has a body.

    The agent moves a robot at random and remembers what it felt at which joint positions. From that
    alone it builds a graph of its sensations. The graph shows the shape of its body, and the agent
    plans on it from any sensation to any other.

    \b
    selftouch run cube                        do everything, into runs/cube
    selftouch run torus --out runs/my_torus   another body, a run directory of your choice
    selftouch run cube --set '{seed: 1}'      a variant, into runs/cube-seed=1
    selftouch plan runs/cube --from 3 --to 250
    selftouch execute runs/cube --from 3 --to 250
    selftouch play runs/cube                  watch it live in a browser
    selftouch robot two_arms                  its joints, skins, and what touches what
    selftouch body my_robot.py:MyRobot        try a body of your own
    selftouch import recording.npz            data recorded by another robot
    selftouch map recording.npz               where its receptors are
    """  # noqa: D301 - click keeps the lines after a \b as they are
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


@cli.command()
@of_an_experiment
@WORKERS
@SCHEDULER
def run(workers: int | None, scheduler: str | None, **given: Any) -> None:
    """Do everything, from babbling to the report.

    EXPERIMENT is the name of a shipped experiment (see `selftouch experiments`; by default cube) or
    a YAML file. Finished stages are skipped: a stopped run resumes.
    """
    with local_executor(workers) as executor:
        directory = _begin(**given, executor=executor)

        from selftouch_drake.run import stages
        from selftouch_drake.show.outputs import write_figures, write_report

        if not stages.has_babbled(directory):
            _babble(directory, executor, scheduler)
            for picture in write_figures(directory).values():
                if isinstance(picture, Path):
                    click.echo(f"first picture: {picture}")
        if not stages.has_learned(directory):
            if directory.experiment.has_truth and not isinstance(executor, InTurn):
                executor.submit(stages.get_ready, directory)
            _learn(directory, scheduler)
        if not stages.has_evaluated(directory):
            with _progress("plan, execute, evaluate") as progress:
                stages.evaluate(directory, progress, executor)
        with _progress("report") as progress:
            report = write_report(directory, progress)
    _print_headline(directory)
    if directory.babbling.exists():
        click.echo(f"babbling: {directory.babbling}")
    click.echo(f"report: {report}")


@cli.command()
@of_an_experiment
@WORKERS
@SCHEDULER
def babble(workers: int | None, scheduler: str | None, **given: Any) -> None:
    """Walk at random through motor space and keep every touch.

    EXPERIMENT is the name of a shipped experiment (by default cube) or a YAML file.
    """
    directory = _begin(**given)

    with local_executor(workers) as executor:
        _babble(directory, executor, scheduler)
    click.echo(f"experience: {directory.experience}")


@cli.command("import")
@click.argument("data", metavar="DATA", type=click.Path(path_type=Path))
@OUT
@click.option(
    "--q",
    metavar="COLUMNS",
    help="Joint positions: a column of arrays, or a pattern such as 'joint_*' for one column per "
    "joint.",
)
@click.option("--sensation", metavar="COLUMNS", help="Readings of the skin, likewise.")
@click.option("--time", metavar="COLUMN", help="Seconds, to compute the speeds of the joints.")
@click.option(
    "--rows",
    metavar="COLUMN=VALUE",
    multiple=True,
    help="Import only rows with this value, or one of several with commas between them.",
)
@click.option("--delimiter", help="Between the columns of CSV.  [default: as in the first line]")
@click.option(
    "--offset",
    type=float,
    help="Reading of a receptor at rest; 0 for pressures.  [default: estimated]",
)
@click.option(
    "--threshold", type=float, help="Smallest reading above rest that counts.  [default: estimated]"
)
@click.option(
    "--rising/--falling",
    default=None,
    help="Whether readings rise with pressure.  [default: estimated]",
)
@click.option(
    "--filter",
    "filtering",
    type=click.Choice(["none", "median"]),
    help="Median of three rows against spikes.  [default: where there are spikes]",
)
@click.option(
    "--max-velocity", type=float, help="Limit of plans, rad/s or m/s.  [default: as recorded, or 1]"
)
@click.option(
    "--max-acceleration",
    type=float,
    help="Limit of plans, rad/s² or m/s².  [default: 5 times the velocity]",
)
@SET
def import_data(
    data: Path,
    out: Path | None,
    max_velocity: float | None,
    max_acceleration: float | None,
    overrides: dict[str, Any],
    **how: Any,
) -> None:
    """Begin a run with data recorded by another robot.

    DATA is a Parquet, CSV or NPZ file, or a folder of them, with joint positions and raw readings
    of the skin in each row. `learn`, `plan`, `live` and `report` work on such a run; `execute` and
    `evaluate` need a body of your own, with --body.
    """
    from selftouch_drake.run import imported
    from selftouch_drake.run.directory import RunDirectory
    from selftouch_drake.run.naming import default_path

    read = imported.read_data(data, **how)
    experiment = imported.imported_experiment(
        read, overrides=overrides, max_velocity=max_velocity, max_acceleration=max_acceleration
    )
    directory = RunDirectory.create(out or default_path(experiment.name, overrides), experiment)
    with directory.writing():
        imported.store(directory, read)
    for line in imported.summary(read, experiment):
        click.echo(line)
    click.echo(f"run: {directory.path}")


@cli.command("map")
@click.argument("source", metavar="FILE_OR_RUN", type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), help="Folder for map.csv and map.png.  [default: RUN]"
)
@click.option("--q", metavar="COLUMNS", help="Joint positions, as in `selftouch import`.")
@click.option("--sensation", metavar="COLUMNS", help="Readings of the skin, likewise.")
@click.option("--rows", metavar="COLUMN=VALUE", multiple=True, help="Rows to read, likewise.")
@click.option("--offset", type=float, help="Reading of a receptor at rest, likewise.")
@click.option("--threshold", type=float, help="Smallest reading that counts, likewise.")
@click.option(
    "--touches",
    type=click.IntRange(min=20),
    default=1000,
    show_default=True,
    help="Most touches to take, evenly over all.",
)
def map_command(source: Path, out: Path | None, touches: int, **how: Any) -> None:
    """Find where the receptors are, from few touches.

    FILE_OR_RUN is a run directory, or data as `selftouch import` reads. Only which receptors feel a
    touch counts, not how strongly. Give readings of one skin: two skins that touch each other are
    taken for one.
    """
    from selftouch_drake.agent.shape.receptor_map import map_receptors
    from selftouch_drake.run.receptor_map import read_touches, summary, write_map
    from selftouch_drake.show.receptor_map import draw_map

    given = {name: value for name, value in how.items() if value not in (None, ())}
    q, sensation, names = read_touches(source, touches, given)
    with _progress("map") as progress:
        found = map_receptors(
            q, sensation, names, progress=lambda done: progress(done, "receptors")
        )
    folder = out or (source if source.is_dir() else source.with_suffix(""))
    write_map(folder / "map.csv", found, names)
    draw_map(found, folder / "map.png")
    for line in summary(found):
        click.echo(line)
    click.echo(f"map: {folder / 'map.csv'}\npicture: {folder / 'map.png'}")


@cli.command()
@RUN
@click.option("--robot", type=click.Path(path_type=Path), required=True, help="Its model file.")
@click.option("--link", required=True, help="The link of the model that wears the skin.")
@click.option("--frame", required=True, help="The frame of the model that touches.")
@click.option(
    "--radius",
    type=click.FloatRange(min=0.0),
    default=0.01,
    show_default=True,
    help="Radius of what touches, a ball, in m.",
)
@click.option(
    "--receptors",
    callback=_numbers(int),
    metavar="FIRST,LAST",
    help="The receptors on the link.  [default: all]",
)
def calibrate(
    run: Path, robot: Path, link: str, frame: str, radius: float, receptors: list[int] | None
) -> None:
    """Find receptors in metres, and joint offsets.

    Needs a model of the robot, and so is no part of the naive agent. Touches should be gentle.
    """
    from selftouch_drake.run.calibrated import calibrate_run

    for line in calibrate_run(run, robot, link, frame, radius, receptors):
        click.echo(line)


@cli.command()
@of_a_run
@click.option(
    "--add",
    is_flag=True,
    help="Learn also from touches that a body of your own met in practice, execution and life.",
)
@SCHEDULER
def learn(directory: "RunDirectory", add: bool, scheduler: str | None) -> None:
    """Learn the quotient graph and recover the body.

    Reads the touches of the run directory RUN, never the truth (where the robot was touched).
    """
    from selftouch_drake.run.worlds import add_met

    if add:
        click.echo(f"added: {add_met(directory):,} touches so far")
    _learn(directory, scheduler)
    click.echo(f"representation: {directory.representation}")


@cli.command()
@of_a_plan
@in_a_body
def plan(directory: "RunDirectory", targets: list) -> None:
    """Plan a smooth motion from one sensation to another.

    RUN is a run directory that has learned. The report of the run has a map of the numbers.
    """
    import numpy as np

    from selftouch_drake.run import stages

    given = click.get_current_context().params
    q_start = given["q_start"]
    blind = directory.experiment.imported is not None and given["body"] is None
    if blind:
        if q_start is not None:
            raise click.UsageError(
                f"--from-q needs a body, and {directory.path} was imported: give --body, or "
                "--from, the target sensation felt at the start"
            )
        motion, novelty = stages.plan_imported(directory, *targets)
        click.echo(
            f"novelty: {novelty:.1f} (1 is the usual distance between recorded touches; the "
            "higher, the less is known about the way)"
        )
    elif q_start is None:
        motion = stages.plan(directory, *targets)
    else:
        motion = stages.plan(directory, targets[-1], q_start=np.array(q_start))
    click.echo(f"route: {_route(motion)}\nduration: {motion.time_s[-1]:.2f} s")
    click.echo(f"plan: {directory.plan(*targets)}")
    if directory.experiment.imported is not None:
        click.echo(f"joint trajectory: {directory.plan(*targets).with_suffix('.csv')}")


@cli.command()
@of_a_plan
@click.option(
    "--rehearse",
    "max_tries",
    type=click.IntRange(min=1),
    metavar="N",
    help="Plan and execute up to N times until contact is never lost; remember what failed.",
)
@in_a_body
def execute(directory: "RunDirectory", targets: list, max_tries: int | None) -> None:
    """Execute a plan under full dynamics and store the sensations.

    RUN is a run directory. Make the plan first, with `selftouch plan` and the same options.
    """
    given = click.get_current_context().params
    if max_tries is not None and given["start"] is None:
        option = "--from-q" if given["q_start"] else "--through"
        raise click.UsageError(f"--rehearse is given with {option}; use --from and --to instead")

    from selftouch_drake.agent.rehearsal import best
    from selftouch_drake.run import stages

    if max_tries is None:
        kept = stages.execute(directory, *targets)
    else:
        tries = stages.rehearse(directory, targets[0], targets[1], max_tries)
        kept = best(tries)
        click.echo("tries: " + ", ".join(f"{one.contact:.1%}" for one in tries))
    click.echo(f"tracking: {_tracking(kept.execution, stages.run_bodies(directory).world)}")
    click.echo(f"in contact: {kept.contact:.1%} of the time")
    click.echo(f"sensation {targets[-1]}: {'reached' if kept.reached else 'missed'}")
    click.echo(f"plan: {directory.plan(*targets)}")


@cli.command()
@of_a_plan
def record(directory: "RunDirectory", targets: list) -> None:
    """Record an executed plan as a 3D page.

    The HTML page is written beside the plan in the run directory RUN, and needs no network. The
    report has a recording of its own.
    """
    from selftouch_drake.show.outputs import write_recording

    path = write_recording(directory, *targets, path=directory.plan(*targets).with_suffix(".html"))
    click.echo(f"recording: {path}")


@cli.command()
@of_a_run
@in_a_body
@WORKERS
def evaluate(directory: "RunDirectory", workers: int | None) -> None:
    """Score the recovered shape and random plans.

    Compares the run directory RUN with the truth, which the agent never sees.
    """
    from selftouch_drake.run import stages

    if click.get_current_context().params["body"] is not None:
        workers = 1  # a body that is given is in one process
    with _progress("evaluate") as progress, local_executor(workers) as executor:
        stages.evaluate(directory, progress, executor)
    _print_headline(directory)


@cli.command()
@click.argument("file", metavar="FILE", type=click.Path(path_type=Path))
@click.option(
    "--recording", metavar="NAME_OR_PATH", required=True, help="As in torus_1, or a file."
)
@click.option("--json", "as_json", is_flag=True, help="Print the metrics as JSON.")
def score(file: Path, recording: str, as_json: bool) -> None:
    """Score what any other method makes of a recording.

    FILE is an .npz archive with one of `touch_places` (a row for each touch), `receptor_places` and
    `distances`, and if you like `rows`, `parts` and `plans`. The figures are those of `evaluate`.
    """
    from selftouch_drake.run.judged import judge

    found = judge(file, recording)
    if as_json:
        click.echo(json.dumps(found, indent=2))
    else:
        from rich.console import Console
        from rich.table import Table

        from selftouch_drake.run.metrics import readings

        table = Table("metric", "value", "target")
        for reading in itertools.chain(*readings(found).values()):
            table.add_row(reading.name, reading.value, reading.metric.target)
        Console().print(table)


@cli.command()
@of_a_run
@click.option("--vector", is_flag=True, help="Also write the figures as PDF, for papers.")
def report(directory: "RunDirectory", vector: bool) -> None:
    """Draw the figures of RUN and write its report.

    RUN is a run directory. The report is RUN/report.html.
    """
    from selftouch_drake.show.outputs import write_report

    with _progress("report") as progress:
        path = write_report(directory, progress, vector=vector)
    click.echo(f"report: {path}")


@cli.command()
@of_an_experiment
@WORKERS
@PORT
@click.option("--no-page", is_flag=True, help="Show no page; only store the curves for the report.")
@BODY
@click.option(
    "--touches",
    type=click.IntRange(min=1),
    default=2000,
    show_default=True,
    help="Number of touches that the agent then collects in the body that --body gives.",
)
def live(
    workers: int | None,
    port: int | None,
    no_page: bool,
    body: str | None,
    touches: int,
    **given: Any,
) -> None:
    """Watch an agent learn from its first touch on.

    EXPERIMENT is the name of a shipped experiment (by default cube), a YAML file or a run.

    The page shows the robot, and beside it the body that the agent knows so far. The robot babbles
    as in `selftouch run`. Then the agent learns from its touches one after another, notices if its
    body changes, and corrects what it knows. The report shows its life as curves. End with the
    button on the page or with Ctrl-C. In an imported run the agent lives through the recording,
    and then explores the body that --body gives.
    """
    from selftouch_drake.run.directory import RunDirectory

    experiment = given["experiment"]
    if not _is_run(experiment):
        directory = _begin(**given)
    elif given["out"] or given["overrides"]:
        raise click.UsageError(f"{experiment} is a run: leave --out and --set out")
    else:
        directory = RunDirectory.open(Path(experiment))
        click.get_current_context().with_resource(directory.writing())

    from selftouch_drake.run import lifelong, stages
    from selftouch_drake.run.worlds import living_in

    with living_in(directory, body) if body else nullcontext():
        if not (no_page or directory.experiment.has_truth):
            click.echo("selftouch: the page needs a robot of Drake's: going on without", err=True)
            no_page = True
        if not (stages.has_babbled(directory) or directory.experiment.imported):
            with local_executor(workers) as executor:
                _babble(directory, executor, None)
        if no_page:
            with _progress("live") as progress:
                lifelong.live(directory, progress=progress, num_more=touches if body else 0)
        else:
            from selftouch_drake.show.meshcat.pages import LifePage
            from selftouch_drake.show.meshcat.stage import shown_page

            with shown_page("live", port, click.echo) as meshcat:
                lifelong.live(directory, LifePage(meshcat))
    click.echo(f"life: {directory.life}; `selftouch report {directory.path}` draws it")


@cli.command()
@RUN
@PORT
def play(run: Path, port: int | None) -> None:
    """Watch the agent of RUN move, and choose what it feels next.

    RUN is a run directory that has learned.

    Open the printed address in a browser. End with the button on the page or with Ctrl-C.
    """
    from selftouch_drake.run.directory import RunDirectory

    directory = RunDirectory.open(run)

    from selftouch_drake.show.outputs import play as show

    show(directory, port=port, announce=click.echo)


@cli.command()
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
    from selftouch_drake.run.executors import dask_executor
    from selftouch_drake.sweep.design import load_sweep
    from selftouch_drake.sweep.runs import SweepDirectory, run_sweep
    from selftouch_drake.sweep.table import draw_figures, gather

    loaded = load_sweep(sweep)
    directory = SweepDirectory.create(out or Path("runs") / "sweeps" / loaded.name, loaded)
    chosen = dask_executor(scheduler) if scheduler else local_executor(workers)
    num_pending = len(loaded.experiments) if scheduler else 2 * (workers or os.cpu_count() or 1)
    with directory.writing():
        with _progress(f"{len(loaded.experiments)} runs") as progress, chosen as executor:
            failed = run_sweep(loaded, directory, executor, progress, num_pending=num_pending)
        table = gather(loaded, directory, failed)
        draw_figures(table, directory.figures)
    for name, reason in failed.items():
        click.echo(f"failed: {name}: {reason}", err=True)
    click.echo(f"table: {directory.table}\nfigures: {directory.figures}")


@cli.command()
@EXPERIMENT
@SET
@click.option(
    "--show", is_flag=True, help="Show the robot in a browser, with a slider for each joint."
)
def robot(experiment: str, overrides: dict[str, Any], show: bool) -> None:
    """Print joints, skins, and what touches what.

    EXPERIMENT is the name of a shipped experiment (by default cube), a YAML file or a run.
    """
    from selftouch_drake.bodies.embodiment import build_world
    from selftouch_drake.robot.describe import describe

    if _is_run(experiment):
        experiment = str(Path(experiment) / "experiment.yaml")
    world = build_world(_load(experiment, overrides)[0])
    click.echo(describe(world))
    if show:
        from selftouch_drake.show.meshcat.pages import show_robot

        show_robot(world, announce=click.echo)


@cli.command()
@click.argument("body", metavar="BODY")
@SET
@click.option(
    "--postures",
    type=click.IntRange(min=2),
    help="Number of postures to try.  [default: 500, or 20 if it travels]",
)
def body(body: str, overrides: dict[str, Any], postures: int | None) -> None:
    """Try a body of your own: move it, and say what is wrong.

    BODY is a class in a file, as in my_robot.py:MyRobot, or an experiment whose body comes from
    `python` or `gymnasium`. A body that travels goes to the middle of its limits first, and on from
    there in small steps.
    """
    from selftouch_drake.bodies.own import open_body, open_reference, split_reference
    from selftouch_drake.bodies.trying import try_body

    if split_reference(body) is not None:
        opened = open_reference(body)
    else:
        loaded, _ = _load(body, overrides)
        if loaded.body_from == "robot":
            raise click.UsageError(f"{body} has a robot of Drake's: see `selftouch robot {body}`")
        opened = open_body(loaded)
    with opened:
        for line in try_body(opened, postures):
            click.echo(line)


@cli.command()
@click.option("--show", metavar="NAME", help="Print an experiment, as a start for your own.")
def experiments(show: str | None) -> None:
    """List the shipped experiments and sweeps."""
    from selftouch_drake.experiment import closest
    from selftouch_drake.resources import EXPERIMENTS, SWEEPS, shipped, summary

    names = shipped(EXPERIMENTS)
    if show is None:
        for title, folder in (
            ("Experiments (selftouch run NAME)", EXPERIMENTS),
            ("Sweeps (selftouch sweep NAME)", SWEEPS),
        ):
            click.echo(title)
            for name in shipped(folder):
                click.echo(f"  {name:<25} {summary(folder / f'{name}.yaml')}")
    elif show in names:
        click.echo((EXPERIMENTS / f"{show}.yaml").read_text(encoding="utf-8"), nl=False)
    else:
        hint = closest(show, names) or f"choose one of {', '.join(names)}"
        raise click.UsageError(f"--show is {show!r}; this experiment is not shipped: {hint}")


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line: exit 0 on success, 2 on a user's mistake, 130 on Ctrl-C."""
    # Modules that load are no garbage; looking for some in between takes a twentieth of a start.
    gc.set_threshold(50_000)
    sys.exit(exit_status(lambda: cli.main(arguments, prog_name="selftouch", standalone_mode=False)))


def exit_status(command: Callable[[], object]) -> int:
    """Runs `command`; turns a user's mistake into one line on stderr instead of a traceback.

    A warning of this package becomes one line too.
    """
    try:
        with warnings.catch_warnings():
            warnings.showwarning = one_line_warnings(warnings.showwarning)
            result = command()
        return result if isinstance(result, int) else 0
    except (KeyboardInterrupt, click.Abort):
        click.echo("selftouch: stopped; give the same command again to resume", err=True)
        return 130
    except click.ClickException as error:
        message = error.format_message()
    except (ValueError, OSError) as error:
        message = str(error)
    click.echo(f"selftouch: {' '.join(message.split())}", err=True)
    return 2


def _route(motion) -> str:
    """The target sensations of the route, and a line that explains each sign used."""
    words: list[str] = []
    before: list[int] = []
    for node, in_air in zip(motion.plan.nodes, [False, *motion.plan.in_air], strict=True):
        if before and node == before[-1]:
            continue  # the same sensation on a slide or a detour
        if in_air and before[-1] >= 0:
            words.append("| lifts off |")
        words.append("off" if node < 0 else f"{node}*" if node in before else str(node))
        before.append(node)
    signs = {"off": "nothing is felt there", "*": "felt again, in another posture"}
    used = [
        f"{s}: {text}"
        for s, text in signs.items()
        if any(w.lstrip("0123456789") == s for w in words)
    ]
    return "\n       ".join([" ".join(words), *used])


def _tracking(execution, world) -> str:
    import numpy as np

    off = execution.q_measured - execution.motion.q
    if world is None:  # the body has units of its own
        return f"{np.sqrt(np.square(off).mean()):.2g}"
    # Joints that have slipped do not read it.
    squares = np.square(off - world.slip)
    turns = world.robot.turns
    return ", ".join(
        f"{1e3 * np.sqrt(squares[:, joints].mean()):.1f} {unit}"
        for joints, unit in ((turns, "mrad"), (~turns, "mm"))
        if joints.any()
    )


def _load(experiment: str, overrides: dict[str, Any]):
    """Loads an experiment, and announces meshes that are converted for Drake."""
    from selftouch_drake.experiment import load_experiment
    from selftouch_drake.run.fingerprint import model_digests

    loaded = load_experiment(experiment, overrides)
    return loaded, model_digests(loaded, lambda line: click.echo(f"selftouch: {line}", err=True))


def _begin(
    experiment: str, out: Path | None, overrides: dict[str, Any], executor: Executor | None = None
) -> "RunDirectory":
    """Begins or resumes a run, prints its path, and builds its bodies.

    The workers of an executor get ready to babble.
    """
    from selftouch_drake.run.directory import RunDirectory
    from selftouch_drake.run.fingerprint import experience_fingerprint
    from selftouch_drake.run.naming import default_path

    loaded, digests = _load(experiment, overrides)
    path = out or default_path(loaded.name, overrides)
    if not (isinstance(executor, InTurn | None) or path.exists()):
        from selftouch_drake.bodies.embodiment import get_ready

        for number in range(2):
            fingerprint = experience_fingerprint(loaded, digests)
            executor.submit(get_ready, loaded.after(0), fingerprint, number)

    from selftouch_drake.bodies.embodiment import make_bodies
    from selftouch_drake.run.stages import keep_bodies

    bodies = make_bodies(loaded.after(0))  # errors appear before anything is written
    directory = RunDirectory.create(path, loaded)
    click.get_current_context().with_resource(directory.writing())
    keep_bodies(directory, bodies)
    click.echo(f"run: {directory.path}")
    return directory


def _is_run(experiment: str) -> bool:
    return (Path(experiment) / "experiment.yaml").is_file()


def _babble(directory, executor, scheduler: str | None) -> None:
    from selftouch_drake.run import stages

    with _progress("babble") as progress, _at(scheduler, executor) as where:
        progress(0.0, "the first walks")  # under dynamics these take minutes
        stages.babble(directory, where, progress)


def _learn(directory, scheduler: str | None) -> None:
    from selftouch_drake.run import stages

    with _progress("learn") as progress, _at(scheduler, None) as where:
        stages.learn(directory, progress, where)


def _at(scheduler: str | None, executor):
    """The workers of a scheduler, or else an executor, in a context."""
    from selftouch_drake.run.executors import dask_executor

    return dask_executor(scheduler) if scheduler else nullcontext(executor)


@contextmanager
def _progress(stage: str) -> Iterator[Callable[[float, str], None]]:
    """A progress bar on stderr, with the fraction done and the current task."""
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
        yield lambda fraction, doing: bar.update(
            task, completed=fraction, description=doing, visible=True
        )


def _print_headline(directory) -> None:
    from rich.console import Console
    from rich.table import Table

    from selftouch_drake.run.metrics import MOTION_COLUMNS, motions, tiles

    found, console = directory.metrics(), Console()
    table = Table("metric", "value", title=directory.experiment.name, title_justify="left")
    for tile in tiles(found):
        table.add_row(tile.name, tile.value)
    console.print(table)
    if rows := motions(found):
        table = Table(*MOTION_COLUMNS)
        for row in rows:
            table.add_row(row.name, *row.cells)
        console.print(table)


if __name__ == "__main__":
    main()
