"""What a skin reports of the forces on its receptors: forces, one bit each, or counts.

This is the one place where forces become readings, for kinematic and dynamic worlds and for
`TactileSkin` alike. Centres of groups are not made here: they are receptive fields
(`geometry.group_centres`).
"""

import numpy as np

from selftouch_drake.experiment.schema import ReadingSettings


def read_forces(
    force: np.ndarray, reading: ReadingSettings, before: np.ndarray | None = None
) -> np.ndarray:
    """What is reported of forces.

    Args:
        force: `(N, S)` N, or of one instant `(S,)`.
        reading: how the skin reports them.
        before: of the same shape, the last readings, for hysteresis. None if nothing was touched,
            as where a body is put into a posture.

    Returns:
        N, of the same shape; or 0 and 1; or whole numbers from 0 on.
    """
    if reading.mode == "binary":
        assert reading.threshold is not None
        on = force >= reading.threshold
        if before is not None:
            on |= (before > 0) & (force >= reading.threshold - reading.hysteresis)
        return on.astype(float)
    if reading.mode == "counts":
        assert reading.full_scale is not None
        return np.clip(np.round(force * (reading.most / reading.full_scale)), 0, reading.most)
    return force
