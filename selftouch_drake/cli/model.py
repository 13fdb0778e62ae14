"""The command that shows the body model of a run, and takes it home as files."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from selftouch_drake.cli.options import RUN

if TYPE_CHECKING:
    from selftouch_drake.agent.body_model.model import BodyModel


# Columns of a table that goes into a file.
_WIDE = 160


@click.command()
@RUN
@click.option(
    "--urdf",
    "files",
    type=click.Path(path_type=Path, dir_okay=False),
    multiple=True,
    metavar="FILE",
    help="Write the body to FILE, as URDF; as SDFormat or MJCF if it ends in .sdf or .xml. May be "
    "given again.",
)
@click.option(
    "--length",
    type=(str, str, float),
    metavar="JOINT JOINT METRES",
    help="A known length: how far apart the axes of two joints are.",
)
@click.option(
    "--distance",
    type=(str, str, float),
    metavar="RECEPTOR RECEPTOR METRES",
    help="A known length: how far apart two receptors on one link are, in a straight line.",
)
@click.option(
    "--depth",
    type=float,
    metavar="METRES",
    help="How deep under the surface of the skin the centre of the toucher passes; negative if it "
    "stays outside, as that of a ball on a hard skin does.",
)
@click.option("--mirror", is_flag=True, help="Write the mirror image.")
@click.option("--rejected", is_flag=True, help="Write parts that were rejected as well.")
def model(
    run: Path,
    files: tuple[Path, ...],
    length: tuple[str, str, float] | None,
    distance: tuple[str, str, float] | None,
    depth: float | None,
    mirror: bool,
    rejected: bool,
) -> None:
    """Print the joints that the agent found, or export its body.

    RUN is a run directory that has learned.

    The agent asks one question of its touches: could it be that each of my joints turns or slides
    something rigid? If so, all touches that feel alike put one point of what touches on one point
    of the skin, and the axes of the joints, their order and the places of the receptors follow. It
    tests the answer on touches that it did not learn from, part by part, and rejects it where they
    disagree.

    \b
    kind            turns, slides, or turns or slides: too little of its range was seen
    axis            direction, where all joints read 0, in a frame of the agent's own
    per reading     how far it moves when its reading grows by 1, with a standard error
    order           the joint that carries it; the agent chooses the base itself
    standard error  of the direction
    open            what touches do not tell
    held-out        touches that lie nearer to their own kernel than kernels to each other;
                    a part is accepted above 85 %

    A run begun with `--set '{representation: {body_model: off}}'` does not ask.

    With --urdf the model is written as a robot for Drake, MuJoCo, PyBullet and others, and nothing
    else is printed. Touch tells no length: give one, or the unit is arbitrary. It does not tell a
    body from its mirror image either: if the robot in the file is the wrong one, give --mirror.

    \b
    selftouch model runs/cube --urdf cube.urdf --length shoulder_pitch elbow_pitch 0.4
    selftouch model runs/cube --urdf cube.xml --urdf cube.sdf --distance body[3] body[40] 0.25

    \b
    FILE                  links part_0, ... wear skin; toucher_0, ... are where it is touched from
    STEM_joints.csv       reading q of the robot is scale * q + offset in FILE, with limits there,
                          from experience, and the standard error of the scale
    STEM_receptors.csv    place, normal and standard error of each receptor, on its part
    STEM_part_0.obj       the surface of a part; .stl and .ply hold the same
    STEM_experiment.yaml  an experiment with this robot, if length and depth are given
    """  # noqa: D301 - click keeps the lines after a \b as they are
    from selftouch_drake.run.artifacts import load_body_model
    from selftouch_drake.run.directory import RunDirectory

    opened = RunDirectory.open(run)
    if not files:
        given = {
            "--length": length is not None,
            "--distance": distance is not None,
            "--depth": depth is not None,
            "--mirror": mirror,
            "--rejected": rejected,
        }
        for option in (name for name, is_given in given.items() if is_given):
            raise click.UsageError(f"{option} is given without --urdf; name the file to write")
        _print_model(load_body_model(opened))
        return
    from selftouch_drake.run.exported import Known, export_model

    known = Known(length=length, distance=distance, depth=depth, mirror=mirror)
    for line in export_model(opened, files, known, rejected=rejected):
        click.echo(line)


def _print_model(found: "BodyModel") -> None:
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    from selftouch_drake.run.model_text import JOINT_COLUMNS, PART_COLUMNS, is_off, model_text

    text, console = model_text(found), Console(markup=False, highlight=False)
    if not console.is_terminal:  # in a file nothing is cut
        console = Console(markup=False, highlight=False, width=_WIDE)
    click.echo(f"body model: {text.verdict}")
    for sentence in text.sentences:
        click.echo(sentence)
    if is_off(found):
        return
    tables = [(PART_COLUMNS, text.parts)]
    if text.tree:
        click.echo("\n" + "\n".join(text.tree))
        tables.insert(0, (JOINT_COLUMNS, text.joints))
    for columns, rows in tables:
        table = Table(*columns, box=SIMPLE_HEAD)
        for row in rows:
            table.add_row(*row)
        console.print(table)
