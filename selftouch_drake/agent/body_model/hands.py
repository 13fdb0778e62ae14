"""Hands that are no points: how deep they touch, as told by touches in like poses of the hand.

A hand of several points is known at these alone. Between them, and about its rim, it is deeper in
the skin than they are, or not as deep, by more than a soft skin gives way. But touches that were
lived in like poses of the hand on a part tell how high its points are there when it is felt.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.lift import Lifter

# Touches that are asked, at most, and those in like poses that tell how high a hand is; as many as
# this share of these are deeper than a hand should be.
_LIVED, _ALIKE, _DEEPEST = 10_000, 20, 0.1
# Points that are farther from the skin, in distances of kernels, do not count; those that are
# higher than the deepest by the second count less.
_FAR, _SOFT = 3.0, 0.25


class Hand:
    """The points of one hand on one part of the skin.

    Heights are in distances of kernels. How deep a touch is tells how strong it is, and the other
    way round: each lived height is that of a touch of median strength, so far as its own tells.

    Args:
        points: how each of the points moves over the part.
        lived: `(n, J)` scaled postures of the hand's touches there.
        strength: `(n,)` how strong each touch is.
    """

    def __init__(self, points: Sequence[Lifter], lived: np.ndarray, strength: np.ndarray) -> None:
        self._points = points
        every = max(1, -(-len(lived) // _LIVED))
        lived, strength = lived[::every], np.log(strength[::every])
        pose = self._poses(lived)
        self._pose, self._lived = cKDTree(pose), self._heights(lived)
        self._alike = min(_ALIKE, len(lived))
        near = self._near(pose)
        higher = self._lived - self._lived[near].mean(axis=1)
        firmer = strength - strength[near].mean(axis=1)
        slope = (higher @ firmer) / max(firmer @ firmer, 1e-12)
        self._expected = self._lived - slope * (strength - np.median(strength))

    def above(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How much higher it is than in touches in like poses.

        Args:
            x: `(n, J)` scaled postures.

        Returns:
            `(n,)` how much higher than in a touch of median strength, and `(n,)` how much higher
            than in deep ones.
        """
        near, height = self._near(self._poses(x)), self._heights(x)
        deep = np.quantile(self._lived[near], _DEEPEST, axis=1)
        return height - self._expected[near].mean(axis=1), height - deep

    def _near(self, pose: np.ndarray) -> np.ndarray:
        """`(n, k)` the lived touches in the most alike poses."""
        return self._pose.query(pose, k=self._alike)[1].reshape(len(pose), -1)

    def _heights(self, x: np.ndarray) -> np.ndarray:
        """`(n,)` of its deepest points above firm touches of each alone, a soft minimum."""
        found = np.full((len(self._points), len(x)), _FAR)
        for own, point in zip(found, self._points, strict=True):
            surface, at = point.surface, point.centres(x)
            near = np.flatnonzero(surface.nodes.query(at)[0] < _FAR * surface.spacing)
            own[near] = surface.height(at[near]) / surface.spacing
        return -_SOFT * np.log(np.exp(-found / _SOFT).mean(axis=0))

    def _poses(self, x: np.ndarray) -> np.ndarray:
        """`(n, 3 P)` poses on the part; they are as far from each other as the points are."""
        at = [point.places(x, np.zeros((len(x), 3)))[0] for point in self._points]
        size = self._points[0].surface.spacing * np.sqrt(len(self._points))
        return np.concatenate(at, axis=1) / size
