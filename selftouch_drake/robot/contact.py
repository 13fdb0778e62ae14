"""From a hydroelastic contact surface to forces on the skin."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import ContactSurface
from pydrake.math import RigidTransform


def pressed_points(surface: ContactSurface) -> tuple[list[np.ndarray], list[float]]:
    """Where, and how hard, a contact surface presses.

    Pressure is linear on a face, so its value at the centroid times the area is the exact integral.
    Lists, because this is the inner loop of babbling and is called for a few faces at a time.

    Args:
        surface: polygonal or triangular contact surface, in the world frame.

    Returns:
        For each face its centroid `p_WQ` `(3,)` m, and the pressure integrated over it, in N.
    """
    field = surface.tri_e_MN() if surface.is_triangle() else surface.poly_e_MN()
    pressure, centroid, area = field.EvaluateCartesian, surface.centroid, surface.area
    faces = range(surface.num_faces())
    p_WQ = [centroid(face) for face in faces]
    return p_WQ, [pressure(face, p) * area(face) for face, p in zip(faces, p_WQ, strict=True)]


def in_body_frame(X_WB: RigidTransform, p_WQ: np.ndarray) -> np.ndarray:
    """`(N, 3)` points of the world frame, measured and expressed in the body frame B."""
    return (p_WQ - X_WB.translation()) @ X_WB.rotation().matrix()
