"""Pictures of the body model: the skeleton that the agent found, beside that of the robot."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from selftouch_drake.evaluation.body_model import (
    Similarity,
    angles_between,
    found_axes,
    onto_robot,
    true_axes,
)
from selftouch_drake.run.directory import MissingError
from selftouch_drake.show.page.scene import add_scene, draw, finish_row, share_scale, surface
from selftouch_drake.show.run_data import RunData
from selftouch_drake.show.skeleton import Skeleton, found_skeleton, true_skeleton
from selftouch_drake.show.skins import all_moved, as_one
from selftouch_drake.show.style import (
    BLUE,
    INK,
    MUTED,
    ORANGE,
    RECOVERED,
    SKIN,
    VERMILION,
    View,
    styled,
)

# Candidate postures for the picture.
_NUM_POSTURES = 60
# Length of the bar that shows an axis, as a share of the picture's.
_AXIS = 0.11


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fitted:
    """The skeleton that was found, fitted to the true one, in one posture.

    Attributes:
        q: `(J,)` the posture.
        onto: the similarity that fits it.
        found: the skeleton that was found, fitted, m.
        true: that of the robot, m.
        off: `(J,)` degrees between found and true axes; NaN where a joint has none.
    """

    q: np.ndarray
    onto: Similarity
    found: Skeleton
    true: Skeleton
    off: np.ndarray


def fitted_skeleton(data: RunData) -> Fitted:
    """Fits the skeleton that was found to that of the robot.

    Raises:
        MissingError: there is no model, no part of it was accepted, or nobody knows the robot.
    """
    model, robot, truth = data.accepted_model, data.world.robot, data.kernel_truth
    q = shown_posture(data)
    onto = onto_robot(model, truth, robot.skin_positions(q[None])[0], q)
    if onto is None:
        raise MissingError("too few kernels have a place in the body model")
    off = angles_between(found_axes(model, q).moved(onto), true_axes(robot.kinematics, q))
    return Fitted(
        q=q,
        onto=onto,
        found=found_skeleton(model, q).moved(onto),
        true=true_skeleton(robot, truth, q),
        off=off,
    )


def shown_posture(data: RunData) -> np.ndarray:
    """`(J,)` a stored touch in which the joints are well clear of the skin, by the model alone."""
    stored = data.representation.kernel_q
    best, farthest = stored[0].astype(float), -np.inf
    for q in stored[:: max(len(stored) // _NUM_POSTURES, 1)].astype(float):
        skeleton = found_skeleton(data.accepted_model, q)
        middles = np.array([places.mean(axis=0) for places in skeleton.skins])
        away = np.linalg.norm(skeleton.place[:, None] - middles, axis=2).mean()
        if away > farthest:
            best, farthest = q, away
    return best


@styled
def skeleton(data: RunData) -> Figure:
    """The skeleton that the agent found, beside the robot's; alone if nobody knows the robot."""
    try:
        fitted = fitted_skeleton(data)
    except MissingError:
        return _alone(found_skeleton(data.accepted_model, shown_posture(data)))
    skin = as_one(all_moved(data.skins, data.world.robot.skin_positions(fitted.q[None])[0]))
    mesh, view = surface(skin.vertices, skin.faces, SKIN), View()
    figure = Figure(figsize=(10.5, 4.2), layout="constrained")
    grid = figure.add_gridspec(1, 3, wspace=0.04)

    ax = add_scene(figure, grid[0])
    draw(ax, view, mesh, opacity=0.45)
    _draw_skeleton(ax, view, fitted.true, INK)
    ax.set_title(f"The robot\n{len(fitted.true.joints)} joints", loc="center")

    ax = add_scene(figure, grid[1])
    _draw_kernels(ax, view, fitted.found.skins)
    _draw_skeleton(ax, view, fitted.found, BLUE)
    moved = "turned, mirrored and scaled" if fitted.onto.mirrors else "turned and scaled"
    ax.set_title(f"The skeleton the agent found\n{moved} to fit", loc="center")

    ax = add_scene(figure, grid[2])
    draw(ax, view, mesh, opacity=0.45)
    _draw_skeleton(ax, view, fitted.true, INK, numbers=False)
    _draw_skeleton(ax, view, fitted.found, BLUE, numbers=False)
    off = fitted.off[np.isfinite(fitted.off)]
    error = (
        f"\naxes {np.median(off):.1f}° off (median), {off.max():.1f}° (worst)" if len(off) else ""
    )
    ax.set_title(f"Both{error}", loc="center")

    finish_row(figure)
    return figure


