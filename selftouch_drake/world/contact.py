"""From a hydroelastic contact surface to forces on the skin."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import ContactSurface
from pydrake.math import RigidTransform


def pressed_points(surface: ContactSurface) -> tuple[np.ndarray, np.ndarray]:
    """Where, and how hard, a contact surface presses.

    Pressure is linear on a face, so its value at the centroid times the area is the exact integral.

    Args:
        surface: polygonal or triangular contact surface, in the world frame.

    Returns:
        `p_WQ` `(N, 3)` m, centroids of the faces in the world frame, and `force` `(N,)` N, the
        pressure integrated over each face.
    """
    pressure = (surface.tri_e_MN() if surface.is_triangle() else surface.poly_e_MN()).EvaluateCartesian
    centroid, area = surface.centroid, surface.area
    faces = range(surface.num_faces())
    p_WQ = [centroid(face) for face in faces]
    force = [pressure(face, p) * area(face) for face, p in zip(faces, p_WQ, strict=True)]
    return np.array(p_WQ), np.array(force)


def in_body_frame(X_WB: RigidTransform, p_WQ: np.ndarray) -> np.ndarray:
    """`(N, 3)` points of the world frame, measured and expressed in the body frame B."""
    return (p_WQ - X_WB.translation()) @ X_WB.rotation().matrix()
