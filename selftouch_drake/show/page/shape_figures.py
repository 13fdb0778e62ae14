"""Pictures of what the agent recovered: the graph, the shape and the holes of its body."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, to_rgba_array
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from selftouch_drake.lazy import trimesh
from selftouch_drake.run.directory import MissingError
from selftouch_drake.show.page.scene import (
    ColoredMesh,
    add_scene,
    balls,
    draw,
    finish_row,
    outline,
    share_scale,
    surface,
    visible,
)
from selftouch_drake.show.recovered import RecoveredSkin
from selftouch_drake.show.run_data import RunData
from selftouch_drake.show.skins import as_one, typical_extent
from selftouch_drake.show.style import (
    AMOUNT,
    BLUE,
    GREEN,
    INK,
    ORANGE,
    RECOVERED,
    SKIN,
    View,
    styled,
)

# Bars drawn for each dimension; the rest are shorter.
_MOST_BARS = 24
_KINDS = tuple(zip(("components", "loops", "voids"), (ORANGE, BLUE, GREEN), strict=True))
# Longest edge of a recovered surface, as a share of its extent: it looks smooth.
_SMOOTH = 0.03
# Parts in a row.
_COLUMNS = 4


@styled
def body_shape(data: RunData) -> Figure:
    """The body, the body that the agent recovered, and both in one (paper, figure 3)."""
    skins, parts = data.skins_at_home, data.recovered
    rms_fraction = data.run.metrics().get("surface_rms_fraction")
    skin = as_one(skins)
    offsets = [
        part.positions.mean(axis=0) - skins[part.skins[0]].vertices.mean(axis=0) for part in parts
    ]
    view = View.of_most(np.array(offsets), typical_extent(skins))
    figure = Figure(figsize=(10.5, 4.0), layout="constrained")
    grid = figure.add_gridspec(1, 3, wspace=0.04)

    real = surface(skin.vertices, skin.faces, SKIN)
    ax = add_scene(figure, grid[0])
    draw(ax, view, real)
    seen = visible(skin.receptors, skin.vertices, skin.faces, view)
    draw(ax, view, balls(skin.receptors[seen], 0.018 * typical_extent(skins), BLUE), zorder=2)
    where = "its skin" if len(skins) == 1 else f"{len(skins)} skins"
    ax.set_title(f"The body\n{len(skin.receptors)} receptors on {where}", loc="center")

    fitted = [_fitted(part) for part in parts]
    ax = add_scene(figure, grid[1])
    draw(ax, view, *fitted)
    num_kernels = _draw_kernels(ax, view, parts, 0.011 * typical_extent(skins))
    pieces = "" if len(parts) == 1 else f" in {len(parts)} parts"
    through = "line" if all(part.is_line for part in parts) else "surface"
    ax.set_title(
        f"The body the agent recovered\n{num_kernels} sensations{pieces}, {through} through them",
        loc="center",
    )

    ax = add_scene(figure, grid[2])
    draw(ax, view, *fitted)
    draw(ax, view, real, opacity=0.38, zorder=2)
    outline(ax, view, skin.vertices, skin.faces, zorder=3)
    error = "" if rms_fraction is None else f"\nerror {rms_fraction:.1%} of its extent (RMS)"
    ax.set_title(f"Both, fitted to one another{error}", loc="center")

    finish_row(figure)
    return figure


@styled
def persistence(data: RunData) -> Figure:
    """Components, loops and voids of each part of the recovered body, as bars."""
    found = {n: part.topology for n, part in enumerate(data.body.parts) if part.topology}
    if not found:
        raise MissingError("no part of the recovered body is a surface; babble longer")
    rows, columns = -(-len(found) // _COLUMNS), min(len(found), _COLUMNS)
    figure = Figure(figsize=(max(2.8 * columns, 6.0), 0.8 + 2.4 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for (part, topology), ax in zip(found.items(), axes, strict=False):
        _draw_bars(ax, topology.diagram)
        held = [f"{kind}: {n}" for (kind, _), n in zip(_KINDS, topology.betti, strict=False)]
        short = f"part {part}: {', '.join(map(str, topology.betti))}"
        ax.set(title=short if len(found) > 1 else ", ".join(held))
    for ax in axes[len(found) :]:
        ax.set_axis_off()
    figure.supxlabel("radius of the balls round the kernels (unit of each part)", fontsize=9)
    handles = [Line2D([], [], color=color, linewidth=2.5, label=kind) for kind, color in _KINDS]
    figure.legend(handles=handles, loc="outside upper right", ncols=3, fontsize=8)
    return figure


def _fitted(part: RecoveredSkin) -> ColoredMesh:
    max_edge = _SMOOTH * float(np.ptp(part.places, axis=0).max())
    mesh = surface(part.places, part.faces, RECOVERED, max_edge=max_edge)
    if part.closed:
        return mesh
    # A sheet is seen from both sides.
    normals = np.concatenate([mesh.normals, -mesh.normals])
    return ColoredMesh(np.tile(mesh.triangles, (2, 1, 1)), normals, np.tile(mesh.rgb, (2, 1)))


def _draw_kernels(ax: Axes, view: View, parts: Sequence[RecoveredSkin], radius: float) -> int:
    """Draws the kernels that nothing hides, and returns how many there are in all."""
    places, faces = trimesh.util.append_faces([p.places for p in parts], [p.faces for p in parts])
    sheet = np.concatenate([np.full(len(part.places), not part.closed) for part in parts])
    kernels = np.concatenate([part.positions for part in parts])
    # A line hides nothing of itself.
    seen = np.concatenate([np.full(part.num_kernels, part.is_line) for part in parts])
    seen |= visible(kernels, places, faces, view, sheet=sheet)
    draw(ax, view, balls(kernels[seen], radius, INK), zorder=2)
    return len(kernels)


def _draw_bars(ax: Axes, diagram: Sequence[np.ndarray]) -> None:
    finite = np.concatenate([d[np.isfinite(d)] for d in diagram] + [np.zeros(1)])
    end, row = 1.08 * float(finite.max()) or 1.0, 0
    for pairs, (_, color) in zip(diagram, _KINDS, strict=False):
        birth, death = pairs[:, 0], np.minimum(pairs[:, 1], end)
        longest = np.argsort(birth - death, kind="stable")[:_MOST_BARS]
        rows = row + np.arange(len(longest))
        ax.hlines(rows, birth[longest], death[longest], color=color, linewidth=2.0)
        row += len(longest) + 2
    ax.set(xlim=(-0.01 * end, end), yticks=[])
    ax.invert_yaxis()
    ax.spines["left"].set_visible(False)


@styled
def quotient_graph(data: RunData) -> Figure:
    """The quotient graph, laid out as the agent embeds it.

    One part is shown from the front and from above; several, each in its own unit, from the front.
    A part that was laid out in a plane is shown from above.
    """
    known, parts = data.representation, [part.kernels for part in data.body.parts]
    embedding, edges, edge_cost = known.embedding, known.edges, known.edge_cost
    low, high = np.quantile(edge_cost, [0.02, 0.98]) if len(edge_cost) else (0.0, 1.0)
    norm = Normalize(low, max(high, low + 1e-9))
    above = View(elevation=90.0, azimuth=-90.0)
    panels = [
        (f"part {n}: {len(part)} kernels", View() if embedding[part, 2].any() else above, part)
        for n, part in enumerate(parts)
    ]
    size = 2.4
    if len(parts) == 1:
        (_, view, part), size = panels[0], 4.8
        panels = [("The quotient graph, embedded in a plane", above, part)]
        if view is not above:
            panels = [("The quotient graph, embedded", view, part)]
            panels += [("from above", View(elevation=80.0), part)]
    rows, columns = -(-len(panels) // _COLUMNS), min(len(panels), _COLUMNS)
    figure = Figure(figsize=(size * columns, 0.4 + size * rows), layout="constrained")
    grid = figure.add_gridspec(rows, columns)
    for n, (title, view, part) in enumerate(panels):
        ax = add_scene(figure, grid[n // columns, n % columns], title)
        inside = np.isin(edges, part).all(axis=1)
        picture = view.project(embedding - embedding[part].mean(axis=0))
        _draw_graph(ax, picture, part, edges[inside], edge_cost[inside], norm)
    if len(parts) == 1:
        share_scale(figure.axes)
    figure.colorbar(
        ScalarMappable(norm, AMOUNT),
        ax=figure.axes,
        label="cost of an edge (mu)",
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
    # From 0 for the farthest to 1 for the nearest; 1 if all are as near.
    x, y, nearness = picture[part].T
    nearest = nearness.max()
    near = 1.0 - (nearest - picture[:, 2]) / max(nearest - nearness.min(), 1e-12)
    near_edge = near[edges].mean(axis=1)
    order = np.argsort(near_edge)
    lines = LineCollection(
        list(picture[edges[order], :2]),
        array=edge_cost[order],
        norm=norm,
        cmap=AMOUNT,
        alpha=0.15 + 0.85 * near_edge[order] ** 1.5,
        linewidths=0.4 + 1.1 * near_edge[order],
    )
    ax.add_collection(lines)
    near = near[part]
    ax.scatter(
        x, y, s=2 + 14 * near**2, linewidths=0, zorder=3,
        color=to_rgba_array([INK] * len(near), 0.1 + 0.9 * near**1.5),
    )  # fmt: skip
    ax.autoscale_view()