def _alone(found: Skeleton) -> Figure:
    """The skeleton in a frame and unit of its own, its longest side level, from two sides."""
    points = found.points
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    axes[2] *= np.sign(np.linalg.det(axes))
    scale = 1.0 / float(np.ptp(points @ axes.T, axis=0).max())
    level = Similarity(scale=scale, rotation=axes, shift=-scale * axes @ points.mean(axis=0))
    figure = Figure(figsize=(9.4, 4.4), layout="constrained")
    grid = figure.add_gridspec(1, 2)
    for column, azimuth in enumerate((-70.0, 20.0)):
        ax, view = add_scene(figure, grid[column]), View(azimuth=azimuth)
        _draw_kernels(ax, view, found.moved(level).skins)
        _draw_skeleton(ax, view, found.moved(level), BLUE)
    figure.suptitle("The skeleton the agent found, in a unit of its own, from two sides")
    share_scale(figure.axes)
    return figure


def _draw_kernels(ax: Axes, view: View, skins: Sequence[np.ndarray]) -> None:
    for places in skins:
        x, y, _ = view.project(places).T
        ax.scatter(x, y, s=3.0, color=RECOVERED, linewidths=0, zorder=1)


def _draw_skeleton(
    ax: Axes, view: View, skeleton: Skeleton, color: str, *, numbers: bool = True
) -> None:
    """Draws links, axes, joints with their numbers from 1 on, and what touches."""
    points = view.project(skeleton.points)[:, :2]
    length = _AXIS * float(np.ptp(points, axis=0).max())
    bones = list(view.project(skeleton.bones)[..., :2])
    ax.add_collection(LineCollection(bones, colors=color, linewidths=1.8, alpha=0.75, zorder=4))
    known = np.isfinite(skeleton.direction).all(axis=1)
    half = 0.5 * length * skeleton.direction[known]
    ends = np.stack([skeleton.place[known] - half, skeleton.place[known] + half], axis=1)
    bars = list(view.project(ends)[..., :2])
    ax.add_collection(LineCollection(bars, colors=ORANGE, linewidths=2.4, zorder=5))
    x, y, _ = view.project(skeleton.place).T
    for kind, marker in ((~skeleton.slides, "o"), (skeleton.slides, "s")):
        ax.scatter(x[kind], y[kind], s=22, marker=marker, color=color, linewidths=0, zorder=6)
    x_tip, y_tip, _ = view.project(skeleton.touchers).T
    ax.scatter(x_tip, y_tip, s=30, color=VERMILION, linewidths=0, zorder=7)
    if numbers:
        _write_numbers(ax, np.stack([x, y], axis=1), skeleton.joints, length)
    ax.autoscale_view()


def _write_numbers(ax: Axes, at: np.ndarray, joints: np.ndarray, length: float) -> None:
    """Writes the numbers of joints beside them; those at one place in one text."""
    left = list(range(len(at)))
    while left:
        near = [n for n in left if np.linalg.norm(at[n] - at[left[0]]) < 0.35 * length]
        left = [n for n in left if n not in near]
        text = ", ".join(str(joints[n] + 1) for n in near)
        ax.annotate(
            text,
            at[near[0]],
            (6, 6),
            textcoords="offset points",
            fontsize=7.5,
            color=MUTED,
            zorder=8,
        )
