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
    scale_bar,
    share_scale,
)
from selftouch_drake.show.skins import SkinSurface, as_one
from selftouch_drake.show.style import AMOUNT, styled
from selftouch_drake.show.view import View


@styled
def coverage(
    skins: Sequence[SkinSurface],
    density: Sequence[np.ndarray],
) -> Figure:
    """Number of touches on the skins, from the front and from behind.

    Args:
        skins: in one frame.
        density: `(V,)` touches / cm² of each skin, as `touch_density` gives it.
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

    figure = Figure(figsize=(7.5, 4.0), layout="constrained")
    grid = figure.add_gridspec(1, 2)
    for where, view, title in (
        (grid[0], front, "From the front and above"),
        (grid[1], back, "from behind and below"),
    ):
        draw(add_scene(figure, where, title), view, painted, ambient=0.85)
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
