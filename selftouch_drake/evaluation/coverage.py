"""Coverage of the skins by babbling."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.lazy import trimesh

# cm², of a fingertip's print: within it, touches count for the same place.
PRINT_AREA = np.pi
# m, over which touches are averaged: about the spacing of receptors.
_BLUR = 0.03
# Vertices at a time: a skin with a receptor every 6 mm has 2,000 within that, for each of 28,000.
_BLOCK = 1024


def vertex_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """`(V,)` m², the share of a surface `(V, 3)` m, `(F, 3)` that belongs to each vertex."""
    a, b, c = vertices[faces].swapaxes(0, 1)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return np.bincount(faces.ravel(), np.repeat(area / 3, 3), len(vertices))


def touch_density(vertices: np.ndarray, faces: np.ndarray, touches: np.ndarray) -> np.ndarray:
    """`(V,)` touches / cm² at each place of a surface, blurred over a few centimetres.

    Args:
        vertices: `(V, 3)` m, of the outer surface.
        faces: `(F, 3)` its triangles, outward.
        touches: `(V,)` how many contacts were nearest to each vertex, as `TouchCounts` counts.
    """
    normals = trimesh.Trimesh(vertices, faces, process=False).vertex_normals
    tree = cKDTree(vertices)
    area, density = vertex_areas(vertices, faces), np.empty(len(vertices))
    for start in range(0, len(vertices), _BLOCK):
        rows = slice(start, start + _BLOCK)
        near = cKDTree(vertices[rows]).sparse_distance_matrix(tree, _BLUR, output_type="ndarray")
        i, j, weight = near["i"], near["j"], np.square(1 - np.square(near["v"] / _BLUR))
        # The other wall of a thin body is near in space, but faces elsewhere.
        weight *= np.einsum("nx,nx->n", normals[rows][i], normals[j]) > 0
        density[rows] = np.bincount(i, weight * touches[j]) / np.bincount(i, weight * area[j])
    return density / 1e4


def coverage(skins: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> dict[str, float]:
    """Metrics of coverage, of all skins together, as `metrics.json` names them.

    The share of the skins' area where a fingertip's print was touched at least n times, and
    evenness: the entropy of touches over area, as a share of the largest possible; 1 is even.
    Of each skin it takes what `touch_density` takes.
    """
    area = np.concatenate([vertex_areas(vertices, faces) for vertices, faces, _ in skins])
    area /= area.sum()
    density = np.concatenate([touch_density(*skin) for skin in skins])
    touches = area * density / np.sum(area * density)
    present = touches > 0
    divergence = np.sum(touches[present] * np.log(touches[present] / area[present]))
    shares = {
        f"coverage_share_{n}_touches": float(area[PRINT_AREA * density >= n].sum())
        for n in (10, 100)
    }
    return {**shares, "coverage_evenness": float(1 - divergence / np.log(1 / area.min()))}
