"""The command that teaches an agent the body of a robot, by a person's hand or by itself."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from selftouch_drake.cli.stages import progress_bar

if TYPE_CHECKING:
    import numpy as np

    from selftouch_drake.run.streams import Stream
    from selftouch_drake.run.teaching import Look

# Seconds between looks at a file that grows.
_EVERY_S = 2.0


@click.command()
@click.argument("source", metavar="SOURCE")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder of the lesson. A stopped lesson goes on.  [default: runs/NAME, as SOURCE]",
)
@click.option(
    "--touches",
    type=click.IntRange(min=40),
    default=1500,
    show_default=True,
    help="Touches after which the lesson ends, whatever is known.",
)
@click.option(
    "--wait",
    "patience_s",
    type=click.FloatRange(min=0.0),
    help="Seconds without a new line after which the lesson ends.  [default: wait on]",
)
@click.option("--urdf", type=click.Path(path_type=Path), help="Write the body that was found.")
@click.option("--q", metavar="COLUMNS", help="Joint positions, as in `selftouch import`.")
@click.option("--sensation", metavar="COLUMNS", help="Readings of the skin, likewise.")
@click.option("--time", metavar="COLUMN", help="Times, likewise.")
@click.option("--offset", type=float, help="Reading of a receptor at rest, likewise.")
@click.option("--threshold", type=float, help="Smallest reading that counts, likewise.")
@click.option(
    "--filter",
    "filtering",
    type=click.Choice(["none", "median"]),
    help="Against spikes, likewise; none if the skin has none: the first touches look like them.",
)
def teach(
    source: str,
    out: Path | None,
    touches: int,
    patience_s: float | None,
    urdf: Path | None,
    **how: Any,
) -> None:
    """Teach the body of a robot, touch by touch.

    SOURCE is a CSV file that another program writes while you move the robot by hand, or a class in
    a Python file: a body that moves itself, as `selftouch body` tries it, or a callback, with
    `joint_names` and a method `read(steps)` that returns new joint positions `(n, J)` and raw
    readings `(n, S)`, or None at the end. A body keeps its own limits of joints and force.

    Terminal and page say what is known and what to do next: which joints to move, and which
    receptors to touch. Take your time, touch gently, and touch the same places with several
    postures. Rest in between, so that most receptors rest in most rows. Of several limbs move one
    at a time, and hold the others still for ten touches: that tells which one touched.

    All lines are stored as they come. A stream that stops, lags or begins again loses nothing: give
    the same command again. When it is enough (touches that were left out agree with a body, every
    axis has a standard error below 3 degrees, nine of ten receptors were felt), the lesson ends and
    becomes a run.

    \b
    selftouch teach log.csv --q 'joint_*' --sensation 'taxel_*'
    selftouch teach my_robot.py:MyRobot --touches 600 --urdf mine.urdf
    """  # noqa: D301 - click keeps the lines after a \b as they are
    from selftouch_drake.run.teaching import Lesson, teach_and_learn

    if urdf is not None and urdf.suffix not in (".urdf", ".sdf", ".xml"):
        raise click.UsageError(f"--urdf is {urdf}; end it in .urdf, .sdf or .xml")
    given = {name: value for name, value in how.items() if value is not None}
    name = Path(source.rpartition(":")[2] if ".py:" in source else source).stem
    folder = out or Path("runs") / name
    opened = _open(source, given)
    lesson = Lesson(folder=folder, how=opened.how, most=touches, limits=opened.limits)
    page = folder / "lesson.html"
    click.echo(f"readings: {lesson.readings}\npage: {page}")
    if opened.grows and not Path(source).exists():
        click.echo(f"waiting for {source}, which is not there yet")
    with opened.closing, progress_bar("learn") as progress:
        last, run = teach_and_learn(
            lesson,
            opened.stream,
            lambda look: _say(look, page, name),
            progress,
            patience_s=float("inf") if patience_s is None else patience_s,
            every_s=_EVERY_S if opened.grows else None,
        )
    if last is None:
        raise click.UsageError(
            f"{lesson.readings} holds no touch; touch the robot's skin, or give --threshold"
        )
    if run is None:
        click.echo(f"not enough: {last.known.reason}")
        click.echo("give the same command again to go on, with more --touches")
        return
    if urdf is not None:
        from selftouch_drake.run.exported import Known, export_model

        for line in export_model(run, (urdf,), Known(), rejected=False):
            click.echo(line)
    click.echo(f"run: {run.path}\nnext: selftouch model {run.path}")


class _Opened(NamedTuple):
    """A source: how it is read, what reads it, limits of joints, and whether it grows by itself."""

    how: dict[str, Any]
    stream: "Callable[[bytes], Stream]"
    limits: "np.ndarray | None"
    closing: AbstractContextManager
    grows: bool = False


def _open(source: str, given: dict[str, Any]) -> _Opened:
    """Opens a CSV, a body or a callback.

    Raises:
        ValueError: there is no such class, or it does not do what it must.
    """
    from selftouch_drake.bodies.class_of_file import load_class, make_instance, split_reference
    from selftouch_drake.bodies.own import open_reference
    from selftouch_drake.run.streams import Callback, GrowingFile, MovingBody
    from selftouch_drake.run.teaching import columns_of

    reference = split_reference(source)
    if reference is None:
        path = Path(source)
        if path.suffix not in (".csv", ".tsv", ".txt"):
            raise click.UsageError(
                f"SOURCE is {source!r}; give a .csv that grows, or a class as my_robot.py:MyRobot"
            )
        return _Opened(given, lambda stored: GrowingFile(path, stored), None, nullcontext(), True)
    for option in ("q", "sensation", "time"):
        if option in given:
            raise click.UsageError(f"--{option} is given, but {source} is no CSV; leave it out")
    kind = load_class(*reference)
    if hasattr(kind, "read") and not hasattr(kind, "feel"):
        teacher = make_instance(kind, {})
        names = list(teacher.joint_names)
        return _Opened(
            given | columns_of(names),
            lambda stored: Callback(teacher.read, names, bool(stored)),
            None,
            nullcontext(),
        )
    import numpy as np

    body = open_reference(source)
    return _Opened(
        given | columns_of(body.joint_names),
        lambda stored: MovingBody(body, stored.count(b"\n"), bool(stored)),
        np.stack([body.lower, body.upper]),
        body,
    )


def _say(look: "Look", page: Path, title: str) -> None:
    """Prints what is known and what to do next, and writes the page."""
    from selftouch_drake.show.lesson_page import state_line, write_page

    write_page(page, title, look.known, look.steps)
    click.echo(state_line(look.known))
    for step in look.steps:
        click.echo(f"  next: {step.text}")
