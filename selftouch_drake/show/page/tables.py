"""The tables of the report: joints, skins, what touches what, recovered parts, plans."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.motions import NO_KERNEL
from selftouch_drake.lazy import trimesh
from selftouch_drake.show.run_data import MissingError, RunData


@dataclass(frozen=True, slots=True)
class Table:
    """A table of text.

    Attributes:
        caption: above it.
        columns: their headings.
        rows: a text for each column.
    """

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


def joint_table(data: RunData) -> Table:
    """The joints that move, in the order of a motor configuration."""
    robot = data.robot
    rows = []
    for name, turns, low, high in zip(
        robot.joint_names, robot.turns, robot.lower, robot.upper, strict=True
    ):
        limited = np.isfinite(low) and np.isfinite(high)
        span = f"{low:.3g} to {high:.3g} {'rad' if turns else 'm'}"
        rows.append((name, "turns" if turns else "slides", span if limited else "no limits"))
    return Table(f"{len(rows)} joints", ("joint", "motion", "range"), rows)


def skin_table(data: RunData) -> Table:
    """The skins, in the order of their readings in a sensation."""
    robot = data.robot
    rows = []
    for number, skin in enumerate(robot.skins):
        wall = skin.model.wall
        area = trimesh.Trimesh(wall.vertices, wall.faces, process=False).area
        rows.append(
            (
                skin.model.name,
                skin.model.link,
                f"{1e4 * area:.0f} cm²",
                f"{100 * wall.thickness:g} cm",
                str(skin.model.fields.num_receptors),
                ", ".join(robot.touchers[t].name for t, s in robot.touching_pairs if s == number),
            )
        )
    columns = ("skin", "on the link", "area", "thickness", "receptors", "touched by")
    return Table("Skins", columns, rows)


def toucher_table(data: RunData) -> Table:
    """What touches, and what it may touch."""
    robot = data.robot
    worn = {int(skin.link.index()): skin.model.name for skin in robot.skins}
    rows = []
    for number, toucher in enumerate(robot.touchers):
        described = data.experiment.touching[toucher.name]
        if described.radius is not None:
            what = f"a ball of {100 * described.radius:.2g} cm radius at {described.frame}"
        elif (name := worn.get(int(toucher.link.index()))) is not None:
            what = f"the skin {name}"
        else:
            what = f"the link {described.link}"
        skins = (robot.skins[s].model.name for t, s in robot.touching_pairs if t == number)
        rows.append((toucher.name, what, ", ".join(skins)))
    return Table("What touches them", ("what touches", "is", "may touch"), rows)


def part_table(data: RunData) -> Table:
    """The parts of the recovered body; cells of what is not known are empty."""
    names, metrics = list(data.experiment.skins), data.metrics
    true = metrics.get("topology_betti_true_by_part", [])
    errors = metrics.get("surface_rms_fraction_by_skin", {})
    rows = []
    for number, part in enumerate(data.body.parts):
        skins: list[str] = []
        with contextlib.suppress(MissingError):
            skins = [names[s] for s in data.skins_of(part.kernels)]
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
    columns = (
        "part",
        "truly on",
        "kernel sets",
        "components, loops, voids found",
        "true, where touched",
        "shape error",
    )
    return Table("Parts", columns, rows)


def plan_table(data: RunData) -> Table:
    """The plans from one sensation to another, and how those that were executed went."""
    rows = []
    for start, goal in data.pairs:
        motion = data.motion(start, goal)
        nodes, in_air = motion.plan.nodes, motion.plan.in_air
        flights = int(np.sum(np.diff(in_air.astype(int), prepend=0) > 0))
        try:
            execution = data.execution(start, goal)
        except MissingError:
            went = ("not executed", "")
        else:
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
    columns = (
        "from",
        "to",
        "kernel sets",
        "times through the air",
        "duration",
        "in contact",
        "strongest force",
    )
    return Table("All plans of this run", columns, rows)


def _numbers(values: Iterable[int] | None) -> str:
    return ", ".join(map(str, values or ()))
