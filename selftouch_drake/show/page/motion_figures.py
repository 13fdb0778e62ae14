"""Pictures of acting: the path over the skin, what was felt along it, and a whole life."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from selftouch_drake.agent.body_model.growth import SURE_AXIS
from selftouch_drake.agent.lifelong.expectation import with_unit_norm
from selftouch_drake.show.page.scene import (
    add_scene,
    balls,
    draw,
    finish_row,
    outline,
    surface,
    visible,
)
from selftouch_drake.show.run_data import RunData
from selftouch_drake.show.skins import SkinPath, SkinSurface, evenly_spaced
from selftouch_drake.show.style import (
    BLUE,
    GREEN,
    ORANGE,
    PRESSURE,
    RECOVERED,
    SKIN,
    SKY,
    VERMILION,
    View,
    styled,
)

# m between the dots of a path.
_DOT_SPACING = 0.008
# Skins in a row: more are too small to be read.
_MOST_SKINS = 4
# Share of its strongest receptor that another must reach to be drawn.
_SILENT = 0.03


@styled
def plan_path(
    skins: Sequence[SkinSurface],
    paths: Sequence[SkinPath],
    known: Sequence[SkinPath],
    num_rows: int,
) -> Figure:
    """A planned motion over translucent skins (paper, figure 4).

    Each kernel set on the way gives one posture, which touches anywhere in the patch of skin that
    feels alike: so the path wanders from side to side.

    A plan on one skin is shown from two sides; one over several, skin by skin, in the order in
    which it touches them.

    Args:
        skins: in one frame.
        paths: of the smooth motion, in the same frame.
        known: of the known configurations that it came from.
        num_rows: instants of the motion.
    """
    touched = sorted(paths, key=lambda path: path.rows[0])
    numbers = list(dict.fromkeys(path.skin for path in touched))[:_MOST_SKINS]
    panels = []
    for number in numbers:
        over = np.concatenate([path.points for path in paths if path.skin == number])
        middle = skins[number].vertices.mean(axis=0)
        first = View.facing(over.mean(axis=0) - middle + 1e-9)
        second = View(first.elevation, first.azimuth + 110.0)
        panels.append((number, first))
        if len(numbers) == 1:
            panels.append((number, second))
    figure = Figure(figsize=(9.4, 5.4), layout="constrained")
    grid = figure.add_gridspec(1, len(panels))
    for column, (number, view) in enumerate(panels):
        title = skins[number].name if len(numbers) > 1 else ""
        ax = add_scene(figure, grid[column], title)
        # Several skins, far apart, are each shown round their own middle.
        pose = np.hstack([np.eye(3), -skins[number].vertices.mean(axis=0)[:, None]])
        here, crosses = (
            [path.moved(pose) for path in of if path.skin == number] for of in (paths, known)
        )
        _draw_paths(ax, view, skins[number].moved(pose), here, crosses, num_rows)
    finish_row(figure)
    ax = figure.axes[0]
    marks = (
        (45, GREEN, "o", "start"),
        (45, BLUE, "o", "goal"),
        (28, VERMILION, "x", "a posture of each kernel set on the way"),
        (6, BLUE, "o", "the motion"),
    )
    handles = [
        ax.scatter([], [], s=size, color=color, marker=marker, label=label)
        for size, color, marker, label in marks
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FollowedWay:
    """A motion as it passes over one skin.

    Attributes:
        title: what is said of it.
        path: in the frame of the skin.
        num_rows: instants of the motion.
    """

    title: str
    path: SkinPath
    num_rows: int


@styled
def plan_ways(
    skin: SkinSurface, ways: Sequence[FollowedWay], shortest: np.ndarray | None
) -> Figure:
    """One plan before practice, practised and executed, beside the shortest way on the true skin.

    Args:
        skin: the surface, in its own frame.
        ways: of the plan.
        shortest: `(n, 3)` m, the shortest way; None if it is not known.
    """
    middle = skin.vertices.mean(axis=0)
    pose = np.hstack([np.eye(3), -middle[:, None]])
    over = np.concatenate([way.path.points for way in ways])
    view = View.facing(over.mean(axis=0) - middle + 1e-9)
    figure = Figure(figsize=(3.2 * len(ways), 3.6), layout="constrained")
    grid = figure.add_gridspec(1, len(ways))
    for column, way in enumerate(ways):
        ax = add_scene(figure, grid[column], way.title)
        line = None if shortest is None else evenly_spaced(shortest - middle, _DOT_SPACING / 2)
        path = way.path.moved(pose)
        _draw_paths(ax, view, skin.moved(pose), [path], [], way.num_rows, shortest=line)
    finish_row(figure)
    marks = [(45, GREEN, "start"), (45, BLUE, "end"), (6, BLUE, "the motion")]
    if shortest is not None:
        marks.append((6, ORANGE, "the shortest way on the true skin"))
    handles = [
        figure.axes[0].scatter([], [], s=size, color=color, label=label)
        for size, color, label in marks
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def _draw_paths(
    ax: Axes,
    view: View,
    skin: SkinSurface,
    paths: Sequence[SkinPath],
    known: Sequence[SkinPath],
    num_rows: int,
    shortest: np.ndarray | None = None,
) -> None:
    none = np.zeros((0, 3))
    dots = np.concatenate([none, *(path.dots(_DOT_SPACING) for path in paths)])
    others = none if shortest is None else shortest
    crosses = np.concatenate([none, *(path.points for path in known)])
    ends = [
        (end[None], color)
        for path in paths
        for row, color in ((0, GREEN), (num_rows - 1, BLUE))
        if (end := path.at(row)) is not None
    ]

    def mark(shown: Callable[[np.ndarray], np.ndarray], zorder: float) -> None:
        x, y = view.project(shown(dots))[:, :2].T
        ax.scatter(x, y, s=5, color=BLUE, linewidths=0, zorder=zorder)
        x, y = view.project(shown(others))[:, :2].T
        ax.scatter(x, y, s=4, color=ORANGE, linewidths=0, zorder=zorder + 0.05)
        x, y = view.project(shown(crosses))[:, :2].T
        ax.scatter(x, y, s=30, color=VERMILION, marker="x", linewidths=1.5, zorder=zorder + 0.1)
        for end, color in ends:
            ball = balls(shown(end), 0.03 * skin.extent, color, detail=3)
            draw(ax, view, ball, zorder=zorder + 0.2)

    # Behind the body's front: the same marks, veiled.
    mark(lambda points: points, 1)
    draw(ax, view, surface(skin.vertices, skin.faces, SKIN), opacity=0.55, zorder=2)
    outline(ax, view, skin.vertices, skin.faces, zorder=3)
    mark(lambda points: points[visible(points, skin.vertices, skin.faces, view)], 4)


@styled
def felt_and_predicted(data: RunData) -> Figure:
    """What was felt along that plan, what had been predicted, and how alike they are."""
    execution = data.execution(*data.shown_pair)
    time_s = execution.motion.time_s
    felt_shape, predicted_shape = map(with_unit_norm, (execution.felt, execution.motion.predicted))
    loudness = np.maximum(felt_shape.max(axis=0), predicted_shape.max(axis=0))
    active = np.flatnonzero(loudness > _SILENT)
    when = (felt_shape + predicted_shape)[:, active]
    when = (time_s[:, None] * when).sum(axis=0) / np.maximum(when.sum(axis=0), 1e-12)
    active = active[np.argsort(when)]
    cosine = (felt_shape * predicted_shape).sum(axis=1)
    both = execution.felt.any(axis=1) & execution.motion.predicted.any(axis=1)

    figure = Figure(figsize=(9.0, 6.2), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True, height_ratios=(1.5, 1.5, 0.8))
    extent = (time_s[0], time_s[-1], len(active), 0)
    for ax, sensation, title in (
        (axes[0], predicted_shape, "Predicted"),
        (axes[1], felt_shape, "Felt while moving, under dynamics"),
    ):
        image = ax.imshow(
            sensation[:, active].T, aspect="auto", extent=extent, cmap=PRESSURE, vmin=0, vmax=1,
            interpolation="nearest",
        )  # fmt: skip
        ax.set(ylabel="receptor, in order of touch", title=title)
    figure.colorbar(image, ax=list(axes[:2]), label="share of the sensation", aspect=40)
    axes[2].plot(time_s, np.where(both, cosine, np.nan), color=BLUE, linewidth=1.4)
    touching, expected = execution.felt.any(axis=1), execution.motion.touching
    for where, label, color in (
        (expected & ~touching, "no contact", VERMILION),
        (~expected, "in the air", SKY),
    ):
        if where.any():
            axes[2].fill_between(
                time_s, 0, 1, where=where, transform=axes[2].get_xaxis_transform(), color=color,
                alpha=0.25, linewidth=0, label=label,
            )  # fmt: skip
            axes[2].legend(loc="upper right")
    mean = float(cosine[both].mean()) if both.any() else float("nan")
    axes[2].set(
        xlabel="time (s)", ylabel="cosine", ylim=(-0.03, 1.05), xlim=(time_s[0], time_s[-1]),
        title=f"Likeness: 1 is the same sensation; mean in contact {mean:.3f}",
    )  # fmt: skip
    return figure


@styled
def life(data: RunData) -> Figure:
    """Coverage, shape error, contact and surprise; changes of the body, and when it noticed."""
    curves = data.life
    at = curves.touches
    panels = [
        ("receptors that have felt", "%", at, 100 * curves.coverage, BLUE),
        ("shape error, worst skin", "% of the size", at, 100 * curves.error, VERMILION),
        ("plans in contact, before practice", "%", at, 100 * curves.contact, GREEN),
        ("surprise", "cosine distance", curves.block_touches, curves.surprise, ORANGE),
    ]
    if not np.isfinite([curves.error, curves.contact]).any():
        del panels[1:3]  # nobody knows the truth
    rows = len(panels) // 2
    figure = Figure(figsize=(10.5, 2.5 * rows), layout="constrained")
    axes: list[Axes] = figure.subplots(rows, 2, sharex=True).ravel().tolist()
    for ax, (title, unit, touches, values, color) in zip(axes, panels, strict=True):
        ax.plot(touches, values, color=color, marker="." if len(touches) < 50 else "")
        for moments, style, label in (
            (curves.changed, "-", "the body changes"),
            (curves.noticed, ":", "the agent notices"),
        ):
            for number, moment in enumerate(moments):
                named = label if number == 0 else None
                ax.axvline(moment, color="0.4", linestyle=style, linewidth=1.0, label=named)
        ax.set_title(title)
        ax.set_ylabel(unit)
        if np.isfinite(values).any():
            ax.set_ylim(bottom=0)
    for ax in axes[-2:]:
        ax.set_xlabel("touches")
    if len(curves.changed) or len(curves.noticed):
        axes[-1].legend(loc="upper left", fontsize="small")
    return figure


@styled
def growth(data: RunData) -> Figure:
    """How sure axes and receptors were in the first touches, and since when each thing stands."""
    grown = data.growth
    names = data.run.joint_names() or [str(n + 1) for n in range(grown.axis_sigma.shape[1])]
    figure = Figure(figsize=(10.5, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2, sharex=True)
    accepted = grown.accepted > 0
    for joint, at in enumerate(grown.axes_stand()):
        sigma = grown.axis_sigma[:, joint]
        if not np.isfinite(sigma).any():
            continue
        (line,) = left.plot(grown.touches, sigma, marker=".", label=names[joint])
        left.plot(grown.touches[~accepted], sigma[~accepted], "x", color=line.get_color())
        if at is not None:
            left.axvline(at, color=line.get_color(), linewidth=0.8, alpha=0.5)
    left.axhline(SURE_AXIS, color="0.4", linestyle=":", linewidth=1.0)
    left.set_xscale("log")
    if len(left.get_legend_handles_labels()[0]):
        left.set_yscale("log")
        left.legend(fontsize="x-small", ncols=2)
    left.set_ylabel("degrees")
    left.set_title("standard error of each axis (a cross: not accepted)")
    right.plot(grown.touches, 100 * grown.receptor_sigma, marker=".", color=RECOVERED)
    stands = [(grown.tree_stands(), "the tree")]
    stands += [(at, f"skin {number}") for number, at in enumerate(grown.skins_stand(), start=1)]
    for number, (moment, what) in enumerate(stands):
        if moment is not None:
            color = (BLUE, ORANGE, GREEN, VERMILION)[number % 4]
            # Several that stand at once are all seen.
            dashes = (4 * number, (4, 4 * len(stands) - 4))
            label = f"{what} stands after {moment:,}"
            right.axvline(moment, color=color, linestyle=dashes, label=label)
    if any(moment is not None for moment, _ in stands):
        right.legend(fontsize="x-small")
    right.set_ylim(bottom=0)
    right.set_ylabel("% of the radius")
    right.set_title("standard error of receptors' places")
    for ax in (left, right):
        ax.set_xlabel("touches")
        ax.set_xticks(grown.touches, [f"{number:,}" for number in grown.touches])
        ax.minorticks_off()
    return figure
