"""Pictures of what the agent found out: its body's shape (paper, figure 3) and holes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from selftouch_drake.show.scene import (
    View,
    add_scene,
    balls,
    draw,
    fit_height,
    outline,
    scale_bar,
    share_scale,
    surface,
    visible,
)
from selftouch_drake.show.style import BLUE, GREEN, INK, MUTED, ORANGE, RECOVERED, SKIN, styled

_VIEW = View()
# Bars drawn for each dimension; the rest are shorter.
_MOST_BARS = 24


@styled
def body_shape(
    vertices: np.ndarray,
    faces: np.ndarray,
    p_BS: np.ndarray,
    recovered: np.ndarray,
    recovered_faces: np.ndarray,
    *,
    num_kernels: int,
    rms_fraction: float | None = None,
) -> Figure:
    """The body, the body that the agent recovered, and both in one (paper, figure 3).

    Args:
        vertices: `(V, 3)` m, of the real outer surface.
        faces: `(F, 3)` indices, outward.
        p_BS: `(S, 3)` m, receptors.
        recovered: `(N, 3)` m, the embedded kernels, then parts of wide ones, aligned with the body.
        recovered_faces: `(G, 3)` indices into `recovered`, the fitted surface, outward.
        num_kernels: K of them.
        rms_fraction: error of the recovered positions, as a share of the body's extent.
    """
    size = np.ptp(vertices, axis=0).max()
    figure = Figure(figsize=(10.5, 4.0), layout="constrained")
    grid = figure.add_gridspec(1, 3, wspace=0.04)

    real = surface(vertices, faces, SKIN)
    ax = add_scene(figure, grid[0])
    draw(ax, _VIEW, real)
    seen = visible(p_BS, vertices, faces, _VIEW)
    draw(ax, _VIEW, balls(p_BS[seen], 0.018 * size, BLUE), zorder=2)
    ax.set_title(f"The body\n{len(p_BS)} receptors on its skin", loc="center")

    fitted = surface(recovered, recovered_faces, RECOVERED, cuts=2)
    ax = add_scene(figure, grid[1])
    draw(ax, _VIEW, fitted)
    kernels = recovered[:num_kernels]
    seen = visible(kernels, recovered, recovered_faces, _VIEW)
    draw(ax, _VIEW, balls(kernels[seen], 0.011 * size, INK), zorder=2)
    ax.set_title(
        f"The body the agent recovered\n{num_kernels} sensations, fitted surface", loc="center"
    )

    ax = add_scene(figure, grid[2])
    draw(ax, _VIEW, fitted)
    draw(ax, _VIEW, real, opacity=0.38, zorder=2)
    outline(ax, _VIEW, vertices, faces, zorder=3)
    error = "" if rms_fraction is None else f"\nerror {rms_fraction:.1%} of its extent (RMS)"
    ax.set_title(f"Both{error}", loc="center")

    share_scale(figure.axes)
    fit_height(figure)
    scale_bar(figure.axes[0], 0.1, "10 cm")
    return figure


@styled
def persistence(diagrams: Sequence[np.ndarray], *, betti: Sequence[int] | None = None) -> Figure:
    """The persistence of components, loops and voids, as a diagram and as bars.

    Args:
        diagrams: births and deaths `(bars, 2)` for H0, H1 and H2; a death may be infinite.
        betti: how many of each are held to be true.
    """
    kinds = list(zip(("components", "loops", "voids"), (ORANGE, BLUE, GREEN), strict=True))
    finite = np.concatenate([d[np.isfinite(d)] for d in diagrams] + [np.zeros(1)])
    end = 1.08 * finite.max() or 1.0
    figure = Figure(figsize=(8.6, 3.8), layout="constrained")
    diagram, bars = figure.subplots(1, 2, width_ratios=(1, 1.35))

    diagram.plot([0, end], [0, end], color=MUTED, linewidth=0.8)
    row, handles = 0, []
    for dimension, (pairs, (kind, color)) in enumerate(zip(diagrams, kinds, strict=True)):
        birth, death = pairs[:, 0], np.minimum(pairs[:, 1], end)
        diagram.scatter(birth, death, s=16, color=color, alpha=0.75, linewidths=0, zorder=3)
        longest = np.argsort(birth - death, kind="stable")[:_MOST_BARS]
        rows = row + np.arange(len(longest))
        bars.hlines(rows, birth[longest], death[longest], color=color, linewidth=2.0)
        row += len(longest) + 2
        count = "" if betti is None else f": {betti[dimension]}"
        handles.append(Line2D([], [], color=color, linewidth=2.5, label=f"{kind}{count}"))
    diagram.set(
        xlabel="born at radius (unit of the recovered body)",
        ylabel="filled at radius (same unit)",
        xlim=(-0.03 * end, end),
        ylim=(-0.03 * end, 1.03 * end),
        aspect="equal",
        title="Each hole is a point; far from the line is real",
    )
    bars.set(
        xlabel="radius of the balls round the kernels (unit of the recovered body)",
        xlim=(-0.01 * end, end),
        yticks=[],
        title="How long each lives",
    )
    bars.invert_yaxis()
    bars.spines["left"].set_visible(False)
    bars.legend(handles=handles, loc="center right")
    return figure
