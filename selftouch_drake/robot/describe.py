"""A description of a robot: joints, skins, touchers, and possible collisions."""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from selftouch_drake.lazy import trimesh
from selftouch_drake.robot.links import scoped_name
from selftouch_drake.robot.pairs import RigidPair
from selftouch_drake.robot.robot import Robot
from selftouch_drake.robot.world import World

# Pairs of links that are listed one by one.
_MOST_PAIRS = 12


def describe(world: World) -> str:
    """What `selftouch robot` prints: joints with limits, skins, and what touches what."""
    return "\n\n".join(_table(title, rows) for title, rows in description(world))


def description(world: World) -> list[tuple[str, list[tuple[str, ...]]]]:
    """Title and rows of the joints, the skins, what touches them, and rigid links."""
    robot = world.robot
    rigid = "No links can run into each other: they have no collision geometry that could"
    if number := len(_linked(robot)):
        rigid = f"{_counted(number, 'pair', 'pairs')} of rigid links must not run into each other"
    return [
        (_counted(robot.num_joints, "joint moves", "joints move"), list(_joints(world))),
        (_counted(len(robot.skins), "skin", "skins"), list(_skins(robot))),
        ("What touches what", list(_touching(robot))),
        (rigid, list(_rigid(robot))),
    ]


def _joints(world: World) -> Iterator[tuple[str, ...]]:
    robot, limits = world.robot, world.limits
    for j, joint in enumerate(robot.joints):
        moves, unit, force = ("turns", "rad", "N·m") if robot.turns[j] else ("slides", "m", "N")
        low, high, effort = robot.lower[j], robot.upper[j], limits.torque[j]
        limited = np.isfinite(low) and np.isfinite(high)
        yield (
            scoped_name(robot.plant, joint),
            moves,
            f"{low:.3g} to {high:.3g} {unit}" if limited else "no limits; babbles within one turn",
            f"{effort:.3g} {force}" if np.isfinite(effort) else "any effort",
        )


def _skins(robot: Robot) -> Iterator[tuple[str, ...]]:
    for number, skin in enumerate(robot.skins):
        wall, fields = skin.model.wall, skin.model.fields
        area = trimesh.Trimesh(wall.vertices, wall.faces, process=False).area
        yield (
            skin.model.name,
            f"on {scoped_name(robot.plant, skin.link)}",
            f"{1e4 * area:.0f} cm²",
            f"{1e3 * wall.thickness:.0f} mm thick",
            f"{fields.num_receptors} receptors",
            "moves" if robot.kinematics.owner[number] >= 0 else "",
        )


def _touching(robot: Robot) -> Iterator[tuple[str, ...]]:
    for t, toucher in enumerate(robot.touchers):
        felt = [robot.skins[s].model.name for t_, s in robot.touching_pairs if t_ == t]
        filtered = [k.model.name for k in robot.skins if k.model.name not in felt]
        yield (
            toucher.name,
            f"on {scoped_name(robot.plant, toucher.link)}",
            f"touches {', '.join(felt)}",
            f"not {', '.join(filtered)}: next to it" if filtered else "",
        )


def _rigid(robot: Robot) -> Iterator[tuple[str, ...]]:
    pairs = _linked(robot)
    for pair in pairs[:_MOST_PAIRS]:
        a, b = (link.name() for link in pair.links)
        yield a, b, f"at most {1e3 * pair.allowed_depth:.0f} mm deep"
    if (more := len(pairs) - _MOST_PAIRS) > 0:
        yield (f"and {more} more",)


def _linked(robot: Robot) -> list[RigidPair]:
    """One pair of each two links; some of whose geometries only may collide have several."""
    of_links = {tuple(int(link.index()) for link in pair.links): pair for pair in robot.rigid_pairs}
    return list(of_links.values())


def _table(title: str, cells: Sequence[tuple[str, ...]]) -> str:
    columns = itertools.zip_longest(*cells, fillvalue="")
    widths = [max(map(len, column)) for column in columns]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=False)).rstrip()
        for row in cells
    ]
    return "\n".join([title, *(f"  {line}" for line in lines)])


def _counted(number: int, one: str, several: str) -> str:
    return f"{number} {one if number == 1 else several}"
