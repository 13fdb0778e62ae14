"""The paper's figure 4: a plan between two poses of the fingers, round the hollow inside."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from selftouch_drake.lazy import trimesh
from selftouch_drake.show.page.meshes import balls, surface
from selftouch_drake.show.page.scene import add_scene, draw, outline, scale_bar
from selftouch_drake.show.style import BLUE, GREEN, INK, MUTED, PALE, SKIN, SKY, VERMILION, styled
from selftouch_drake.show.view import View

# Poses that are drawn between the known ones.
_NUM_POSES = 90
# m, between the points that stand for the surface when depth is measured.
_SURFACE_SPACING = 0.005


@styled
def plan_poses(
    vertices: np.ndarray,
    faces: np.ndarray,
    thickness: float,
    path: np.ndarray,
    known: np.ndarray,
    *,
    embedding: np.ndarray,
    edges: np.ndarray,
    nodes: np.ndarray,
) -> Figure:
    """A plan on the graph, in space, and how deep it goes (paper, figure 4).

    Args:
        vertices: `(V, 3)` m, of the outer surface.
        faces: `(F, 3)` indices, outward.
        thickness: m, of the skin; deeper is the cavity.
        path: `(T, fingers, 3)` m, fingertips along the interpolated motion.
        known: `(W, fingers, 3)` m, fingertips in the known configurations it came from.
        embedding: `(K, 3)` the kernels as the agent lays them out, any unit.
        edges: `(E, 2)` pairs of kernels.
        nodes: `(W,)` kernels of the route; negative ones are left out.
    """
    figure = Figure(figsize=(10.4, 4.0), layout="constrained")
    grid = figure.add_gridspec(1, 3, width_ratios=(1.0, 1.25, 1.1))
    _route(add_scene(figure, grid[0], "The route on the graph"), embedding, edges, nodes)
    _poses(add_scene(figure, grid[1], "The poses in space"), vertices, faces, path, known)
    _depth(figure.add_subplot(grid[2]), vertices, faces, thickness, path)
    handles = [
        figure.axes[1].scatter([], [], s=40, color=GREEN, label="start"),
        figure.axes[1].scatter([], [], s=40, color=BLUE, label="goal"),
        figure.axes[1].scatter([], [], s=28, color=VERMILION, marker="x", label="known poses"),
        figure.axes[1].scatter([], [], s=6, color=SKY, label="interpolated poses"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


def depth_below_surface(vertices: np.ndarray, faces: np.ndarray, p_WF: np.ndarray) -> np.ndarray:
    """`(N,)` m, how deep points `(N, 3)` lie below a closed surface; negative outside."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    # No point is shared: each carries the normal of its face.
    points, corners, face = trimesh.remesh.subdivide_to_size(
        vertices[faces].reshape(-1, 3),
        np.arange(3 * len(faces)).reshape(-1, 3),
        max_edge=_SURFACE_SPACING,
        return_index=True,
    )
    centres = points[corners].mean(axis=1)
    distance, nearest = cKDTree(centres).query(p_WF)
    inward = np.sum((centres[nearest] - p_WF) * mesh.face_normals[face[nearest]], axis=1)
    return np.where(inward > 0, distance, -distance)


def _route(ax: Axes, embedding: np.ndarray, edges: np.ndarray, nodes: np.ndarray) -> None:
    nodes = nodes[nodes >= 0]
    centred = embedding - embedding.mean(axis=0)
    view = View.facing(centred[nodes].mean(axis=0) + 1e-9)
    picture = view.project(centred)[:, :2]
    ax.add_collection(LineCollection(list(picture[edges]), colors=PALE, linewidths=0.4, zorder=1))
    x, y = picture[nodes].T
    ax.plot(x, y, color=VERMILION, linewidth=1.4, zorder=2)
    ax.scatter(x, y, s=16, color=VERMILION, zorder=3)
    for end, color in ((0, GREEN), (-1, BLUE)):
        ax.scatter(x[end], y[end], s=60, color=color, zorder=4)
    ax.autoscale_view()


def _poses(
    ax: Axes, vertices: np.ndarray, faces: np.ndarray, path: np.ndarray, known: np.ndarray
) -> None:
    middle = path.mean(axis=(0, 1)) - vertices.mean(axis=0)
    view = View.facing(middle + 1e-9)
    view = View(view.elevation, view.azimuth + 35.0)
    draw(ax, view, surface(vertices, faces, SKIN), opacity=0.35, zorder=1)
    outline(ax, view, vertices, faces, zorder=1.5)
    # Even in space, not in time: a motion dwells at its ends.
    length = np.linalg.norm(np.diff(path, axis=0), axis=2).sum(axis=1)
    length = np.concatenate([[0.0], np.cumsum(length)])
    rows = np.searchsorted(length, np.linspace(0.0, length[-1], _NUM_POSES))
    between = view.project(path[rows.clip(0, len(path) - 1)])[..., :2]
    crosses = view.project(known)[..., :2]
    # The fingers are one rigid hand: a line joins them.
    ax.add_collection(LineCollection(list(between), colors=SKY, linewidths=0.6, zorder=2))
    ax.add_collection(LineCollection(list(crosses), colors=VERMILION, linewidths=1.0, zorder=3))
    x, y = between.reshape(-1, 2).T
    ax.scatter(x, y, s=5, color=SKY, linewidths=0, zorder=2.5)
    x, y = crosses.reshape(-1, 2).T
    ax.scatter(x, y, s=26, color=VERMILION, marker="x", zorder=3.5)
    size = np.ptp(vertices, axis=0).max()
    for pose, color in ((path[0], GREEN), (path[-1], BLUE)):
        draw(ax, view, balls(pose, 0.03 * size, color, detail=3), zorder=4)
        ax.plot(*view.project(pose)[:, :2].T, color=color, linewidth=2.0, zorder=3.9)
    ax.autoscale_view()
    scale_bar(ax)


def _depth(
    ax: Axes, vertices: np.ndarray, faces: np.ndarray, thickness: float, path: np.ndarray
) -> None:
    done = np.linspace(0.0, 100.0, len(path))
    depth = np.stack(
        [100 * depth_below_surface(vertices, faces, p) for p in path.transpose(1, 0, 2)]
    )
    lowest = max(1.6 * 100 * thickness, depth.max() + 1.0)
    ax.axhspan(0.0, 100 * thickness, color=SKIN, alpha=0.6, linewidth=0)
    ax.axhspan(100 * thickness, lowest, color=INK, alpha=0.12, linewidth=0)
    for finger, line in enumerate(depth):
        ax.plot(done, line, color=(BLUE, VERMILION)[finger % 2], label=f"finger {finger + 1}")
    for y, text in ((50 * thickness, "skin"), (50 * thickness + lowest / 2, "cavity")):
        ax.annotate(text, (99, y), ha="right", va="center", color=MUTED)
    ax.set(
        xlabel="motion (% of its time)", ylabel="depth of the fingertip's centre (cm)",
        xlim=(0, 100), ylim=(lowest, min(depth.min(), 0.0) - 0.5), title="How deep the fingers go",
    )  # fmt: skip
    if len(depth) > 1:
        ax.legend(loc="upper left")
