"""Pictures of a body that nobody knows: what the agent found, with numbers and names on it."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from selftouch_drake.geometry.farthest import farthest_points
from selftouch_drake.run.receptor_map import receptor_names
from selftouch_drake.show.page.scene import (
    ColoredMesh,
    add_scene,
    balls,
    draw,
    share_scale,
    surface,
    visible,
)
from selftouch_drake.show.recovered import RecoveredSkin
from selftouch_drake.show.run_data import RunData
from selftouch_drake.show.style import BLUE, RECOVERED, VERMILION, View, styled

# Numbers or names that are written; more would cover the body.
_NUM_NAMED = 60
# Radius of a dot, as a share of the extent.
_DOT = 0.01


@styled
def found_numbers(data: RunData) -> Figure:
    """The recovered body from two sides, with numbers of target sensations on it."""
    places = np.concatenate([part.positions for part in data.recovered])
    kernels = np.concatenate([data.body.parts[part.part].kernels for part in data.recovered])
    return _from_two_sides(data.recovered, places, [str(kernel) for kernel in kernels], BLUE)


@styled
def found_receptors(data: RunData) -> Figure:
    """The recovered body from two sides, with names of receptors where they are felt most."""
    number, places = receptor_places(data)
    names = receptor_names(data.run, data.run.num_receptors)
    return _from_two_sides(data.recovered, places, [names[n] for n in number], VERMILION)


def receptor_places(data: RunData) -> tuple[np.ndarray, np.ndarray]:
    """`(S,)` numbers of receptors that are felt, and `(S, 3)` where, on the recovered body.

    Each lies between the kernels in which it reads half of its strongest reading or more, on the
    part of the strongest one.
    """
    target = data.representation.target_sensations
    part_of = np.full(len(target), -1)
    places = np.full((len(target), 3), np.nan)
    for part in data.recovered:
        kernels = data.body.parts[part.part].kernels
        part_of[kernels], places[kernels] = part.part, part.positions
    known = part_of >= 0
    weight = np.where(known[:, None], target, 0.0)
    strongest = weight.max(axis=0)
    number = np.flatnonzero(strongest > 0)
    weight = weight[:, number]
    own = part_of[weight.argmax(axis=0)]
    kept = (weight >= 0.5 * strongest[number]) & (part_of[:, None] == own)
    weight = np.where(kept, weight, 0.0)
    return number, weight.T @ np.nan_to_num(places) / weight.sum(axis=0)[:, None]


def _from_two_sides(
    parts: Sequence[RecoveredSkin], places: np.ndarray, texts: Sequence[str], color: str
) -> Figure:
    """The parts with texts at `(n, 3)` places, some of them if there are many."""
    corners = np.concatenate([part.places for part in parts])
    first = np.cumsum([0, *(len(part.places) for part in parts[:-1])])
    faces = np.concatenate([part.faces + n for part, n in zip(parts, first, strict=True)])
    extent = float(np.ptp(corners, axis=0).max())
    named = np.arange(len(places))
    if len(places) > _NUM_NAMED:
        named = farthest_points(lambda k: np.linalg.norm(places - places[k], axis=1), _NUM_NAMED)
    figure = Figure(figsize=(10.5, 5.5), layout="constrained")
    front = View()
    back = View(-front.elevation, front.azimuth + 180.0)
    grid = figure.add_gridspec(1, 2)
    for where, title, view in (
        (grid[0], "From the front and above", front),
        (grid[1], "from behind and below", back),
    ):
        ax = add_scene(figure, where, title)
        painted: ColoredMesh = surface(corners, faces, RECOVERED)
        draw(ax, view, painted)
        seen = named[visible(places[named], corners, faces, view)]
        if len(seen):
            draw(ax, view, balls(places[seen], _DOT * extent, color), zorder=2)
        for n, (x, y, _) in zip(seen, view.project(places[seen]), strict=True):
            text = ax.annotate(
                texts[n], (x, y), (0, 4), textcoords="offset points", ha="center", zorder=3,
                fontsize=9, fontweight="bold",
            )  # fmt: skip
            text.set_path_effects([withStroke(linewidth=2.0, foreground="white")])
    # No length is known, so there is no bar that shows one.
    share_scale(figure.axes)
    return figure
