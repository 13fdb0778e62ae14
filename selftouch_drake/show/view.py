"""The camera of all pictures: far away, so without perspective."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
    def of_most(offsets: np.ndarray, extent: float) -> View:
        """The view of what is touched most, if it is all on one side; else the usual view.

        Args:
            offsets: `(N, 3)` touched places from the middles of what they are on.
            extent: of that, in the same unit.
        """
        middle = offsets.mean(axis=0)
        one_sided = np.linalg.norm(middle[:2]) > _ONE_SIDED * extent
        return View.facing(middle) if one_sided else View()

    @staticmethod
    def facing(direction: np.ndarray) -> View:
        """The view from the side that `direction` `(3,)` points to, a little from its left."""
        azimuth = np.degrees(np.arctan2(direction[1], direction[0]))
        return View(azimuth=float(azimuth) - 20.0)


#: The camera of all pages in Meshcat.
VIEW = View(elevation=20.0, azimuth=-70.0)
