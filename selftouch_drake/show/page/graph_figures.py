"""A picture of the quotient graph."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, to_rgba_array
from matplotlib.figure import Figure

from selftouch_drake.show.page.scene import add_scene, fit_height, share_scale
from selftouch_drake.show.style import AMOUNT, INK, styled
from selftouch_drake.show.view import View

# Parts in a row of the graph's picture.
_COLUMNS = 4


@styled
def quotient_graph(
    embedding: np.ndarray, edges: np.ndarray, edge_cost: np.ndarray, parts: Sequence[np.ndarray]
) -> Figure:
    """The quotient graph, laid out as the agent embeds it.

    One part is shown from the front and from above; several, each in its own unit, from the front.
    A part that was laid out in a plane is shown from above.

    Args:
        embedding: `(K, 3)` arbitrary unit and pose of each part; NaN in fragments, and 0 in the
            third coordinate of parts that were laid out in a plane.
        edges: `(E, 2)` pairs of kernels.
        edge_cost: `(E,)` rad.
        parts: the kernels of each part.
    """
    low, high = np.quantile(edge_cost, [0.02, 0.98]) if len(edge_cost) else (0.0, 1.0)
    norm = Normalize(low, max(high, low + 1e-9))
    above = View(elevation=90.0, azimuth=-90.0)
    in_plane = [not embedding[part, 2].any() for part in parts]
    if len(parts) == 1:
        views = [(View(), "The quotient graph, embedded"), (View(elevation=80.0), "from above")]
        if in_plane[0]:
            views = [(above, "The quotient graph, embedded in a plane")]
        figure = Figure(figsize=(4.8 * len(views), 4.3), layout="constrained")
        grid = figure.add_gridspec(1, len(views))
        panels = [(grid[n], view, title, parts[0]) for n, (view, title) in enumerate(views)]
    else:
        rows, columns = -(-len(parts) // _COLUMNS), min(len(parts), _COLUMNS)
        figure = Figure(figsize=(10.0, 0.4 + 2.9 * rows), layout="constrained")
        grid = figure.add_gridspec(rows, columns)
        panels = [
            (
                grid[n // columns, n % columns],
                above if in_plane[n] else View(),
                f"part {n}: {len(part)} kernels",
                part,
            )
            for n, part in enumerate(parts)
        ]
    for where, view, title, part in panels:
        ax = add_scene(figure, where, title)
        inside = np.isin(edges, part).all(axis=1)
        picture = view.project(embedding - embedding[part].mean(axis=0))
        _draw_graph(ax, picture, part, edges[inside], edge_cost[inside], norm)
    if len(parts) == 1:
        share_scale(figure.axes)
        fit_height(figure)
    figure.colorbar(
        ScalarMappable(norm, AMOUNT),
        ax=figure.axes,
        label="cost of an edge (rad)",
        shrink=0.7,
        extend="both",
    )
    return figure


def _draw_graph(
    ax: Axes,
    picture: np.ndarray,
    part: np.ndarray,
    edges: np.ndarray,
    edge_cost: np.ndarray,
    norm: Normalize,
) -> None:
    near = _from_far_to_near(picture[edges, 2].mean(axis=1))
    order = np.argsort(near)
    lines = LineCollection(
        list(picture[edges[order], :2]),
        array=edge_cost[order],
        norm=norm,
        cmap=AMOUNT,
        alpha=0.15 + 0.85 * near[order] ** 1.5,
        linewidths=0.4 + 1.1 * near[order],
    )
    ax.add_collection(lines)
    x, y, nearness = picture[part].T
    near = _from_far_to_near(nearness)
    ax.scatter(
        x, y, s=2 + 14 * near**2, linewidths=0, zorder=3,
        color=to_rgba_array([INK] * len(near), 0.1 + 0.9 * near**1.5),
    )  # fmt: skip
    ax.autoscale_view()


def _from_far_to_near(nearness: np.ndarray) -> np.ndarray:
    """Scales to 0 for the farthest and 1 for the nearest; 1 if all are as near."""
    if not len(nearness) or np.ptp(nearness) < 1e-12:
        return np.ones(len(nearness))
    return (nearness - nearness.min()) / np.ptp(nearness)
