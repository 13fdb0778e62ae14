"""The report of a run: one page with its whole story, for readers who were not there."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from selftouch_drake.experiment import dump_experiment
from selftouch_drake.show.page.tables import (
    joint_rows,
    part_rows,
    plan_rows,
    skin_rows,
    toucher_rows,
)
from selftouch_drake.show.page.turnable import turnable_body
from selftouch_drake.show.run_data import MissingError, NoSurfaceError, RunData


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A figure as the page shows it, or why it does not.

    Attributes:
        image: the PNG as base64; empty if there is none.
        missing: the reason why there is none.
    """

    image: str = ""
    missing: str = ""

    @staticmethod
    def of(path: Path) -> Picture:
        """The picture in a PNG file."""
        return Picture(image=base64.b64encode(path.read_bytes()).decode("ascii"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Playback:
    """The recording beside the page, or why there is none.

    Attributes:
        file: its name.
        missing: the reason why there is none.
    """

    file: str = ""
    missing: str = ""


def report_page(data: RunData, pictures: Mapping[str, Picture], recording: Playback) -> str:
    """The report of a run as HTML that holds all it shows and asks nothing of a network.

    What was not made yet is named, with the command that makes it.

    Args:
        data: of the run, with any of its stages done.
        pictures: by the names of `FIGURES`.
        recording: of the plan that is shown.
    """
    plans = list(plan_rows(data))
    body = no_surface = ""
    try:
        body = turnable_body(data)
    except NoSurfaceError as reason:
        no_surface = str(reason)
    except MissingError:
        pass
    return _template().render(
        experiment=data.experiment,
        settings=dump_experiment(data.experiment),
        pictures=pictures,
        headline=data.headline,
        readings=data.readings,
        parts=_parts(data),
        body=body,
        no_surface=no_surface,
        viewer=(files(__package__) / "turnable.js").read_text(encoding="utf-8"),
        plans=plans,
        flights=any(plan.num_flights for plan in plans),
        shown=data.shown_pair if data.pairs else None,
        recording=recording,
        **_robot(data),
    )


def _robot(data: RunData) -> dict[str, Any]:
    try:
        return {
            "joints": joint_rows(data),
            "skins": skin_rows(data),
            "touchers": toucher_rows(data),
            "robot_missing": "",
        }
    except MissingError as reason:
        return {"joints": [], "skins": [], "touchers": [], "robot_missing": str(reason)}


def _parts(data: RunData) -> Sequence[Any]:
    """The rows of the table of parts; none where there is one part on one skin."""
    try:
        rows = part_rows(data)
    except MissingError:
        return ()
    return rows if len(rows) > 1 or len(data.experiment.skins) > 1 else ()


def _template():
    environment = Environment(
        loader=PackageLoader("selftouch_drake.show.page", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2")
