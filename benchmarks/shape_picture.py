"""The picture of `selftouch sweep ablation`: shape error over receptors."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from selftouch_drake.show.style import BLUE, GREEN, INK, ORANGE, styled

COLORS = {"motor": ORANGE, "sensorimotor": BLUE, "learned": GREEN}
LINES = {
    (30_000, 100): "^:",
    (100_000, 100): "o:",
    (30_000, 300): "^-",
    (100_000, 300): "o-",
}


def receptors_of(row: dict) -> int:
    """The number of receptors of a run; tables of the first version have another name for it."""
    return row.get("skins.body.num_receptors") or row["skin.num_receptors"]


@styled
def ablation(rows: list[dict]) -> Figure:
    """One panel for each body; colours are metrics, marks are touches, lines are targets."""
    bodies = sorted({row["experiment"] for row in rows})
    figure = Figure(figsize=(3.6 * len(bodies) + 1.9, 3.6), layout="constrained")
    axes = figure.subplots(1, len(bodies), sharey=True, squeeze=False)[0]
    for ax, body in zip(axes, bodies, strict=True):
        for metric, color in COLORS.items():
            for (touches, targets), line in LINES.items():
                errors: dict[int, list[float]] = {}
                for row in rows:
                    size = row["babbling.num_samples"], row["representation.num_targets"]
                    error = row.get(f"shape_rms_fraction_by_metric.{metric}")
                    if (row["experiment"], *size) == (body, touches, targets) and error is not None:
                        errors.setdefault(receptors_of(row), []).append(error)
                receptors = sorted(errors)
                median = [100 * np.median(errors[number]) for number in receptors]
                ax.plot(receptors, median, line, color=color, markersize=4.0)
        ax.set(xscale="log", xlabel="receptors", title=body, ylim=(0, 8))
        ax.set_xticks([20, 50, 100, 200], ["20", "50", "100", "200"])
        ax.set_xticks([], minor=True)
    axes[0].set(ylabel="shape error (% of the extent)")
    shown = [m for m in COLORS if any(row.get(f"shape_rms_fraction_by_metric.{m}") for row in rows)]
    for metric in shown:
        axes[-1].plot([], [], color=COLORS[metric], label=metric)
    for (touches, targets), line in LINES.items():
        label = f"{touches:,} touches, {targets} targets"
        axes[-1].plot([], [], line, color=INK, markersize=4.0, label=label)
    figure.legend(loc="outside right center")
    return figure
