"""Pictures of what the agent feels: target sensations on its skin, and the kernels behind them."""

from __future__ import annotations

import numpy as np
import trimesh
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from selftouch_drake.show.scene import (
    View,
    add_scene,
    balls,
    draw,
    fit_height,
    scale_bar,
    share_scale,
    surface,
    visible,
)
from selftouch_drake.show.style import BLUE, GREEN, MUTED, PRESSURE, SKIN, styled


@styled
def sensations(
    vertices: np.ndarray,
    faces: np.ndarray,
    p_BS: np.ndarray,
    target_sensations: np.ndarray,
    *,
    num_shown: int = 4,
) -> Figure:
    """A few target sensations on the skin, each seen from its own side.

    Args:
        vertices: `(V, 3)` m, of the outer surface.
        faces: `(F, 3)` indices, outward.
        p_BS: `(S, 3)` m, receptors.
        target_sensations: `(K, S)` unit L2 norm.
        num_shown: how many are drawn; they are as unlike as can be.
    """
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    _, nearest = mesh.kdtree.query(p_BS)
    outward = mesh.vertex_normals[nearest]
    size = np.ptp(vertices, axis=0).max()
    chosen = far_apart(target_sensations, num_shown)
    norm = Normalize(0.0, float(target_sensations[chosen].max()) or 1.0)

    figure = Figure(figsize=(10.5, 3.2), layout="constrained")
    grid = figure.add_gridspec(1, len(chosen))
    body = surface(vertices, faces, SKIN)
    for column, kernel in enumerate(chosen):
        felt = target_sensations[kernel]
        direction = felt @ outward
        height = np.degrees(np.arcsin(direction[2] / max(np.linalg.norm(direction), 1e-9)))
        view = View.facing(direction + 1e-9, elevation=float(np.clip(height, -35.0, 50.0)))
        ax = add_scene(figure, grid[column], f"sensation {kernel}")
        draw(ax, view, body)
        seen = visible(p_BS, vertices, faces, view)
        colors = PRESSURE(norm(felt[seen]))[:, :3]
        draw(ax, view, balls(p_BS[seen], 0.026 * size, colors), zorder=2)
    share_scale(figure.axes)
    fit_height(figure)
    scale_bar(figure.axes[0], 0.1, "10 cm")
    figure.colorbar(
        ScalarMappable(norm, PRESSURE), ax=figure.axes, label="share of the sensation", shrink=0.7
    )
    return figure


@styled
def kernels(sizes: np.ndarray, error: np.ndarray, strength: np.ndarray) -> Figure:
    """How many motor configurations a kernel set holds, how alike they feel, and how firmly.

    Args:
        sizes: `(K,)` configurations in each kernel set.
        error: `(R,)` cosine distance from the sensation felt to the target sensation.
        strength: `(R,)` N, L2 norm of the sensation felt.
    """
    figure = Figure(figsize=(10.0, 2.7), layout="constrained")
    size, likeness, force = figure.subplots(1, 3)
    panels = (
        (size, sizes, "configurations in a kernel set", "kernel sets", BLUE),
        (likeness, error, "cosine distance to the target sensation", "configurations", BLUE),
        (force, strength, "strength of the touch (N)", "configurations", GREEN),
    )
    for ax, values, xlabel, ylabel, color in panels:
        top = float(np.quantile(values, 0.995))
        ax.hist(np.minimum(values, top), bins=40, color=color)
        middle = float(np.median(values))
        ax.axvline(middle, color=MUTED, linewidth=1.0)
        ax.set(xlabel=xlabel, ylabel=ylabel, title=f"median {middle:.3g}")
        ax.set_xlim(left=0.0)
    return figure


def far_apart(rows: np.ndarray, count: int) -> np.ndarray:
    """`(count,)` rows as far from one another as can be, from the first on."""
    chosen = [0]
    distance = np.full(len(rows), np.inf)
    while len(chosen) < min(count, len(rows)):
        distance = np.minimum(distance, np.linalg.norm(rows - rows[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    return np.array(chosen)
