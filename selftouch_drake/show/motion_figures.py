"""Pictures of acting: a plan (paper, figure 4), what was felt, how it was tracked."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

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
from selftouch_drake.show.style import (
    BLUE,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    PRESSURE,
    SKIN,
    VERMILION,
    styled,
)

# m between the dots of a path.
_DOT_SPACING = 0.008
# Share of its strongest receptor that another must reach to be drawn.
_SILENT = 0.03


@styled
def plan_path(
    vertices: np.ndarray, faces: np.ndarray, path: np.ndarray, waypoints: np.ndarray
) -> Figure:
    """A planned motion round the translucent body, from two sides (paper, figure 4).

    Args:
        vertices: `(V, 3)` m, of the outer surface.
        faces: `(F, 3)` indices, outward.
        path: `(T, fingers, 3)` m, fingertips along the smooth path.
        waypoints: `(W, fingers, 3)` m, fingertips at the known configurations it came from.
    """
    size = np.ptp(vertices, axis=0).max()
    direction = path[:, 0].mean(axis=0) - vertices.mean(axis=0) + 1e-9
    first = View.facing(direction)
    views = (first, View(first.elevation, first.azimuth + 110.0))
    figure = Figure(figsize=(9.4, 4.4), layout="constrained")
    grid = figure.add_gridspec(1, 2)
    for column, view in enumerate(views):
        ax = add_scene(figure, grid[column])
        # Behind the body's front: the same marks, veiled.
        for finger in range(path.shape[1]):
            dots = evenly_spaced(path[:, finger], _DOT_SPACING)
            ends = path[[0, -1], finger]
            _marks(ax, view, dots, waypoints[:, finger], ends, size, zorder=1)
        draw(ax, view, surface(vertices, faces, SKIN), opacity=0.55, zorder=2)
        outline(ax, view, vertices, faces, zorder=3)
        for finger in range(path.shape[1]):
            dots = evenly_spaced(path[:, finger], _DOT_SPACING)
            known, ends = waypoints[:, finger], path[[0, -1], finger]
            seen = [visible(p, vertices, faces, view) for p in (dots, known)]
            shown = visible(ends, vertices, faces, view)
            ends = np.where(shown[:, None], ends, np.nan)
            _marks(ax, view, dots[seen[0]], known[seen[1]], ends, size, zorder=4)
    share_scale(figure.axes)
    fit_height(figure, margin=0.5)
    ax = figure.axes[0]
    scale_bar(ax, 0.1, "10 cm")
    handles = [
        ax.scatter([], [], s=45, color=GREEN, label="start"),
        ax.scatter([], [], s=45, color=BLUE, label="goal"),
        ax.scatter([], [], s=28, color=VERMILION, marker="x", label="known configurations"),
        ax.scatter([], [], s=6, color=BLUE, label="smooth path"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


@styled
def felt_and_predicted(time_s: np.ndarray, predicted: np.ndarray, felt: np.ndarray) -> Figure:
    """What was felt along an executed plan, what had been predicted, and how alike they are.

    Args:
        time_s: `(T,)` s.
        predicted: `(T, S)` any scale.
        felt: `(T, S)` N.
    """
    felt_shape, predicted_shape = _unit(felt), _unit(predicted)
    loudness = np.maximum(felt_shape.max(axis=0), predicted_shape.max(axis=0))
    active = np.flatnonzero(loudness > _SILENT)
    when = (felt_shape + predicted_shape)[:, active]
    when = (time_s[:, None] * when).sum(axis=0) / np.maximum(when.sum(axis=0), 1e-12)
    active = active[np.argsort(when)]
    cosine = (felt_shape * predicted_shape).sum(axis=1)
    touching = np.any(felt, axis=1)

    figure = Figure(figsize=(9.0, 6.2), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True, height_ratios=(1.5, 1.5, 0.8))
    extent = (time_s[0], time_s[-1], len(active), 0)
    for ax, sensation, title in (
        (axes[0], predicted_shape, "Predicted before moving"),
        (axes[1], felt_shape, "Felt while moving"),
    ):
        image = ax.imshow(
            sensation[:, active].T, aspect="auto", extent=extent, cmap=PRESSURE, vmin=0, vmax=1,
            interpolation="nearest",
        )  # fmt: skip
        ax.set(ylabel="receptor, in order of touch", title=title)
    figure.colorbar(image, ax=list(axes[:2]), label="share of the sensation", aspect=40)
    axes[2].plot(time_s, np.where(touching, cosine, np.nan), color=BLUE, linewidth=1.4)
    _shade_where(axes[2], time_s, ~touching, "no contact")
    mean = float(cosine[touching].mean()) if touching.any() else float("nan")
    axes[2].set(
        xlabel="time (s)", ylabel="cosine", ylim=(-0.03, 1.05), xlim=(time_s[0], time_s[-1]),
        title=f"Likeness: 1 is the same sensation; mean in contact {mean:.3f}",
    )  # fmt: skip
    return figure


@styled
def contact_and_tracking(
    time_s: np.ndarray, q: np.ndarray, q_measured: np.ndarray, felt: np.ndarray
) -> Figure:
    """The force on the skin and the tracking of every joint along an executed plan.

    Args:
        time_s: `(T,)` s.
        q: `(T, J)` rad, planned.
        q_measured: `(T, J)` rad.
        felt: `(T, S)` N.
    """
    force, touching = felt.sum(axis=1), np.any(felt, axis=1)
    error = 1e3 * (q_measured - q)
    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    pressing, moving, tracking = figure.subplots(3, 1, sharex=True)
    pressing.plot(time_s, force, color=INK, linewidth=1.2)
    pressing.fill_between(time_s, force, color=ORANGE, alpha=0.35, linewidth=0)
    _shade_where(pressing, time_s, ~touching, "no contact")
    pressing.set(
        ylabel="force (N)", ylim=(0, None), title=f"In contact {touching.mean():.1%} of the time"
    )
    for joint in range(q.shape[1]):
        moving.plot(time_s, q[:, joint], linewidth=1.2, label=f"joint {joint + 1}")
        tracking.plot(time_s, error[:, joint], linewidth=1.0)
    rms = float(np.sqrt(np.mean(np.square(error))))
    moving.set(ylabel="planned angle (rad)", title="The plan")
    tracking.axhline(0.0, color=MUTED, linewidth=0.6)
    tracking.set(
        xlabel="time (s)", ylabel="error (mrad)", xlim=(time_s[0], time_s[-1]),
        title=f"Measured less planned angle: RMS {rms:.2g} mrad",
    )  # fmt: skip
    figure.legend(
        handles=moving.get_lines(), loc="outside lower center", ncols=q.shape[1], fontsize=8
    )
    return figure


@styled
def learning_curve(naive: np.ndarray, remembering: np.ndarray, num_tries: np.ndarray) -> Figure:
    """How first tries get better with rehearsals of other pairs.

    Args:
        naive: `(N,)` share of the time in contact at the first try of each pair, without memory.
        remembering: `(N,)` the same with the memory of all rehearsals before.
        num_tries: `(N,)` of the rehearsal of each pair.
    """
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    better, tries = figure.subplots(1, 2, width_ratios=(1.6, 1.0))
    pairs = np.arange(1, len(naive) + 1)
    for lost, label, color in (
        (1.0 - naive, "without memory", MUTED),
        (1.0 - remembering, "remembering earlier pairs", BLUE),
    ):
        better.plot(pairs, np.cumsum(lost), color=color, label=label, linewidth=1.6)
    better.set(
        xlabel="pairs so far", ylabel="motions' worth of time without contact",
        xlim=(0.5, pairs[-1] + 0.5), ylim=(0, None), title="First tries, added up",
    )  # fmt: skip
    better.legend(loc="upper left")
    counts = np.bincount(num_tries, minlength=2)[1:]
    tries.bar(np.arange(1, len(counts) + 1), counts, color=BLUE)
    tries.set(xlabel="tries", ylabel="pairs", title="Until contact is never lost")
    tries.set_xticks(np.arange(1, len(counts) + 1))
    return figure


def evenly_spaced(path: np.ndarray, spacing: float) -> np.ndarray:
    """`(N, 3)` points along a polyline `(T, 3)`, `spacing` apart, both in metres."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0.0, length[-1], 2 + int(length[-1] / spacing))
    return np.stack([np.interp(at, length, axis) for axis in path.T], axis=1)


def _marks(ax, view, dots, known, ends, size, *, zorder):
    ax.scatter(*view.project(dots)[:, :2].T, s=5, color=BLUE, linewidths=0, zorder=zorder)
    x, y = view.project(known)[:, :2].T
    ax.scatter(x, y, s=30, color=VERMILION, marker="x", linewidths=1.5, zorder=zorder + 0.1)
    for end, color in zip(ends, (GREEN, BLUE), strict=True):
        if np.isfinite(end).all():
            draw(ax, view, balls(end[None], 0.03 * size, color, detail=3), zorder=zorder + 0.2)


def _shade_where(ax, time_s: np.ndarray, mask: np.ndarray, label: str) -> None:
    if mask.any():
        ax.fill_between(
            time_s, 0, 1, where=mask, transform=ax.get_xaxis_transform(), color=VERMILION,
            alpha=0.25, linewidth=0, label=label,
        )  # fmt: skip
        ax.legend(loc="upper right")


def _unit(rows: np.ndarray) -> np.ndarray:
    norm = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.divide(rows, norm, out=np.zeros(rows.shape), where=norm > 0)
