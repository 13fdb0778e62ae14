"""One style for all figures: colours for colour-blind readers, quiet axes, no pyplot."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.colors import LinearSegmentedColormap

# Okabe and Ito's palette.
BLUE, SKY, GREEN, ORANGE = "#0072B2", "#56B4E9", "#009E73", "#E69F00"
VERMILION, PINK = "#D55E00", "#CC79A7"
INK, MUTED, PALE = "#22262B", "#6B7280", "#D5D8DD"
# The tactile skin, and what the agent made of it.
SKIN, RECOVERED = "#C6CAD1", "#5DB89C"

# Even in lightness, for every reader; no pressure is the white of the page.
AMOUNT = mpl.colormaps["cividis"]
PRESSURE = LinearSegmentedColormap.from_list(
    "pressure", ["#F3F3F1", *mpl.colormaps["inferno_r"](np.linspace(0.14, 0.94, 9))]
)

DPI = 160
# N, the reading with the strongest colour, if no experience shows how strong a firm touch is.
FIRM = 2.0

_STYLE: Any = {
    "figure.facecolor": "white",
    "figure.dpi": DPI,
    "savefig.dpi": DPI,
    "font.family": "sans-serif",
    "font.size": 9.0,
    "text.color": INK,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.prop_cycle": cycler(color=[BLUE, ORANGE, GREEN, VERMILION, PINK, SKY]),
    "figure.titlesize": 12.0,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "legend.frameon": False,
    "image.cmap": AMOUNT.name,
}

#: Decorates who draws a figure in the project's style; matplotlib's settings stay unchanged.
styled = mpl.rc_context(_STYLE)
