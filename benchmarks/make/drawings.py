"""Pictures of the tables in `docs/data`, in the style of the report.

`benchmarks/make/pictures.py` draws them all.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from selftouch_drake.show.style import BLUE, PALE, styled

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.accuracy.joints import picture as over_joints
from benchmarks.accuracy.trust import picture as expected_and_true
from benchmarks.life.exploration import picture as over_lives
from benchmarks.shared.results import ROOT

DATA = ROOT / "docs" / "data"


def rows_of(name: str) -> list[dict[str, str]]:
    with (DATA / name).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@styled
def two_fingers() -> Figure:
    """How often the hand must be turned; `benchmarks/accuracy/two_fingers.py touches` measures."""
    rows = [
        row
        for row in rows_of("two_fingers_touches_s1.csv")
        if row["rows"] == "58953" and row["space"] == "two touches, motor"
    ]
    titles = {
        "1": "the touches",
        "2": "unrolled once\n(the double cover)",
        "4": "unrolled twice\n(the fourfold cover)",
    }
    figure = Figure(figsize=(8.4, 2.9), layout="constrained")
    ax = figure.subplots()
    place = np.arange(len(rows))
    largest = [float(row["longest_bar_mod_2"]) for row in rows]
    chance = [float(row["longest_bar_mod_3"]) for row in rows]
    bars = (
        (largest, BLUE, "longest loop"),
        (chance, PALE, "longest loop that is a gap between samples"),
    )
    for number, (height, color, label) in enumerate(bars):
        drawn = ax.bar(place + 0.36 * number, height, 0.34, color=color, label=label)
        ax.bar_label(drawn, fmt="%.2f", fontsize=8)
    ax.set_xticks(place + 0.18, [titles[row["cover"]] for row in rows])
    ax.set(ylabel="length of the loop's bar", ylim=(0, 1.25 * max(largest)))
    ax.set_title("A true loop is left until the space is unrolled twice: four half turns lead back")
    ax.legend(loc="upper right")
    return figure


def confidence() -> Figure:
    """True error over the error that the agent expects; `benchmarks/accuracy/trust.py` measures."""
    return expected_and_true(rows_of("confidence.csv"))


def joints() -> Figure:
    """Shape and contact over the number of joints; `benchmarks/accuracy/joints.py` measures."""
    return over_joints(rows_of("joints.csv"))


def exploration() -> Figure:
    """Shape error of active and random babbling; `benchmarks/life/exploration.py` measures."""
    return over_lives(rows_of("exploration_touches.csv") + rows_of("exploration_clock.csv"))


DRAWINGS = {
    "confidence": confidence,
    "exploration": exploration,
    "joints": joints,
    "two_fingers": two_fingers,
}
