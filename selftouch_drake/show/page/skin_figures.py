"""Pictures of the skins: where they were touched, and what is felt on them."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from scipy.spatial import cKDTree

from selftouch_drake.geometry.farthest import farthest_points
from selftouch_drake.show.page.scene import add_scene, balls, draw, finish_row, surface, visible
from selftouch_drake.show.run_data import RunData
from selftouch_drake.show.skins import SkinSurface, as_one, typical_extent
from selftouch_drake.show.style import AMOUNT, BLUE, SKIN, View, styled

# Sensations whose numbers are written on the skin; more would cover it.
_NUM_NAMED = 60
# How far readings of one touch lie apart, as a share of the skin's extent.
_REACH = 0.25


@styled
def coverage(data: RunData) -> Figure:
    """Where babbling touched the skins, from both sides."""
    skins, density = data.skins_at_home, data.touch_density
    skin = _centred(skins)
    amount = np.concatenate(density)
    offsets = [
        np.average(each.vertices, axis=0, weights=touches + 1e-12) - each.vertices.mean(axis=0)
        for each, touches in zip(skins, density, strict=True)
    ]
    front = View.of_most(np.array(offsets), typical_extent(skins))
    norm = Normalize(0.0, float(np.quantile(amount, 0.99)) or 1.0)
    painted = surface(skin.vertices, skin.faces, AMOUNT(norm(amount))[:, :3])
    figure = Figure(figsize=(7.5, 4.0), layout="constrained")
    for ax, view in _two_sides(figure, front):
        draw(ax, view, painted, ambient=0.85)
    finish_row(figure)
    figure.colorbar(
        ScalarMappable(norm, AMOUNT),
        ax=figure.axes,
        label="touches / cm²",
        shrink=0.7,
        aspect=30,
        extend="max",
    )
    return figure


@styled
def sensation_map(data: RunData) -> Figure:
    """Where some of the target sensations are felt, by number."""
    skins = data.skins_at_home
    skin, places = _centred(skins), felt_places(skins, data.representation.target_sensations)
    places += skin.vertices[0] - skins[0].vertices[0]
    named = farthest_points(lambda k: np.linalg.norm(places - places[k], axis=1), _NUM_NAMED)
    figure = Figure(figsize=(10.5, 5.5), layout="constrained")
    for ax, view in _two_sides(figure, View()):
        draw(ax, view, surface(skin.vertices, skin.faces, SKIN))
        seen = named[visible(places[named], skin.vertices, skin.faces, view)]
        draw(ax, view, balls(places[seen], 0.01 * skin.extent, BLUE), zorder=2)
        for kernel, (x, y, _) in zip(seen, view.project(places[seen]), strict=True):
            text = ax.annotate(
                str(kernel), (x, y), (0, 4), textcoords="offset points", ha="center", zorder=3,
                fontsize=10, fontweight="bold",
            )  # fmt: skip
            text.set_path_effects([withStroke(linewidth=2.0, foreground="white")])
    finish_row(figure)
    return figure


def _centred(skins: Sequence[SkinSurface]) -> SkinSurface:
    """All skins round their middle: so they are in the same place seen from any side."""
    skin = as_one(skins)
    middle = (skin.vertices.min(axis=0) + skin.vertices.max(axis=0)) / 2
    return skin.moved(np.hstack([np.eye(3), -middle[:, None]]))


def _two_sides(figure: Figure, front: View) -> list[tuple[Axes, View]]:
    """Two scenes with their views."""
    grid = figure.add_gridspec(1, 2)
    back = View(-front.elevation, front.azimuth + 180.0)
    return [
        (add_scene(figure, grid[0], "From the front and above"), front),
        (add_scene(figure, grid[1], "from behind and below"), back),
    ]


def felt_places(skins: Sequence[SkinSurface], target_sensations: np.ndarray) -> np.ndarray:
    """`(K, 3)` m, where each of `(K, S)` is felt most: the middle of its strongest readings.

    Of a sensation of several places, it is the strongest one; all are in the frame of the skins.
    """
    everything = as_one(skins)
    receptors = everything.receptors
    reach = _REACH * np.repeat([s.extent for s in skins], [len(s.receptors) for s in skins])
    strongest = target_sensations.argmax(axis=1)
    apart = np.linalg.norm(receptors[strongest, None] - receptors, axis=2)
    weight = np.where(apart < reach[strongest, None], target_sensations, 0.0)
    inside = weight @ receptors / weight.sum(axis=1, keepdims=True)
    _, nearest = cKDTree(everything.vertices).query(inside)
    return everything.vertices[nearest]
