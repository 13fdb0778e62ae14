"""Commands that show: what is shipped, a robot, a body, an agent that moves or lives."""

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from selftouch_drake.cli.opening import (
    begin,
    is_run,
    load,
    open_to_write,
    require_something_to_show,
)
from selftouch_drake.cli.options import (
    BODY,
    EXPERIMENT,
    PORT,
    RUN,
    SET,
    WORKERS,
    of_an_experiment,
)
from selftouch_drake.cli.stages import babble_with_bar, progress_bar

if TYPE_CHECKING:
    from selftouch_drake.bodies.checked import CheckedBody
    from selftouch_drake.run.directory import RunDirectory


@click.command()
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
    directory = _begin_or_open(**given)

    from selftouch_drake.run import lifelong, stages
    from selftouch_drake.run.executors import local_executor
    from selftouch_drake.run.worlds import with_user_body

    with with_user_body(directory, body) if body else nullcontext():
        if not (no_page or directory.experiment.has_truth):
            click.echo(
                "selftouch: no page: it needs a robot that Drake simulates, and this run has none",
                err=True,
            )
            no_page = True
        if not (stages.has_babbled(directory) or directory.experiment.imported):
            with local_executor(workers) as executor:
                babble_with_bar(directory, executor, None)
        if no_page:
            with progress_bar("live") as progress:
                lifelong.live(directory, progress=progress, num_more=touches if body else 0)
        else:
            from selftouch_drake.show.meshcat.live_page import shown_page
            from selftouch_drake.show.meshcat.pages import LIFE_FIT, LifePage

            name = f"{directory.experiment.name}, live"
            with shown_page(name, port, click.echo, **LIFE_FIT) as meshcat:
                lifelong.live(directory, LifePage(meshcat))
    for line in lifelong.growth_lines(directory):
        click.echo(line)
    click.echo(f"life: {directory.life}; `selftouch report {directory.path}` draws it")


@click.command()
@RUN
@PORT
def play(run: Path, port: int | None) -> None:
    """Watch the agent of RUN move, and choose what it feels next.

    RUN is a run directory that has learned.

    Open the printed address in a browser. End with the button on the page or with Ctrl-C.
    """
    from selftouch_drake.run.directory import RunDirectory

    directory = RunDirectory.open(run)
    require_something_to_show(directory, "play")

    from selftouch_drake.show.outputs import play as show

    show(directory, port=port, announce=click.echo)


@click.command()
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

    if is_run(experiment):
        experiment = str(Path(experiment) / "experiment.yaml")
    loaded, _ = load(experiment, overrides)
    world = build_world(loaded)
    click.echo(describe(world))
    if show:
        from selftouch_drake.show.meshcat.pages import show_robot

        show_robot(world, announce=click.echo)


@click.command()
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
    from selftouch_drake.bodies.trying import try_body

    with _open_body(body, overrides) as opened:
        for line in try_body(opened, postures):
            click.echo(line)


@click.command()
@click.option("--show", metavar="NAME", help="Print an experiment, as a start for your own.")
def experiments(show: str | None) -> None:
    """List the shipped experiments and sweeps."""
    if show is None:
        _list_shipped()
    else:
        _print_experiment(show)


def _begin_or_open(experiment: str, out: Path | None, overrides: dict[str, Any]) -> "RunDirectory":
    """Opens a run, or begins the run of an experiment."""
    if not is_run(experiment):
        return begin(experiment, out, overrides)
    if out or overrides:
        raise click.UsageError(f"{experiment} is a run: leave --out and --set out")
    return open_to_write(Path(experiment))


def _open_body(body: str, overrides: dict[str, Any]) -> "CheckedBody":
    """Opens the body that a class in a file is, or that an experiment names."""
    from selftouch_drake.bodies.class_of_file import split_reference
    from selftouch_drake.bodies.own import open_body, open_reference

    if split_reference(body) is not None:
        return open_reference(body)
    loaded, _ = load(body, overrides)
    if loaded.body_from == "robot":
        raise click.UsageError(
            f"{body} has a robot that Drake simulates: check it with `selftouch robot {body}`"
        )
    return open_body(loaded)


def _list_shipped() -> None:
    """Prints name and summary of each shipped experiment and sweep."""
    from selftouch_drake.resources import EXPERIMENTS, SWEEPS, shipped, summary

    titles = {
        "Experiments (selftouch run NAME)": EXPERIMENTS,
        "Sweeps (selftouch sweep NAME)": SWEEPS,
    }
    for title, folder in titles.items():
        click.echo(title)
        for name in shipped(folder):
            click.echo(f"  {name:<25} {summary(folder / f'{name}.yaml')}")


def _print_experiment(name: str) -> None:
    """Prints the YAML file of a shipped experiment."""
    from selftouch_drake.experiment import closest
    from selftouch_drake.resources import EXPERIMENTS, shipped

    names = shipped(EXPERIMENTS)
    if name not in names:
        hint = closest(name, names) or f"choose one of {', '.join(names)}"
        raise click.UsageError(f"--show is {name!r}; this experiment is not shipped: {hint}")
    click.echo((EXPERIMENTS / f"{name}.yaml").read_text(encoding="utf-8"), nl=False)
