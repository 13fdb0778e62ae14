"""The command that shows the body model of a run."""

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
def model(run: Path) -> None:
    """Print what the agent of RUN found out about its joints.

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
    """  # noqa: D301 - click keeps the lines after a \b as they are
    from selftouch_drake.run.artifacts import load_body_model
    from selftouch_drake.run.directory import RunDirectory

    _print_model(load_body_model(RunDirectory.open(run)))


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
