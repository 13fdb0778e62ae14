"""The report of a run: one page with its whole story, for readers who were not there."""

import base64
import contextlib
import json
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from selftouch_drake.agent.motions import NO_KERNEL
from selftouch_drake.experiment import dump_experiment
from selftouch_drake.geometry.farthest import farthest_points
from selftouch_drake.robot.describe import description
from selftouch_drake.run.artifacts import load_motion, stored_pairs
from selftouch_drake.run.directory import MissingError
from selftouch_drake.run.metrics import MOTION_COLUMNS, metric_texts, motions, tiles
from selftouch_drake.run.model_text import (
    JOINT_COLUMNS,
    PART_COLUMNS,
    ModelText,
    is_off,
    model_text,
)
from selftouch_drake.show.page.skeleton_figures import fitted_skeleton
from selftouch_drake.show.recovered import skins_of
from selftouch_drake.show.run_data import NoSurfaceError, RunData

# Numbers of sensations that are written on the body; more would cover it.
_NUM_LABELS = 40
# Pictures are not shown smaller than this share of their pixels: their letters, of 20 pixels, would
# be below 9.
_LEGIBLE = 0.45
# Digits of a place, in units of the body's half size: a picture has no more.
_DIGITS = 3


#: Caption and rows of a table of text, and the headings of its columns.
Table = tuple[str, Sequence[Sequence[str]], Sequence[str]]


