"""Coverage of the skins by babbling, which only the experimenter sees."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from selftouch_drake.show.page.meshes import surface
from selftouch_drake.show.page.scene import (
    add_scene,
    draw,
    fit_height,
    outline,
    scale_bar,
    share_scale,
)
from selftouch_drake.show.run_data import TouchSample
from selftouch_drake.show.skins import SkinSurface, as_one, moved
from selftouch_drake.show.style import AMOUNT, styled
from selftouch_drake.show.view import View


@styled
def coverage(
    skins: Sequence[SkinSurface],
    density: Sequence[np.ndarray],
    sample: TouchSample,
) -> Figure:
    """Number of touches on the skins, from the front and from behind.

    Args:
        skins: in one frame.
        density: `(V,)` touches / cm² of each skin, as `touch_density` gives it.
        sample: some of the touches, in the same frame.
    """
    skin = as_one(skins)
    # Round their middle the skins are in the same place in both views.
    low, high = skin.vertices.min(axis=0), skin.vertices.max(axis=0)
    centred = np.hstack([np.eye(3), -(low + high)[:, None] / 2])
    skin = skin.moved(centred)
    amount = np.concatenate(list(density))
    front = View.of_most(_offsets(skins, density), float(np.mean([skin.extent for skin in skins])))
    back = View(-front.elevation, front.azimuth + 180.0)
    norm = Normalize(0.0, float(np.quantile(amount, 0.99)) or 1.0)
    painted = surface(skin.vertices, skin.faces, AMOUNT(norm(amount))[:, :3])

    figure = Figure(figsize=(10.5, 4.0), layout="constrained")
    grid = figure.add_gridspec(1, 3)
    title = f"{sample.num_drawn:,} of {sample.num_touches:,} touches"
    ax = add_scene(figure, grid[0], title)
    x, y, nearness = front.project(moved(sample.places, centred)).T
    order = np.argsort(nearness)
    ax.scatter(
        x[order], y[order], c=nearness[order], s=2.5, cmap="Blues", linewidths=0,
        vmin=2 * nearness.min() - nearness.max(), zorder=2,
    )  # fmt: skip
    outline(ax, front, skin.vertices, skin.faces, zorder=3)
    for where, view, title in (
        (grid[1], front, "Density, from the front and above"),
        (grid[2], back, "from behind and below"),
    ):
        ax = add_scene(figure, where, title)
        draw(ax, view, painted, ambient=0.85)
    share_scale(figure.axes)
    fit_height(figure)
    scale_bar(figure.axes[0])
    figure.colorbar(
        ScalarMappable(norm, AMOUNT),
        ax=figure.axes,
        label="touches / cm²",
        shrink=0.7,
        aspect=30,
        extend="max",
    )
    return figure


def _offsets(skins: Sequence[SkinSurface], density: Sequence[np.ndarray]) -> np.ndarray:
    """`(skins, 3)` m, from the middle of each skin to the middle of its touches."""
    return np.array(
        [
            np.average(skin.vertices, axis=0, weights=amount + 1e-12) - skin.vertices.mean(axis=0)
            for skin, amount in zip(skins, density, strict=True)
        ]
    )
