"""Skins in Meshcat: each below one path, whose transform follows its link."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Meshcat, MeshcatAnimation
from pydrake.math import RigidTransform, RotationMatrix

from selftouch_drake.show.meshcat.receptors import Receptors, rgba
from selftouch_drake.show.skins import SkinSurface
from selftouch_drake.show.style import SKIN


class SkinDrawing:
    """All skins of a robot, which can be moved and show a sensation.

    Args:
        meshcat: where they are drawn.
        root: path of all of them.
        skins: each in the frame of its link.
    """

    def __init__(self, meshcat: Meshcat, root: str, skins: Sequence[SkinSurface]):
        self._meshcat, self._skins = meshcat, skins
        self._paths = [f"{root}/{skin.name}" for skin in skins]
        self._poses = np.full((len(skins), 3, 4), np.nan)
        self._receptors = []
        for path, skin in zip(self._paths, skins, strict=True):
            color = rgba(SKIN, 0.4)
            meshcat.SetTriangleMesh(f"{path}/surface", skin.vertices.T, skin.faces.T, color)
            receptors = f"{path}/receptors"
            radius = 0.02 * skin.extent
            self._receptors.append(Receptors(meshcat, receptors, skin.receptors, radius))

    def move(self, poses: np.ndarray) -> None:
        """Puts the skins where their links are: `(skins, 3, 4)`."""
        for path, pose, before in zip(self._paths, poses, self._poses, strict=True):
            if not np.array_equal(pose, before):
                self._meshcat.SetTransform(path, _transform(pose))
        self._poses = np.array(poses)

    def show(self, sensation: np.ndarray) -> None:
        """Shows a sensation `(S,)`, 1 in the strongest colour."""
        for skin, receptors in zip(self._skins, self._receptors, strict=True):
            receptors.show(sensation[skin.readings])

    def record(self, recording: MeshcatAnimation, poses: np.ndarray, sensation: np.ndarray) -> None:
        """Records poses `(frames, skins, 3, 4)` and sensations `(frames, S)`."""
        for number, path in enumerate(self._paths):
            if np.ptp(poses[:, number], axis=0).max() > 1e-9:
                for frame, pose in enumerate(poses[:, number]):
                    recording.SetTransform(frame, path, _transform(pose))
        for skin, receptors in zip(self._skins, self._receptors, strict=True):
            receptors.record(recording, sensation[:, skin.readings])


def _transform(pose: np.ndarray) -> RigidTransform:
    return RigidTransform(RotationMatrix.ProjectToRotationMatrix(pose[:, :3]), pose[:, 3])
