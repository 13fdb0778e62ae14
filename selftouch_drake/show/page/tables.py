"""The tables of the report: recovered parts, plans."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.motions import NO_KERNEL
from selftouch_drake.run.directory import MissingError
from selftouch_drake.show.run_data import RunData


@dataclass(frozen=True, slots=True)
class Table:
    """A table of text.

    Attributes:
        caption: above it.
        columns: their headings, or none.
        rows: a text for each column.
    """

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


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
