"""The command that shows the body model of a run, takes it home, or corrects a given one."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from selftouch_drake.cli.options import RUN, numbers
from selftouch_drake.cli.tables import print_table

if TYPE_CHECKING:
    from selftouch_drake.agent.body_model.model import BodyModel
    from selftouch_drake.run.directory import RunDirectory


@click.command()
@RUN
@click.option(
    "--urdf",
    "files",
    type=click.Path(path_type=Path, dir_okay=False),
    multiple=True,
    metavar="FILE",
    help="Write the body to FILE, as URDF; as SDFormat or MJCF if it ends in .sdf or .xml. Can "
    "be given several times.",
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
@click.option(
    "--start",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Your own model of the robot. URDF is corrected; SDFormat, MJCF and model directives are "
    "only compared with the touches.",
)
@click.option("--link", help="With --start: the link that wears the skin.")
@click.option("--frame", help="With --start: the frame or link that touches it.")
@click.option(
    "--radius",
    type=click.FloatRange(min=0.0),
    help="With --start: radius of what touches, a ball, in m.  [default: 0.01]",
)
@click.option(
    "--receptors",
    callback=numbers(int),
    metavar="FIRST,LAST",
    help="With --start: the receptors on the link.  [default: all]",
)
@click.option(
    "--taxels",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="With --start: places of the receptors on the link, to be checked.",
)
def model(
    run: Path,
    files: tuple[Path, ...],
    length: tuple[str, str, float] | None,
    distance: tuple[str, str, float] | None,
    depth: float | None,
    mirror: bool,
    rejected: bool,
    **start: Any,
) -> None:
    """Print the joints found, export them, or correct a model.

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
                    a part is accepted above 88 %, or 75 % if others proved its joints

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

    With --start your own model of the robot is corrected by the touches of RUN, which need not have
    learned: offsets, mounts, axes, lengths and receptors, with standard errors, and what is wrong
    with it. The corrected copy goes to --urdf, or to FILE_refitted.urdf beside it.

    \b
    selftouch model RUN --start arm.urdf --link head --frame fingertip
    """  # noqa: D301 - click keeps the lines after a \b as they are
    from selftouch_drake.run.artifacts import load_body_model
    from selftouch_drake.run.directory import RunDirectory

    opened = RunDirectory.open(run)
    given = {
        "--length": length is not None,
        "--distance": distance is not None,
        "--depth": depth is not None,
        "--mirror": mirror,
        "--rejected": rejected,
    }
    if start["start"] is not None:
        for option in (name for name, is_given in given.items() if is_given):
            raise click.UsageError(
                f"{option} is given with --start, which has metres; leave it out"
            )
        _correct(opened, files, start)
        return
    for option in (name for name, value in start.items() if value is not None):
        raise click.UsageError(f"--{option} is given without --start; name the model to correct")
    if not files:
        for option in (name for name, is_given in given.items() if is_given):
            raise click.UsageError(f"{option} is given without --urdf; name the file to write")
        _print_model(load_body_model(opened))
        return
    from selftouch_drake.run.exported import Known, export_model

    known = Known(length=length, distance=distance, depth=depth, mirror=mirror)
    for line in export_model(opened, files, known, rejected=rejected):
        click.echo(line)


def _correct(run: "RunDirectory", files: tuple[Path, ...], given: dict[str, Any]) -> None:
    """Corrects a model that somebody has, and prints what moved."""
    from selftouch_drake.run.refitted import CHANGE_COLUMNS, Start, correct_model

    for option in ("link", "frame"):
        if given[option] is None:
            raise click.UsageError(f"--start needs --{option}; name it as in the model")
    if len(files) > 1:
        raise click.UsageError("--urdf is given twice; --start writes one corrected file")
    span = given["receptors"]
    if span is not None and len(span) != 2:
        raise click.UsageError(
            f"--receptors has {len(span)} numbers; give the first and the last, as in 0,99"
        )
    start = Start(
        model=given["start"],
        link=given["link"],
        frame=given["frame"],
        radius=0.01 if given["radius"] is None else given["radius"],
        receptors=None if span is None else (span[0], span[1]),
        taxels=given["taxels"],
    )
    lines, rows = correct_model(run, start, files[0] if files else None)
    print_table(CHANGE_COLUMNS, rows)
    for line in lines:
        click.echo(line)


def _print_model(found: "BodyModel") -> None:
    from selftouch_drake.run.model_text import JOINT_COLUMNS, PART_COLUMNS, is_off, model_text

    text = model_text(found)
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
        print_table(columns, rows)
