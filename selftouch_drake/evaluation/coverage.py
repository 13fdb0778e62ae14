"""How well babbling covers the skin."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

# m, of the disc within which touches are counted: a fingertip's.
TOUCH_RADIUS = 0.01


def touch_density(p_WF: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """How often each place of the skin was touched.

    Args:
        p_WF: `(N, 3 * fingers)` m, fingertip positions; each is counted where it is nearest.
        vertices: `(V, 3)` m, of the outer surface.

    Returns:
        `(V,)` touches within `TOUCH_RADIUS` of each vertex.
    """
    tree = cKDTree(vertices)
    _, nearest = tree.query(p_WF.reshape(-1, 3))
    count = np.bincount(nearest, minlength=len(vertices))
    discs = tree.sparse_distance_matrix(tree, TOUCH_RADIUS, output_type="coo_matrix").tocsr()
    discs.data[:] = 1.0
    discs.setdiag(1.0)
    return discs @ count


def coverage(p_WF: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> dict[str, float]:
    """Figures of coverage, as `metrics.json` names them.

    The share of the skin's area touched at least n times, and evenness: the entropy of the touches
    over the area, as a share of the largest possible; 1 is perfectly even.

    Args:
        p_WF: `(N, 3 * fingers)` m, fingertip positions.
        vertices: `(V, 3)` m, of the outer surface.
        faces: `(F, 3)` its triangles.
    """
    density = touch_density(p_WF, vertices)
    a, b, c = vertices[faces].swapaxes(0, 1)
    face_area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    area = np.bincount(faces.ravel(), np.repeat(face_area / 3, 3), minlength=len(vertices))
    area /= area.sum()
    touches = area * density / np.sum(area * density)
    present = touches > 0
    divergence = np.sum(touches[present] * np.log(touches[present] / area[present]))
    shares = {f"coverage_share_{n}_touches": float(area[density >= n].sum()) for n in (1, 10, 100)}
    return {**shares, "coverage_evenness": float(1 - divergence / np.log(1 / area.min()))}
