"""Pictures of acting: what was felt along a plan, and how its joints were tracked."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from selftouch_drake.agent.motions import Execution
from selftouch_drake.show.style import (
    BLUE,
    INK,
    MUTED,
    ORANGE,
    PRESSURE,
    SKY,
    VERMILION,
    styled,
)

# Share of its strongest receptor that another must reach to be drawn.
_SILENT = 0.03
# Number of joints beyond which the colours of the style repeat.
_COLORS = 6


@styled
def felt_and_predicted(execution: Execution) -> Figure:
    """What was felt along an executed plan, what had been predicted, and how alike they are."""
    time_s = execution.motion.time_s
    felt_shape, predicted_shape = _unit(execution.felt), _unit(execution.motion.predicted)
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
    _shade_contact(axes[2], execution)
    mean = float(cosine[both].mean()) if both.any() else float("nan")
    axes[2].set(
        xlabel="time (s)", ylabel="cosine", ylim=(-0.03, 1.05), xlim=(time_s[0], time_s[-1]),
        title=f"Likeness: 1 is the same sensation; mean in contact {mean:.3f}",
    )  # fmt: skip
    return figure


@styled
def contact_and_tracking(execution: Execution, names: Sequence[str], turns: np.ndarray) -> Figure:
    """The force on the skin and the tracking of every joint along an executed plan.

    Args:
        execution: J joints.
        names: of the joints.
        turns: `(J,)` bool, whether each joint turns (rad) or slides (m).
    """
    motion, felt = execution.motion, execution.felt
    time_s, force = motion.time_s, felt.sum(axis=1)
    error = 1e3 * (execution.q_measured - motion.q)
    kinds = [(those, unit) for those, unit in ((turns, "rad"), (~turns, "m")) if those.any()]
    figure = Figure(figsize=(9.0, 3.8 + 1.8 * len(kinds)), layout="constrained")
    pressing, *moving, tracking = figure.subplots(2 + len(kinds), 1, sharex=True)
    pressing.plot(time_s, force, color=INK, linewidth=1.2)
    pressing.fill_between(time_s, force, color=ORANGE, alpha=0.35, linewidth=0)
    _shade_contact(pressing, execution)
    when = "of the time" if motion.touching.all() else "of the time, where touch was expected"
    pressing.set(
        ylabel="force (N)", ylim=(0, None), title=f"In contact {execution.contact:.1%} {when}"
    )
    colors = _colors(len(names))
    lines = []
    for ax, (those, unit) in zip(moving, kinds, strict=True):
        for joint in np.flatnonzero(those).tolist():
            (line,) = ax.plot(
                time_s, motion.q[:, joint], linewidth=1.2, color=colors[joint], label=names[joint]
            )
            lines.append(line)
        ax.set(ylabel=f"planned ({unit})")
    moving[0].set(title="The plan")
    for joint in range(len(names)):
        tracking.plot(time_s, error[:, joint], linewidth=1.0, color=colors[joint])
    tracking.axhline(0.0, color=MUTED, linewidth=0.6)
    rms = ", ".join(
        f"{np.sqrt(np.mean(np.square(error[:, those]))):.2g} {'mrad' if unit == 'rad' else 'mm'}"
        for those, unit in kinds
    )
    units = " or ".join("mrad" if unit == "rad" else "mm" for _, unit in kinds)
    tracking.set(
        xlabel="time (s)", ylabel=f"error ({units})", xlim=(time_s[0], time_s[-1]),
        title=f"Measured less planned: RMS {rms}",
    )  # fmt: skip
    figure.legend(handles=lines, loc="outside lower center", ncols=_columns(names), fontsize=8)
    return figure


def _columns(names: Sequence[str]) -> int:
    """As many as fit below a figure."""
    return max(1, min(len(names), 130 // (8 + max(map(len, names)))))


def _colors(count: int) -> list:
    if count <= _COLORS:
        return mpl.rcParams["axes.prop_cycle"].by_key()["color"][:count]
    return list(mpl.colormaps["turbo"](np.linspace(0.04, 0.96, count)))


def _shade_contact(ax: Axes, execution: Execution) -> None:
    """Marks where touch was lost, and where none was expected."""
    touching, expected = execution.felt.any(axis=1), execution.motion.touching
    _shade_where(ax, execution.motion.time_s, expected & ~touching, "no contact", VERMILION)
    _shade_where(ax, execution.motion.time_s, ~expected, "in the air", SKY)


def _shade_where(ax: Axes, time_s: np.ndarray, mask: np.ndarray, label: str, color: str) -> None:
    if mask.any():
        ax.fill_between(
            time_s, 0, 1, where=mask, transform=ax.get_xaxis_transform(), color=color, alpha=0.25,
            linewidth=0, label=label,
        )  # fmt: skip
        ax.legend(loc="upper right")


def _unit(rows: np.ndarray) -> np.ndarray:
    norm = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.divide(rows, norm, out=np.zeros(rows.shape), where=norm > 0)
