"""Pictures of the agent (paper, figure 2) and of where its babbling has touched its body."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from selftouch_drake.show.scene import (
    View,
    add_scene,
    balls,
    draw,
    fit_height,
    outline,
    rod,
    scale_bar,
    share_scale,
    surface,
    visible,
)
from selftouch_drake.show.style import AMOUNT, BLUE, GREEN, INK, PALE, SKIN, VERMILION, styled


@styled
def agent(
    vertices: np.ndarray,
    faces: np.ndarray,
    p_BS: np.ndarray,
    p_WJ: np.ndarray,
    p_WF: np.ndarray,
) -> Figure:
    """The agent: body, receptors, arm and fingers (paper, figure 2).

    Args:
        vertices: `(V, 3)` m, of the outer surface.
        faces: `(F, 3)` indices, outward.
        p_BS: `(S, 3)` m, receptors.
        p_WJ: `(J, 3)` m, the joints from the shoulder on; the last ones may fall together.
        p_WF: `(fingers, 3)` m, fingertips.
    """
    size = np.ptp(vertices, axis=0).max()
    wrist = p_WJ[-1]
    # The arm reaches round the body in a vertical plane: seen from beside that plane.
    view = View.facing(wrist - p_WJ[0] + 1e-9, elevation=16.0)
    view = View(view.elevation, view.azimuth - 40.0)
    is_wrist = np.linalg.norm(p_WJ - wrist, axis=1) < 1e-6
    joints = np.unique(p_WJ[~is_wrist].round(6), axis=0)
    links = pairwise(p_WJ)
    arm = [rod(a, b, 0.02, PALE) for a, b in links if np.linalg.norm(b - a) > 1e-6]

    figure = Figure(figsize=(5.6, 5.0), layout="constrained")
    ax = add_scene(figure, figure.add_gridspec(1, 1)[0])
    draw(ax, view, surface(vertices, faces, SKIN))
    seen = visible(p_BS, vertices, faces, view)
    draw(ax, view, balls(p_BS[seen], 0.012 * size, INK), zorder=2)
    draw(
        ax,
        view,
        *arm,
        *(rod(wrist, tip, 0.007, PALE) for tip in p_WF),
        balls(joints, 0.036, BLUE, detail=3),
        balls(wrist[None], 0.028, GREEN, detail=3),
        balls(p_WF, 0.016, VERMILION, detail=3),
        zorder=3,
    )
    scale_bar(ax, 0.1, "10 cm")
    marks = [
        ax.scatter([], [], s=30, color=color, label=label)
        for color, label in (
            (BLUE, "revolute joints"),
            (GREEN, "spherical wrist"),
            (VERMILION, "fingertips" if len(p_WF) > 1 else "fingertip"),
            (INK, f"receptors ({len(p_BS)})"),
        )
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=len(marks))
    return figure


@styled
def coverage(
    vertices: np.ndarray,
    faces: np.ndarray,
    density: np.ndarray,
    dots: np.ndarray,
    num_touches: int,
) -> Figure:
    """Where the body was touched, and how often, from the front and from behind.

    Args:
        vertices: `(V, 3)` m, of the outer surface.
        faces: `(F, 3)` indices, outward.
        density: `(V,)` touches / cm², as `touch_density` tells it.
        dots: `(n, 3)` m, true fingertip positions of some of the touches.
        num_touches: how many there were.
    """
    front = View()
    back = View(-front.elevation, front.azimuth + 180.0)
    norm = Normalize(0.0, float(np.quantile(density, 0.99)) or 1.0)
    painted = surface(vertices, faces, AMOUNT(norm(density))[:, :3])

    figure = Figure(figsize=(10.5, 4.0), layout="constrained")
    grid = figure.add_gridspec(1, 3)
    ax = add_scene(figure, grid[0], f"{len(dots):,} of {num_touches:,} touches")
    x, y, nearness = front.project(dots).T
    order = np.argsort(nearness)
    ax.scatter(
        x[order], y[order], c=nearness[order], s=2.5, cmap="Blues", linewidths=0,
        vmin=2 * nearness.min() - nearness.max(), zorder=2,
    )  # fmt: skip
    outline(ax, front, vertices, faces, zorder=3)
    for where, view, title in (
        (grid[1], front, "Density, from the front and above"),
        (grid[2], back, "from behind and below"),
    ):
        ax = add_scene(figure, where, title)
        draw(ax, view, painted, ambient=0.85)
    share_scale(figure.axes)
    fit_height(figure)
    scale_bar(figure.axes[0], 0.1, "10 cm")
    figure.colorbar(
        ScalarMappable(norm, AMOUNT),
        ax=figure.axes,
        label="touches / cm²",
        shrink=0.7,
        aspect=30,
        extend="max",
    )
    return figure
