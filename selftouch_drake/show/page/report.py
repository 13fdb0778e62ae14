"""The report of a run: one page with its whole story, for readers who were not there."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from selftouch_drake.experiment import dump_experiment
from selftouch_drake.files import write_text_whole
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.show.figures import write_figures
from selftouch_drake.show.material import Material, MissingError
from selftouch_drake.show.playback import write_playback
from selftouch_drake.show.readings import headline, readings


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A figure as the page shows it, or why it does not.

    Attributes:
        image: the PNG as base64; empty if there is none.
        missing: the reason why there is none.
    """

    image: str = ""
    missing: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanLine:
    """A line of the table of plans; figures are None before execution.

    Attributes:
        start: target sensation.
        goal: target sensation.
        num_kernels: kernel sets on the route.
        duration: s.
        contact: share of the time in contact.
        max_force: N, strongest total force on the skin.
    """

    start: int
    goal: int
    num_kernels: int
    duration: float
    contact: float | None = None
    max_force: float | None = None


def write_report(
    run: RunDirectory,
    progress: Callable[[float, str], None] = lambda fraction, doing: None,
    *,
    vector: bool = False,
) -> Path:
    """Draws the figures and the recording of a run, and writes its `report.html`.

    The page holds everything it shows and asks nothing of a network. What was not made yet is
    named, with the command that makes it.

    Args:
        run: the run, with any of its stages done.
        progress: told the fraction done and what is being drawn.
        vector: whether to write the figures as PDF as well.
    """
    reasons: dict[str, str] = {}
    written = write_figures(
        run,
        vector=vector,
        progress=lambda fraction, doing: progress(0.7 * fraction, doing),
        skipped=reasons.__setitem__,
    )
    pictures = {name: Picture(missing=reason) for name, reason in reasons.items()}
    pictures |= {path.stem: Picture(image=_base64(path)) for path in written}
    progress(0.7, "recording")
    material = Material(run)
    playback = _recorded(run, material)
    progress(0.9, "report")
    page = _template().render(
        experiment=run.experiment,
        settings=dump_experiment(run.experiment),
        pictures=pictures,
        headline=headline(material.metrics),
        readings=readings(material.metrics),
        metrics=material.metrics,
        plans=list(_plan_lines(material)),
        shown=material.shown_pair if material.pairs else None,
        playback=playback,
    )
    write_text_whole(run.report, page)
    progress(1.0, "reported")
    return run.report


def _template():
    environment = Environment(
        loader=PackageLoader("selftouch_drake.show", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2")


def _base64(path: Path) -> str:
    return base64.b64encode(path.read_bytes()).decode("ascii")


def _recorded(run: RunDirectory, material: Material) -> Picture:
    """Writes the recording; its name stands for it, because the page links to it."""
    try:
        return Picture(image=write_playback(run, *material.shown_pair).name)
    except MissingError as reason:
        run.playback.unlink(missing_ok=True)
        return Picture(missing=str(reason))


def _plan_lines(material: Material) -> Iterator[PlanLine]:
    for start, goal in material.pairs:
        plan = material.plan(start, goal)
        felt = plan.get("felt")
        yield PlanLine(
            start=start,
            goal=goal,
            num_kernels=len(plan["nodes"]),
            duration=float(np.ptp(plan["time_s"])),
            contact=None if felt is None else float(felt.any(axis=1).mean()),
            max_force=None if felt is None else float(felt.sum(axis=1).max()),
        )
