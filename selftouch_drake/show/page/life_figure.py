"""The life of an agent as curves over its touches."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from selftouch_drake.evaluation.life import LifeCurves
from selftouch_drake.show.style import BLUE, GREEN, ORANGE, VERMILION, styled


@styled
def life(curves: LifeCurves) -> Figure:
    """Coverage, shape error, contact and surprise; changes of the body, and when it noticed."""
    figure = Figure(figsize=(10.5, 5.0), layout="constrained")
    panels = (
        ("receptors that have felt", "%", curves.touches, 100 * curves.coverage, BLUE),
        ("shape error, worst skin", "% of the size", curves.touches, 100 * curves.error, VERMILION),
        ("plans in contact, before practice", "%", curves.touches, 100 * curves.contact, GREEN),
        ("surprise", "cosine distance", curves.block_touches, curves.surprise, ORANGE),
    )
    axes: list[Axes] = figure.subplots(2, 2, sharex=True).ravel().tolist()
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
    for ax in axes[2:]:
        ax.set_xlabel("touches")
    if len(curves.changed) or len(curves.noticed):
        axes[-1].legend(loc="upper left", fontsize="small")
    return figure
