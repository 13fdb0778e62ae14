"""How well babbling covers the skin."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import trimesh
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

# cm², of a fingertip's print: within it, touches count for the same place.
PRINT_AREA = np.pi
# m, over which touches are averaged: about the spacing of receptors.
_BLUR = 0.03


def touch_density(
    vertices: np.ndarray, faces: np.ndarray, p_WF: Iterable[np.ndarray]
) -> np.ndarray:
    """How often each place of a surface was touched, blurred over a few centimetres.

    Args:
        vertices: `(V, 3)` m, of the outer surface.
        faces: `(F, 3)` its triangles, outward.
        p_WF: `(N, 3)` m, fingertip positions, in batches of any size; each position counts where it
            is nearest, also in the wall.

    Returns:
        `(V,)` touches / cm².
    """
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    tree = cKDTree(vertices)
    touches = np.zeros(len(vertices), dtype=int)
    for batch in p_WF:
        _, nearest = tree.query(batch)
        touches += np.bincount(nearest, minlength=len(vertices))
    area = np.zeros(len(vertices))
    np.add.at(area, mesh.faces, mesh.area_faces[:, None] / 3)
    near = csr_array(tree.sparse_distance_matrix(tree, _BLUR))
    near.data = np.square(1 - np.square(near.data / _BLUR))
    near.setdiag(1.0)
    # The other wall of a thin body is near in space, but faces elsewhere.
    i, j = near.nonzero()
    aligned = (mesh.vertex_normals[i] * mesh.vertex_normals[j]).sum(axis=1) > 0
    near = near.multiply(csr_array((aligned.astype(float), (i, j)), shape=near.shape)).tocsr()
    return (near @ touches) / (near @ area) / 1e4


def coverage(
    vertices: np.ndarray, faces: np.ndarray, p_WF: Iterable[np.ndarray]
) -> dict[str, float]:
    """Figures of coverage, as `metrics.json` names them.

    The share of the skin's area where a fingertip's print was touched at least n times, and
    evenness: the entropy of touches over area, as a share of the largest possible; 1 is even.

    Args:
        vertices: `(V, 3)` m, of the outer surface.
        faces: `(F, 3)` its triangles, outward.
        p_WF: `(N, 3)` m, fingertip positions, in batches of any size.
    """
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    area_m2 = np.bincount(faces.ravel(), np.repeat(mesh.area_faces, 3), minlength=len(vertices))
    area = area_m2 / area_m2.sum()
    density = touch_density(vertices, faces, p_WF)
    touches = area * density / np.sum(area * density)
    present = touches > 0
    divergence = np.sum(touches[present] * np.log(touches[present] / area[present]))
    shares = {
        f"coverage_share_{n}_touches": float(area[PRINT_AREA * density >= n].sum())
        for n in (10, 100)
    }
    return {**shares, "coverage_evenness": float(1 - divergence / np.log(1 / area.min()))}
