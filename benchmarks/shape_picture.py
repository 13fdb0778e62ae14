"""Draws the ablation that benchmarks/shape.py measured: error over touches, for each metric.

python benchmarks/shape_picture.py docs/data/shape_ablation.csv docs/images/shape_ablation.png
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from selftouch_drake.show.style import BLUE, GREEN, INK, ORANGE, styled

COLORS = {"motor": ORANGE, "sensorimotor": BLUE, "learned": GREEN}
LINES = {100: "^:", 300: "o-", 1000: "s--"}


@styled
def ablation(rows: list[dict[str, str]]) -> Figure:
    """A panel a body and number of receptors; colours are metrics, marks are targets."""
    panels = sorted({(row["body"], int(row["receptors"])) for row in rows})
    figure = Figure(figsize=(3.6 * len(panels) + 1.4, 3.6), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for ax, (body, receptors) in zip(axes, panels, strict=True):
        for metric, color in COLORS.items():
            for targets, line in LINES.items():
                errors: dict[int, list[float]] = {}
                for row in rows:
                    here = row["body"], int(row["receptors"]), row["metric"], int(row["targets"])
                    if here == (body, receptors, metric, targets):
                        errors.setdefault(int(row["samples"]), []).append(float(row["error"]))
                samples = sorted(errors)
                median = [100 * np.median(errors[count]) for count in samples]
                ax.plot(samples, median, line, color=color, markersize=4.0)
        ax.set(xscale="log", xlabel="touches", title=f"{body}, {receptors} receptors", ylim=(0, 8))
    axes[0].set(ylabel="shape error (% of the extent)")
    for metric, color in COLORS.items():
        axes[-1].plot([], [], color=color, label=metric)
    for targets, line in LINES.items():
        axes[-1].plot([], [], line, color=INK, markersize=4.0, label=f"{targets} targets")
    figure.legend(loc="outside right center")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("table", type=Path)
    parser.add_argument("picture", type=Path)
    arguments = parser.parse_args()
    with arguments.table.open() as file:
        ablation(list(csv.DictReader(file))).savefig(arguments.picture)


if __name__ == "__main__":
    main()
