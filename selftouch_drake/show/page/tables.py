"""The tables of the report: joints, skins, what touches what, recovered parts, plans."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.motions import NO_KERNEL
from selftouch_drake.lazy import trimesh
from selftouch_drake.show.run_data import MissingError, RunData


@dataclass(frozen=True, slots=True, kw_only=True)
class JointRow:
    """A joint that moves.

    Attributes:
        name: in the robot's model.
        motion: whether it turns or slides.
        range: with its unit.
    """

    name: str
    motion: str
    range: str


@dataclass(frozen=True, slots=True, kw_only=True)
class SkinRow:
    """A skin.

    Attributes:
        name: as the experiment calls it.
        link: that wears it.
        area_cm2: of its outer surface.
        thickness_cm: of its wall.
        num_receptors: on it.
        touched_by: names of what may touch it.
    """

    name: str
    link: str
    area_cm2: float
    thickness_cm: float
    num_receptors: int
    touched_by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ToucherRow:
    """Something that touches skins.

    Attributes:
        name: as the experiment calls it.
        what: it is, in words.
        touches: names of the skins that it may touch.
    """

    name: str
    what: str
    touches: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PartRow:
    """A part of the recovered body; what is not known is empty.

    Attributes:
        skins: names of the skins that it truly is on.
        num_kernels: kernel sets on it.
        found: components, loops and voids that the agent found.
        true: those of the patch that was touched.
        error: of its shape, as a share of its extent.
    """

    skins: str
    num_kernels: int
    found: str
    true: str
    error: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanRow:
    """A plan; contact and force are None before execution.

    Attributes:
        start: target sensation.
        goal: target sensation.
        num_kernels: kernel sets on the route.
        num_flights: stretches through the air, where it leaves one touch for another.
        duration: s.
        contact: share of the time in contact, where touch is expected.
        max_force: N, strongest total force on the skin.
    """

    start: int
    goal: int
    num_kernels: int
    num_flights: int
    duration: float
    contact: float | None = None
    max_force: float | None = None


def joint_rows(data: RunData) -> list[JointRow]:
    """The joints that move, in the order of a motor configuration."""
    robot = data.robot
    rows = []
    for name, turns, low, high in zip(
        robot.joint_names, robot.turns, robot.lower, robot.upper, strict=True
    ):
        unit = "rad" if turns else "m"
        limited = np.isfinite(low) and np.isfinite(high)
        rows.append(
            JointRow(
                name=name,
                motion="turns" if turns else "slides",
                range=f"{low:.3g} to {high:.3g} {unit}" if limited else "no limits",
            )
        )
    return rows


def skin_rows(data: RunData) -> list[SkinRow]:
    """The skins, in the order of their readings in a sensation."""
    robot = data.robot
    rows = []
    for number, skin in enumerate(robot.skins):
        wall = skin.model.wall
        touched_by = [robot.touchers[t].name for t, s in robot.touching_pairs if s == number]
        rows.append(
            SkinRow(
                name=skin.model.name,
                link=skin.model.link,
                area_cm2=1e4 * trimesh.Trimesh(wall.vertices, wall.faces, process=False).area,
                thickness_cm=100 * wall.thickness,
                num_receptors=skin.model.fields.num_receptors,
                touched_by=", ".join(touched_by),
            )
        )
    return rows


def toucher_rows(data: RunData) -> list[ToucherRow]:
    """What touches, and what it may touch."""
    robot = data.robot
    worn = {int(skin.link.index()): skin.model.name for skin in robot.skins}
    rows = []
    for number, toucher in enumerate(robot.touchers):
        described = data.experiment.touching[toucher.name]
        radius = described.radius
        if radius is not None:
            what = f"a ball of {100 * radius:.2g} cm radius at {described.frame}"
        elif (name := worn.get(int(toucher.link.index()))) is not None:
            what = f"the skin {name}"
        else:
            what = f"the link {described.link}"
        touches = [robot.skins[s].model.name for t, s in robot.touching_pairs if t == number]
        rows.append(ToucherRow(name=toucher.name, what=what, touches=", ".join(touches)))
    return rows


def part_rows(data: RunData) -> list[PartRow]:
    """The parts of the recovered body."""
    names, metrics = list(data.experiment.skins), data.metrics
    true = metrics.get("topology_betti_true_by_part", [])
    errors = metrics.get("surface_rms_fraction_by_skin", {})
    rows = []
    for number, part in enumerate(data.body.parts):
        skins: list[str] = []
        with contextlib.suppress(MissingError):
            skins = [names[s] for s in data.skins_of(part.kernels)]
        known = true[number] if number < len(true) else None
        error = errors.get(skins[0]) if skins else None
        rows.append(
            PartRow(
                skins=", ".join(skins),
                num_kernels=len(part.kernels),
                found="" if part.topology is None else _numbers(part.topology.betti),
                true="" if known is None else _numbers(known),
                error="" if error is None else f"{100 * error:.1f} %",
            )
        )
    return rows


def plan_rows(data: RunData) -> Iterator[PlanRow]:
    """The plans from one sensation to another."""
    for start, goal in data.pairs:
        motion = data.motion(start, goal)
        in_air = motion.in_air.astype(int)
        row = PlanRow(
            start=start,
            goal=goal,
            num_kernels=len(np.unique(motion.nodes[motion.nodes != NO_KERNEL])),
            num_flights=int(np.sum(np.diff(in_air, prepend=0) > 0)),
            duration=float(np.ptp(motion.time_s)),
        )
        try:
            execution = data.execution(start, goal)
        except MissingError:
            yield row
            continue
        force = float(execution.felt.sum(axis=1).max())
        yield dataclasses.replace(row, contact=execution.contact, max_force=force)


def _numbers(values) -> str:
    return ", ".join(map(str, values))
