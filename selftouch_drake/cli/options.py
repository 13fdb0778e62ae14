"""Arguments and options that several commands share."""

from collections.abc import Callable, Sequence
from functools import reduce
from pathlib import Path
from typing import Any

import click


def read_fields(
    ctx: click.Context, option: click.Parameter, texts: Sequence[str]
) -> dict[str, Any]:
    """Reads the fields of an experiment that each `--set` changes; of one field the last counts."""
    from selftouch_drake.experiment.loading import merged, parse_fields

    return reduce(merged, map(parse_fields, texts), {})


def numbers(kind: type) -> Callable[..., list | None]:
    """Returns a reader of numbers, of one kind, that are separated by commas."""

    def read(ctx: click.Context, option: click.Parameter, text: str | None) -> list | None:
        if text is None:
            return None
        try:
            return [kind(number) for number in text.split(",")]
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
    multiple=True,
    metavar="YAML",
    callback=read_fields,
    help="Fields to change, as in '{babbling: {num_samples: 20000}}'; may be given again.",
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
BODY = click.option(
    "--body",
    metavar="FILE:CLASS",
    help="Body of your own for the agent, as in my_robot.py:MyRobot; for imported runs.",
)


def of_an_experiment(command: Callable[..., None]) -> Callable[..., None]:
    """Adds the experiment of a run that begins, and the options that decide on it."""
    return EXPERIMENT(OUT(SET(command)))
