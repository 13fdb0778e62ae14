"""Commands for data from elsewhere: import them, map skins, score other methods."""

import itertools
from pathlib import Path
from typing import Any

import click

from selftouch_drake.cli.options import OUT, SET
from selftouch_drake.cli.stages import progress_bar


@click.command("import")
@click.argument("data", metavar="DATA", type=click.Path(path_type=Path))
@OUT
@click.option(
    "--q",
    metavar="COLUMNS",
    help="Joint positions: a column of arrays, a topic, or a pattern such as 'joint_*' for one "
    "column per joint.",
)
@click.option("--sensation", metavar="COLUMNS", help="Readings of the skin, likewise.")
@click.option(
    "--time",
    metavar="COLUMN",
    help="Times or dates, which give the speeds of the joints; 'none' does without.",
)
@click.option(
    "--time-unit",
    type=click.Choice(["s", "ms", "us", "ns"]),
    help="Unit of the times.  [default: as their name or size says]",
)
@click.option(
    "--rows",
    metavar="COLUMN=VALUE",
    multiple=True,
    help="Import only rows with this value, or one of several with commas between them.",
)
@click.option(
    "--delimiter", help="Character between the columns of CSV.  [default: as in the first line]"
)
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

    DATA is a CSV, TSV, Parquet, Feather, NPZ, MAT, HDF5, ROS bag or MCAP file, or a folder of them,
    of NPY files, of LeRobot or of YARP, with joint positions and raw readings of the skin. `learn`,
    `plan`, `live` and `report` work on such a run; `execute` and `evaluate` need a body of your
    own, with --body.
    """
    from selftouch_drake.run import imported
    from selftouch_drake.run.directory import RunDirectory
    from selftouch_drake.run.import_summary import summary
    from selftouch_drake.run.naming import default_path

    read = imported.read_data(data, **how)
    experiment = imported.imported_experiment(
        read, overrides=overrides, max_velocity=max_velocity, max_acceleration=max_acceleration
    )
    directory = RunDirectory.create(out or default_path(experiment.name, overrides), experiment)
    with directory.writing():
        imported.store(directory, read)
    for line in summary(read, experiment):
        click.echo(line)
    click.echo(f"run: {directory.path}\nnext: selftouch learn {directory.path}")


@click.command("map")
@click.argument("source", metavar="FILE_OR_RUN", type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), help="Folder for map.csv and map.png.  [default: RUN]"
)
@click.option("--q", metavar="COLUMNS", help="Joint positions, as in `selftouch import`.")
@click.option("--sensation", metavar="COLUMNS", help="Readings of the skin, likewise.")
@click.option("--time", metavar="COLUMN", help="Times, likewise.")
@click.option("--time-unit", type=click.Choice(["s", "ms", "us", "ns"]), help="Likewise.")
@click.option("--rows", metavar="COLUMN=VALUE", multiple=True, help="Rows to read, likewise.")
@click.option("--offset", type=float, help="Reading of a receptor at rest, likewise.")
@click.option("--threshold", type=float, help="Smallest reading that counts, likewise.")
@click.option(
    "--touches",
    type=click.IntRange(min=20),
    default=1000,
    show_default=True,
    help="Number of touches to use at most, spread evenly over the recording.",
)
def map_receptors(source: Path, out: Path | None, touches: int, **how: Any) -> None:
    """Find where the receptors are, from few touches.

    FILE_OR_RUN is a run directory, or data as `selftouch import` reads. Only which receptors feel a
    touch counts, not how strongly. Give readings of one skin: two skins that touch each other are
    taken for one.
    """
    from selftouch_drake.agent.shape import receptor_map
    from selftouch_drake.run.receptor_map import read_touches, summary, write_map
    from selftouch_drake.show.receptor_map import draw_map

    given = {name: value for name, value in how.items() if value not in (None, ())}
    q, sensation, names = read_touches(source, touches, given)
    with progress_bar("map") as progress:

        def report(done: float) -> None:
            progress(done, "receptors")

        found = receptor_map.map_receptors(q, sensation, names, progress=report)
    folder = out or (source if source.is_dir() else source.with_suffix(""))
    write_map(folder / "map.csv", found, names)
    draw_map(found, folder / "map.png")
    for line in summary(found):
        click.echo(line)
    click.echo(f"map: {folder / 'map.csv'}\npicture: {folder / 'map.png'}")


@click.command()
@click.argument("file", metavar="FILE", type=click.Path(path_type=Path))
@click.option(
    "--recording",
    metavar="NAME_OR_PATH",
    required=True,
    help="A shipped recording, as torus_1, or a file.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the metrics as JSON.")
def score(file: Path, recording: str, as_json: bool) -> None:
    """Score what any other method makes of a recording.

    FILE is an .npz archive with one of `touch_places` (a row for each touch), `receptor_places` and
    `distances`, and if you like `rows`, `parts` and `plans`. The figures are those of `evaluate`.
    """
    from selftouch_drake.run.submissions import judge_submission

    found = judge_submission(file, recording)
    if as_json:
        import json

        click.echo(json.dumps(found, indent=2))
    else:
        _print_metrics(found)


def _print_metrics(found: dict[str, Any]) -> None:
    """Prints metrics, by their keys, as a table with the target of each."""
    from rich.console import Console
    from rich.table import Table

    from selftouch_drake.run.metrics import metric_texts

    table = Table("metric", "value", "target")
    for reading in itertools.chain(*metric_texts(found).values()):
        table.add_row(reading.name, reading.value, reading.metric.target)
    Console().print(table)
