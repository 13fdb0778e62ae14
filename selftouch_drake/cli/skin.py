"""The command that finds faults of a skin."""

from pathlib import Path

import click

from selftouch_drake.cli.options import numbers
from selftouch_drake.cli.tables import print_table


@click.command()
@click.argument("run", metavar="RUN", type=click.Path(path_type=Path))
@click.argument("later", metavar="[LATER]", required=False, type=click.Path(path_type=Path))
@click.option(
    "--taxels",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Where the receptors are said to be.  [default: as in RUN's own robot]",
)
@click.option(
    "--receptors",
    callback=numbers(int),
    metavar="FIRST,LAST",
    help="With --taxels: the receptors that FILE has.  [default: all]",
)
@click.option(
    "--touches",
    type=click.IntRange(min=50),
    default=3000,
    show_default=True,
    help="Number of touches to use at most, spread evenly over a run.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for skin_faults.csv and skin_faults.png; of two runs, skin_drift.csv and "
    "skin_drift.png.  [default: RUN, or LATER]",
)
def skin(
    run: Path,
    later: Path | None,
    taxels: Path | None,
    receptors: list[int] | None,
    touches: int,
    out: Path | None,
) -> None:
    """Find dead, stuck, loose and misplaced receptors.

    RUN is a run directory with touches, simulated or imported; it need not have learned. With
    LATER, a second run of the same robot, only what changed between them is printed.

    Neighbouring receptors feel the same touches. What the neighbours of a receptor read, in the
    mean, is what is due at its place, and a receptor is judged by that:

    \b
    dead        felt nothing of what was due, ever or from some touch on
    stuck       reads one value, whatever is touched
    flickers    feels where nothing is due, as a loose contact does
    drops out   misses many of the touches that are surely due
    exchanged   reads what is due at the place of another, and that one at its place
    elsewhere   reads what is due at another place than the file says
    never met   felt nothing, and nothing was surely due
    weaker, stronger    since RUN, beside its neighbours

    \b
    felt        touches that the receptor felt
    due         touches that it should have felt

    If RUN has an accepted body model, two runs also show what else changed beyond its standard
    error: a joint's zero, a link, what touches, or the skin as a whole. In one
    run, `selftouch model RUN --start FILE` compares it with the robot's drawings.

    \b
    selftouch skin runs/cube
    selftouch skin runs/monday runs/friday
    selftouch skin runs/mine --taxels taxels.csv --receptors 0,99
    """  # noqa: D301 - click keeps the lines after a \b as they are
    from selftouch_drake.run import skin as skins
    from selftouch_drake.run.directory import RunDirectory
    from selftouch_drake.show.skin_faults import draw_drift, draw_faults

    span = None
    if receptors is not None:
        if taxels is None:
            raise click.UsageError("--receptors is given without --taxels; name the file")
        if len(receptors) != 2:
            raise click.UsageError(
                f"--receptors has {len(receptors)} numbers; give the first and the last, as in 0,99"
            )
        span = receptors[0], receptors[1]
    places = None if taxels is None else skins.Taxels(file=taxels, receptors=span)
    opened = RunDirectory.open(run)
    columns: tuple[str, ...]
    if later is None:
        checked = skins.check_skins(opened, touches, places)
        rows, lines = skins.fault_rows(checked), skins.check_lines(checked)
        stem, columns = (out or run) / "skin_faults", skins.FAULT_COLUMNS
        skins.write_checked(stem.with_suffix(".csv"), checked)
        draw_faults(checked, stem.with_suffix(".png"))
    else:
        found = skins.compare_runs(opened, RunDirectory.open(later), touches, places)
        rows, lines = skins.drift_rows(found), skins.drift_lines(found)
        stem, columns = (out or later) / "skin_drift", skins.CHANGE_COLUMNS
        skins.write_compared(stem.with_suffix(".csv"), found)
        draw_drift(found, stem.with_suffix(".png"))
    if rows:
        print_table(columns, rows)
    for line in lines:
        click.echo(line)
    click.echo(f"table: {stem.with_suffix('.csv')}\npicture: {stem.with_suffix('.png')}")
