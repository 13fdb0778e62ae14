"""The colours of skins and sensations, in figures and in Meshcat alike."""

import matplotlib as mpl
import numpy as np
from matplotlib.colors import LinearSegmentedColormap

#: What touches, and the tactile skin.
VERMILION, SKIN = "#D55E00", "#C6CAD1"

# Even in lightness, for every reader; no pressure is the white of the page.
PRESSURE = LinearSegmentedColormap.from_list(
    "pressure", ["#F3F3F1", *mpl.colormaps["inferno_r"](np.linspace(0.14, 0.94, 9))]
)

#: N, the reading with the strongest colour, if no experience shows how strong a firm touch is.
FIRM = 2.0
