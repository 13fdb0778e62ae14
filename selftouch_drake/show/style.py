"""One style for all figures, and one camera for all pictures.

Colours for colour-blind readers, quiet axes, no pyplot; the camera is far away, so there is no
perspective.
"""

from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from cycler import cycler

from selftouch_drake.colors import FIRM as FIRM
from selftouch_drake.colors import PRESSURE as PRESSURE
from selftouch_drake.colors import SKIN as SKIN
from selftouch_drake.colors import VERMILION as VERMILION

# Okabe and Ito's palette.
BLUE, SKY, GREEN, ORANGE = "#0072B2", "#56B4E9", "#009E73", "#E69F00"
PINK = "#CC79A7"
INK, MUTED, PALE = "#22262B", "#6B7280", "#D5D8DD"
# What the agent made of the tactile skin.
RECOVERED = "#5DB89C"

# Even in lightness, for every reader.
AMOUNT = mpl.colormaps["cividis"]

DPI = 160

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


# If a body was touched all over, the mean of its touched places is nearer to its middle than this
# share of its extent.
_ONE_SIDED = 0.1


@dataclass(frozen=True, slots=True)
class View:
    """A camera far away, in degrees above the horizon and round the vertical."""

    elevation: float = 28.0
    azimuth: float = -58.0

    @property
    def axes(self) -> np.ndarray:
        """`(3, 3)` unit vectors: to the right of the picture, up in it, and towards the camera."""
        elevation, azimuth = np.radians([self.elevation, self.azimuth])
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        towards = np.cos(elevation) * level + np.sin(elevation) * np.array([0.0, 0.0, 1.0])
        return np.stack([right, np.cross(towards, right), towards])

    @property
    def towards(self) -> np.ndarray:
        """`(3,)` unit vector towards the camera."""
        return self.axes[2]

    @property
    def light(self) -> np.ndarray:
        """`(3,)` unit vector to the lamp, above and to the left of the camera."""
        lamp = np.array([-0.55, 0.75, 1.0]) @ self.axes
        return lamp / np.linalg.norm(lamp)

    def project(self, points: np.ndarray) -> np.ndarray:
        """`(..., 3)` points in the picture: right, up, and nearness to the camera."""
        return points @ self.axes.T

    @staticmethod
    def of_most(offsets: np.ndarray, extent: float) -> "View":
        """The view of what is touched most, if it is all on one side; else the usual view.

        Args:
            offsets: `(N, 3)` touched places from the middles of what they are on.
            extent: of that, in the same unit.
        """
        middle = offsets.mean(axis=0)
        one_sided = np.linalg.norm(middle[:2]) > _ONE_SIDED * extent
        return View.facing(middle) if one_sided else View()

    @staticmethod
    def facing(direction: np.ndarray) -> "View":
        """The view from the side that `direction` `(3,)` points to, a little from its left."""
        azimuth = np.degrees(np.arctan2(direction[1], direction[0]))
        return View(azimuth=float(azimuth) - 20.0)


#: The camera of all pages in Meshcat.
VIEW = View(elevation=20.0, azimuth=-70.0)
