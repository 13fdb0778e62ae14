"""The path of what touches over the skin (paper, figure 4)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from selftouch_drake.show.page.meshes import balls, surface
from selftouch_drake.show.page.scene import (
    add_scene,
    draw,
    fit_height,
    outline,
    scale_bar,
    share_scale,
    visible,
)
from selftouch_drake.show.paths import SkinPath, evenly_spaced
from selftouch_drake.show.skins import SkinSurface
from selftouch_drake.show.style import BLUE, GREEN, SKIN, VERMILION, styled
from selftouch_drake.show.view import View

# m between the dots of a path.
_DOT_SPACING = 0.008
# Skins in a row: more are too small to be read.
_MOST_SKINS = 4


@styled
def plan_path(
    skins: Sequence[SkinSurface],
    paths: Sequence[SkinPath],
    known: Sequence[SkinPath],
    num_rows: int,
) -> Figure:
    """A planned motion over translucent skins (paper, figure 4).

    Each kernel set on the way gives one posture, which touches anywhere in the patch of skin that
    feels alike: so the path wanders from side to side.

    A plan on one skin is shown from two sides; one over several, skin by skin, in the order in
    which it touches them.

    Args:
        skins: in one frame.
        paths: of the smooth motion, in the same frame.
        known: of the known configurations that it came from.
        num_rows: instants of the motion.
    """
    touched = sorted(paths, key=lambda path: path.rows[0])
    numbers = list(dict.fromkeys(path.skin for path in touched))[:_MOST_SKINS]
    panels = []
    for number in numbers:
        over = np.concatenate([path.points for path in paths if path.skin == number])
        middle = skins[number].vertices.mean(axis=0)
        first = View.facing(over.mean(axis=0) - middle + 1e-9)
        second = View(first.elevation, first.azimuth + 110.0)
        panels += [(number, first)] + [(number, second)] * (len(numbers) == 1)
    figure = Figure(figsize=(9.4, 4.4), layout="constrained")
    grid = figure.add_gridspec(1, len(panels))
    for column, (number, view) in enumerate(panels):
        title = skins[number].name if len(numbers) > 1 else ""
        ax = add_scene(figure, grid[column], title)
        # Several skins, far apart, are each shown round their own middle.
        middle = np.zeros(3) if len(numbers) == 1 else -skins[number].vertices.mean(axis=0)
        pose = np.hstack([np.eye(3), middle[:, None]])
        here, crosses = (
            [path.moved(pose) for path in of if path.skin == number] for of in (paths, known)
        )
        _draw_paths(ax, view, skins[number].moved(pose), here, crosses, num_rows)
    share_scale(figure.axes)
    fit_height(figure, margin=0.5)
    ax = figure.axes[0]
    scale_bar(ax)
    handles = [
        ax.scatter([], [], s=45, color=GREEN, label="start"),
        ax.scatter([], [], s=45, color=BLUE, label="goal"),
        ax.scatter(
            [],
            [],
            s=28,
            color=VERMILION,
            marker="x",
            label="a posture of each kernel set on the way",
        ),
        ax.scatter([], [], s=6, color=BLUE, label="the motion"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


def _draw_paths(
    ax: Axes,
    view: View,
    skin: SkinSurface,
    paths: Sequence[SkinPath],
    known: Sequence[SkinPath],
    num_rows: int,
) -> None:
    dots = _joined([evenly_spaced(s, _DOT_SPACING) for path in paths for s in path.stretches()])
    crosses = _joined([path.points for path in known])
    ends = [
        (end, color)
        for path in paths
        for row, color in ((0, GREEN), (num_rows - 1, BLUE))
        if (end := path.at(row)) is not None
    ]
    # Behind the body's front: the same marks, veiled.
    _marks(ax, view, dots, crosses, ends, skin.extent, zorder=1)
    draw(ax, view, surface(skin.vertices, skin.faces, SKIN), opacity=0.55, zorder=2)
    outline(ax, view, skin.vertices, skin.faces, zorder=3)
    seen = [_seen(points, skin, view) for points in (dots, crosses)]
    shown = [(end, color) for end, color in ends if _seen(end[None], skin, view)[0]]
    _marks(ax, view, dots[seen[0]], crosses[seen[1]], shown, skin.extent, zorder=4)


def _joined(parts: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.zeros((0, 3)), *parts])


def _seen(points: np.ndarray, skin: SkinSurface, view: View) -> np.ndarray:
    return visible(points, skin.vertices, skin.faces, view)


def _marks(
    ax: Axes,
    view: View,
    dots: np.ndarray,
    known: np.ndarray,
    ends: Sequence[tuple[np.ndarray, str]],
    size: float,
    *,
    zorder: float,
) -> None:
    x, y = view.project(dots)[:, :2].T
    ax.scatter(x, y, s=5, color=BLUE, linewidths=0, zorder=zorder)
    x, y = view.project(known)[:, :2].T
    ax.scatter(x, y, s=30, color=VERMILION, marker="x", linewidths=1.5, zorder=zorder + 0.1)
    for end, color in ends:
        draw(ax, view, balls(end[None], 0.03 * size, color, detail=3), zorder=zorder + 0.2)
