"""The outer surfaces of skins, with their receptors, as arrays to draw."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from selftouch_drake.robot.skins import SkinModel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkinSurface:
    """The outer surface of one skin, in some frame; at first in that of the link that wears it.

    Attributes:
        name: as the experiment calls it.
        vertices: `(V, 3)` m.
        faces: `(F, 3)` indices, outward by the right hand.
        receptors: `(S, 3)` m, places of its receptors, on the surface.
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    receptors: np.ndarray

    @property
    def extent(self) -> float:
        """m, its longest side along an axis."""
        return float(np.ptp(self.vertices, axis=0).max())

    def moved(self, pose: np.ndarray) -> "SkinSurface":
        """The same skin with its frame at a pose `(3, 4)`."""
        return dataclasses.replace(
            self, vertices=moved(self.vertices, pose), receptors=moved(self.receptors, pose)
        )


def surfaces_of(skins: Sequence[SkinModel]) -> tuple[SkinSurface, ...]:
    """The skins of a world, each in the frame of its link."""
    return tuple(
        SkinSurface(
            name=skin.name,
            vertices=skin.fields.vertices,
            faces=skin.fields.faces,
            receptors=skin.fields.p_LS,
        )
        for skin in skins
    )


def moved(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """`(..., 3)` points of a frame whose pose `(3, 4)` is a rotation and a translation, outside."""
    return points @ pose[:, :3].T + pose[:, 3]
