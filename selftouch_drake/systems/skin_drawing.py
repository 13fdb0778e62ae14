"""Skins in Meshcat: they follow their links, and their receptors are coloured by their readings."""

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import to_rgb
from pydrake.geometry import Meshcat, MeshcatAnimation, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from selftouch_drake.colors import PRESSURE, SKIN
from selftouch_drake.robot.skin_surface import SkinSurface

# Number of colours for pressure: few, so that a receptor's colour changes rarely.
_STEPS = 24
_COLORS = PRESSURE(np.arange(_STEPS + 1) / _STEPS)


class SkinDrawing:
    """All skins of a robot, which can be moved and show a sensation.

    Each is drawn below one path below `root`, whose transform follows its link.

    Attributes:
        skins: each in the frame of its link.
    """

    def __init__(self, meshcat: Meshcat, root: str, skins: Sequence[SkinSurface]):
        self._meshcat, self.skins = meshcat, skins
        self._paths = [f"{root}/{skin.name}" for skin in skins]
        self._poses = np.full((len(skins), 3, 4), np.nan)
        self._receptors: list[str] = []
        for path, skin in zip(self._paths, skins, strict=True):
            color = rgba(SKIN, 0.4)
            meshcat.SetTriangleMesh(f"{path}/surface", skin.vertices.T, skin.faces.T, color)
            for number, place in enumerate(skin.receptors):
                receptor = f"{path}/receptors/{number}"
                meshcat.SetObject(receptor, Sphere(0.02 * skin.extent), Rgba(*_COLORS[0]))
                meshcat.SetTransform(receptor, RigidTransform(place))
                self._receptors.append(receptor)
        self._shown = np.zeros(len(self._receptors), dtype=int)

    def move(self, poses: np.ndarray) -> None:
        """Puts the skins where their links are: `(skins, 3, 4)`."""
        for path, pose, before in zip(self._paths, poses, self._poses, strict=True):
            if not np.array_equal(pose, before):
                self._meshcat.SetTransform(path, _transform(pose))
        self._poses = np.array(poses)

    def show(self, sensation: np.ndarray) -> None:
        """Shows a sensation `(S,)`, 1 in the strongest colour."""
        steps = _steps(sensation)
        for number in np.flatnonzero(steps != self._shown):
            color = _COLORS[steps[number]].tolist()
            self._meshcat.SetProperty(self._receptors[number], "color", color)
        self._shown = steps

    def record(self, recording: MeshcatAnimation, poses: np.ndarray, sensation: np.ndarray) -> None:
        """Records poses `(frames, skins, 3, 4)` and sensations `(frames, S)`.

        A recorded property named `color` is not played back (Drake issue 20879). The colour of the
        material is, and is blended in linear light; live it does nothing.
        """
        for number, path in enumerate(self._paths):
            if np.ptp(poses[:, number], axis=0).max() > 1e-9:
                for frame, pose in enumerate(poses[:, number]):
                    recording.SetTransform(frame, path, _transform(pose))
        colors = linear_light(_COLORS[:, :3]).tolist()
        for path, steps in zip(self._receptors, _steps(sensation).T, strict=True):
            for frame in key_frames(steps):
                color = colors[steps[frame]]
                recording.SetProperty(frame, f"{path}/<object>", "material.color", color)


def key_frames(values: np.ndarray) -> list[int]:
    """The frames that are enough for a series whose values are held between changes.

    Playing blends from key to key, so that the last frame before a change is a key as well; and
    each series starts over when it ends, so that all have to end with the last frame.
    """
    changes = np.flatnonzero(np.diff(values) != 0)
    return np.unique([0, *changes, *(changes + 1), len(values) - 1]).tolist()


def linear_light(srgb: np.ndarray) -> np.ndarray:
    """Linear light of sRGB components, both from 0 to 1."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def rgba(color: str, alpha: float = 1.0) -> Rgba:
    """A colour as Meshcat takes it."""
    return Rgba(*to_rgb(color), alpha)


def _steps(felt: np.ndarray) -> np.ndarray:
    return np.rint(_STEPS * np.clip(felt, 0.0, 1.0)).astype(int)


def _transform(pose: np.ndarray) -> RigidTransform:
    return RigidTransform(RotationMatrix.ProjectToRotationMatrix(pose[:, :3]), pose[:, 3])
