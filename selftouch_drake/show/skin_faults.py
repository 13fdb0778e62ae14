"""The pictures of a skin with faults, and of a skin that changed."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from selftouch_drake.agent.readings.receptor_faults import Fault
from selftouch_drake.files import written_whole
from selftouch_drake.run.skin import CheckedSkin, ComparedSkin, Skin
from selftouch_drake.show.style import (
    BLUE,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    PALE,
    PINK,
    SKY,
    VERMILION,
    styled,
)

_COLOR = {
    Fault.NONE: PALE,
    Fault.DEAD: INK,
    Fault.STUCK: VERMILION,
    Fault.FLICKERS: ORANGE,
    Fault.DROPS_OUT: SKY,
    Fault.EXCHANGED: BLUE,
    Fault.ELSEWHERE: PINK,
    Fault.UNKNOWN: MUTED,
}
# Skins that are drawn, and faulty receptors that are named on each, at most.
_MOST_SKINS, _MOST_NAMED = 4, 40


@styled
def draw_faults(checked: Sequence[CheckedSkin], path: Path) -> None:
    """Draws each skin by what its receptors felt beside what was due, and where they lie, if known.

    An arrow points from where a file puts a receptor to where it reads.
    """
    some = checked[:_MOST_SKINS]
    figure = Figure(figsize=(9.0, 4.4 * len(some)), layout="constrained")
    rows = np.reshape(figure.subplots(len(some), 2), (-1, 2))
    for (left, right), one in zip(rows, some, strict=True):
        found = one.faults
        colors = [_COLOR[fault] for fault in found.fault]
        places = _flat(one.skin)
        if places is None:
            left.set_axis_off()
            left.set_title("No file says where receptors are")
        else:
            _scatter(left, places, colors, found.fault != Fault.NONE)
            _arrows(left, places, found.read_as)
            _names(left, places, one.skin, found.faulty)
            left.set_title(f"Receptors{_of(one.skin)}, in m, as the file has them")
        most = max(float(found.expected.max()), float(found.felt.max()), 10.0)
        right.plot([1, most], [1, most], color=PALE)
        counts = np.stack([found.expected, found.felt], axis=1)
        _scatter(right, np.maximum(counts, 0.5), colors, found.fault != Fault.NONE)
        _names(right, np.maximum(counts, 0.5), one.skin, found.faulty)
        right.set(xscale="log", yscale="log", xlabel="touches due", ylabel="touches felt")
        _legend(right, found.fault)
    _save(figure, path)


@styled
def draw_drift(found: Sequence[ComparedSkin], path: Path) -> None:
    """Draws the gain of each receptor between two runs, and marks those that changed."""
    some = found[:_MOST_SKINS]
    figure = Figure(figsize=(9.0, 3.4 * len(some)), layout="constrained")
    for ax, one in zip(np.ravel(figure.subplots(len(some), 1)), some, strict=True):
        number, gain = np.arange(len(one.skin.names)), one.drift.gain
        error = 1.96 * one.drift.gain_sigma * gain
        ax.errorbar(number, gain, yerr=error, fmt="o", ms=3, color=MUTED, ecolor=PALE)
        changed = np.array([n for n, _, _ in one.drift.changes], dtype=int)
        # What has no gain, as a dead receptor, is marked where nothing changed.
        height = np.where(np.isnan(gain), 1.0, gain)
        colors = [
            _COLOR[one.drift.after.fault[n]] if one.drift.after.fault[n] != Fault.NONE else GREEN
            for n in changed
        ]
        ax.scatter(changed, height[changed], c=colors, s=40, zorder=3)
        for n in changed[:_MOST_NAMED].tolist():
            ax.annotate(one.skin.names[n], (n, height[n]), (3, 5), textcoords="offset points")
        ax.axhline(1.0, color=PALE)
        ax.set(xlabel="receptor", ylabel="gain", title=f"Since the first run{_of(one.skin)}")
        _legend(ax, one.drift.after.fault)
    _save(figure, path)


def _flat(skin: Skin) -> np.ndarray | None:
    """`(s, 2)` places on the two widest axes of a skin; None if they are unknown."""
    if skin.place is None:
        return None
    centred = skin.place - skin.place.mean(axis=0)
    return centred @ np.linalg.svd(centred, full_matrices=False)[2][:2].T


def _scatter(ax: Axes, at: np.ndarray, colors: Sequence[str], marked: np.ndarray) -> None:
    order = np.argsort(marked, kind="stable")  # what is marked lies on top
    ax.scatter(
        at[order, 0],
        at[order, 1],
        c=[colors[n] for n in order.tolist()],
        s=np.where(marked, 36, 14)[order],
        edgecolor=MUTED,
        linewidth=0.4,
    )


def _arrows(ax: Axes, places: np.ndarray, read_as: np.ndarray) -> None:
    for n in np.flatnonzero((read_as >= 0) & (read_as != np.arange(len(read_as)))).tolist():
        style = {"arrowstyle": "->", "color": BLUE, "shrinkA": 4, "shrinkB": 4}
        ax.annotate("", places[read_as[n]], places[n], arrowprops=style)
    ax.set_aspect("equal")


def _names(ax: Axes, at: np.ndarray, skin: Skin, faulty: np.ndarray) -> None:
    for n in faulty[:_MOST_NAMED].tolist():
        ax.annotate(skin.names[n], at[n], (3, 4), textcoords="offset points", fontsize=7)


def _legend(ax: Axes, fault: np.ndarray) -> None:
    present = [one for one in Fault if one != Fault.NONE and (fault == one).any()]
    for one in present:
        ax.scatter([], [], c=_COLOR[one], s=36, label=str(one))
    if present:
        ax.legend()


def _of(skin: Skin) -> str:
    return f" of {skin.name}" if skin.name else ""


def _save(figure: Figure, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(path) as aside:
        figure.savefig(aside, format="png", metadata={"Software": None})
