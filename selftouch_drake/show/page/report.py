"""The report of a run: one page with its whole story, for readers who were not there."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from selftouch_drake.experiment import dump_experiment
from selftouch_drake.robot.describe import description
from selftouch_drake.run.directory import MissingError
from selftouch_drake.run.metrics import MOTION_COLUMNS, motions, readings, tiles
from selftouch_drake.show.page.tables import Table, part_table, plan_table
from selftouch_drake.show.page.turnable import turnable_body
from selftouch_drake.show.run_data import NoSurfaceError, RunData


def report_page(data: RunData, pictures: Mapping[str, Path | str], recording: Path | str) -> str:
    """The report of a run as HTML that holds all it shows and asks nothing of a network.

    What was not made yet is named, with the command that makes it.

    Args:
        data: of the run, with any of its stages done.
        pictures: the PNG file of each of `FIGURES`, or why there is none.
        recording: the page with the recorded plan, or why there is none.
    """
    body = no_surface = robot_missing = ""
    try:
        body = turnable_body(data)
    except NoSurfaceError as reason:
        no_surface = str(reason)
    except MissingError:
        pass
    robot: list[Table] = []
    try:
        robot = [Table(title, (), rows) for title, rows in description(data.world)]
    except MissingError as reason:
        robot_missing = str(reason)
    images = {name: _encoded(it) for name, it in pictures.items() if isinstance(it, Path)}
    return _template().render(
        experiment=data.experiment,
        settings=dump_experiment(data.experiment),
        images=images,
        missing={name: it for name, it in pictures.items() if isinstance(it, str)},
        tiles=tiles(data.metrics),
        motions=motions(data.metrics),
        columns=MOTION_COLUMNS,
        readings=readings(data.metrics),
        robot=robot,
        robot_missing=robot_missing,
        parts=_parts(data),
        body=body,
        no_surface=no_surface,
        viewer=(files(__package__) / "turnable.js").read_text(encoding="utf-8"),
        plans=plan_table(data),
        shown=data.shown_pair if data.pairs else None,
        recording=recording.name if isinstance(recording, Path) else "",
        no_recording=recording if isinstance(recording, str) else "",
    )


def _encoded(image: Path) -> str:
    return base64.b64encode(image.read_bytes()).decode("ascii")


def _parts(data: RunData) -> Table | None:
    """The table of parts; none where there is one part on one skin."""
    try:
        table = part_table(data)
    except MissingError:
        return None
    return table if len(table.rows) > 1 or len(data.experiment.skins) > 1 else None


def _template():
    environment = Environment(
        loader=PackageLoader("selftouch_drake.show.page", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2")