def report_page(
    data: RunData,
    pictures: Mapping[str, Path | str],
    recording: Path | str,
    babbling: Path | None = None,
) -> str:
    """The report of a run as HTML that holds all it shows and asks nothing of a network.

    What was not made yet is named, with the command that makes it. Pictures are as `draw_figures`
    returns them; the recording is the page with the recorded plan, or why there is none; the page
    of babbling shows its first seconds, if there is one.
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
        robot = [_without_empty((title, rows, ())) for title, rows in description(data.world)]
    except MissingError as reason:
        robot_missing = str(reason)
    parts: Table | None = None
    with contextlib.suppress(MissingError):
        parts = _without_empty(part_table(data))
        # One part on one skin needs no table.
        parts = parts if len(parts[1]) > 1 or len(data.run.experiment.skins) > 1 else None
    model: ModelText | None = None
    with contextlib.suppress(MissingError):
        model = None if is_off(data.model) else model_text(data.model)
    tables = [] if model is None else [_without_empty(it) for it in model_tables(data, model)]
    experiment, metrics = data.run.experiment, data.run.metrics()
    plans = _without_empty(plan_table(data))
    images = {
        name: base64.b64encode(it.read_bytes()).decode("ascii")
        for name, it in pictures.items()
        if isinstance(it, Path)
    }
    environment = Environment(
        loader=PackageLoader("selftouch_drake.show.page", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2").render(
        experiment=experiment,
        settings=dump_experiment(experiment),
        images=images,
        widths={name: _width(it) for name, it in images.items()},
        legible=_LEGIBLE,
        missing={name: it for name, it in pictures.items() if isinstance(it, str)},
        tiles=tiles(metrics),
        motions=(rows := motions(metrics)),
        shown_columns={n for row in rows for n, cell in enumerate(row.cells) if cell},
        columns=MOTION_COLUMNS,
        readings=metric_texts(metrics),
        robot=robot,
        robot_missing=robot_missing,
        parts=parts,
        model=model,
        model_tables=tables,
        body=body,
        no_surface=no_surface,
        viewer=(files(__package__) / "turnable.js").read_text(encoding="utf-8"),
        plans=plans,
        # Nothing moves where a robot's recordings are all there is.
        plans_are_practised=experiment.imported is None,
        ends=[] if plans[1] else far_apart(data),
        shown=data.shown_pair if plans[1] else None,
        recording=recording.name if isinstance(recording, Path) else "",
        babbling=babbling.name if babbling else "",
        no_recording=recording if isinstance(recording, str) else "",
    )


def turnable_body(data: RunData) -> str:
    """The recovered body as JSON for the viewer, fitted to the real one, in units of its half size.

    Raises:
        MissingError: nothing was learned, or the recovered body is not a surface.
    """
    skins = data.recovered
    kernels_of = [data.body.parts[skin.part].kernels for skin in skins]
    everything = np.concatenate([skin.places for skin in skins])
    low, high = everything.min(axis=0), everything.max(axis=0)
    half = float((high - low).max()) / 2 or 1.0
    places = np.concatenate([skin.positions for skin in skins])
    labels = farthest_points(lambda k: np.linalg.norm(places - places[k], axis=1), _NUM_LABELS)
    parts = [
        {
            "places": np.round((skin.places - (low + high) / 2) / half, _DIGITS).tolist(),
            "faces": skin.faces.tolist(),
            "kernels": kernels.tolist(),
            "closed": skin.closed,
        }
        for skin, kernels in zip(skins, kernels_of, strict=True)
    ]
    named = np.concatenate(kernels_of)[labels].tolist()
    return json.dumps({"parts": parts, "labels": named}, separators=(",", ":"))


def far_apart(data: RunData) -> list[int]:
    """Two target sensations far apart on one part of the body, for a first plan; or none."""
    with contextlib.suppress(MissingError):
        part = max(data.recovered, key=lambda part: part.num_kernels)
        places, kernels = part.positions, data.body.parts[part.part].kernels
        two = farthest_points(lambda k: np.linalg.norm(places - places[k], axis=1), 2)
        return kernels[two].tolist()
    return []


def part_table(data: RunData) -> Table:
    """The parts of the recovered body; cells of what is not known are empty."""
    names, metrics = list(data.run.experiment.skins), data.run.metrics()
    true = metrics.get("topology_betti_true_by_part", [])
    errors = metrics.get("surface_rms_fraction_by_skin", {})
    rows = []
    for number, part in enumerate(data.body.parts):
        skins: list[str] = []
        with contextlib.suppress(MissingError):
            skins = [names[s] for s in skins_of(part.kernels, data.kernel_truth)]
        error = errors.get(skins[0]) if skins else None
        rows.append(
            (
                str(number),
                ", ".join(skins),
                str(len(part.kernels)),
                _numbers(part.topology.betti if part.topology else None),
                _numbers(true[number] if number < len(true) else None),
                "" if error is None else f"{100 * error:.1f} %",
            )
        )
    holes = "components, loops, voids found", "true, where touched"
    return "Parts", rows, ("part", "truly on", "kernel sets", *holes, "shape error")


def model_tables(data: RunData, text: ModelText) -> list[Table]:
    """The parts and, if some were accepted, the joints of a body model.

    Joints are numbered as in its picture. Where the robot is known, each has the angle between its
    axis and the true one.
    """
    tables: list[Table] = [("The judgement, by part", text.parts, PART_COLUMNS)]
    if not data.model.accepted_by_part.any():
        return tables
    columns = ("", *JOINT_COLUMNS)
    rows: list[tuple[str, ...]] = [
        (str(number), *row) for number, row in enumerate(text.joints, start=1)
    ]
    with contextlib.suppress(MissingError):
        off = fitted_skeleton(data).off
        columns = (*columns, "off the true axis")
        rows = [
            (*row, "" if np.isnan(angle) else f"{angle:.1f}°")
            for row, angle in zip(rows, off, strict=True)
        ]
    return [("Joints that the agent found", rows, columns), *tables]


def plan_table(data: RunData) -> Table:
    """The plans from one sensation to another, and how those that were executed went."""
    rows = []
    for start, goal in stored_pairs(data.run):
        motion = load_motion(data.run, start, goal)
        nodes, in_air = motion.plan.nodes, motion.plan.in_air
        flights = int(np.sum(np.diff(in_air.astype(int), prepend=0) > 0))
        went = ("not executed", "")
        with contextlib.suppress(MissingError):
            execution = data.execution(start, goal)
            force = float(execution.felt.sum(axis=1).max())
            went = (f"{100 * execution.contact:.1f} %", f"{force:.1f} N")
        rows.append(
            (
                str(start),
                str(goal),
                str(len(np.unique(nodes[nodes != NO_KERNEL]))),
                str(flights or ""),
                f"{np.ptp(motion.time_s):.1f} s",
                *went,
            )
        )
    columns = "from", "to", "kernel sets", "times through the air", "duration"
    return "All plans of this run", rows, (*columns, "in contact", "strongest force")


def _without_empty(table: Table) -> Table:
    """A table without columns in which all cells are empty."""
    caption, rows, columns = table
    widths = {len(row) for row in rows}
    if len(widths) != 1 or (columns and len(columns) not in widths):
        return table
    kept = [n for n in range(widths.pop()) if any(row[n] for row in rows)]
    kept_columns = [columns[n] for n in kept] if columns else columns
    return caption, [[row[n] for n in kept] for row in rows], kept_columns


def _width(image: str) -> int:
    """The width of a picture, a PNG file in base64, in pixels."""
    # Bytes 16 to 20 of a PNG file.
    return int.from_bytes(base64.b64decode(image[:32])[16:20], "big")


def _numbers(values: Iterable[int] | None) -> str:
    return ", ".join(map(str, values or ()))
