"""Coverage of the skins by babbling, and how often each skin was touched, and by what."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from selftouch_drake.experience import ExperienceReader
from selftouch_drake.lazy import trimesh
from selftouch_drake.robot import Robot

# cm², of a fingertip's print: within it, touches count for the same place.
PRINT_AREA = np.pi
# m, over which touches are averaged: about the spacing of receptors.
_BLUR = 0.03


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
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    tree, area = cKDTree(vertices), vertex_areas(vertices, faces)
    near = csr_array(tree.sparse_distance_matrix(tree, _BLUR))
    near.data = np.square(1 - np.square(near.data / _BLUR))
    near.setdiag(1.0)
    # The other wall of a thin body is near in space, but faces elsewhere.
    i, j = near.nonzero()
    aligned = (mesh.vertex_normals[i] * mesh.vertex_normals[j]).sum(axis=1) > 0
    near = near.multiply(csr_array((aligned.astype(float), (i, j)), shape=near.shape)).tocsr()
    return (near @ touches) / (near @ area) / 1e4


def coverage(skins: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> dict[str, float]:
    """Metrics of coverage, of all skins together, as `metrics.json` names them.

    The share of the skins' area where a fingertip's print was touched at least n times, and
    evenness: the entropy of touches over area, as a share of the largest possible; 1 is even.

    Args:
        skins: of each its vertices `(V, 3)` m, its faces `(F, 3)` and its `touch_density` `(V,)`.
    """
    area = np.concatenate([vertex_areas(vertices, faces) for vertices, faces, _ in skins])
    area /= area.sum()
    density = np.concatenate([d for _, _, d in skins])
    touches = area * density / np.sum(area * density)
    present = touches > 0
    divergence = np.sum(touches[present] * np.log(touches[present] / area[present]))
    shares = {
        f"coverage_share_{n}_touches": float(area[PRINT_AREA * density >= n].sum())
        for n in (10, 100)
    }
    return {**shares, "coverage_evenness": float(1 - divergence / np.log(1 / area.min()))}


def touch_counts(truth: ExperienceReader, robot: Robot) -> tuple[dict[str, int], dict[str, int]]:
    """Number of touches of each skin and by each toucher; a touch of two skins counts for both."""
    skins = [skin.model.name for skin in robot.skins]
    touchers = [toucher.name for toucher in robot.touchers]
    of_skin, by_toucher = np.zeros(len(skins), int), np.zeros(len(touchers) + len(skins), int)
    for contacts in truth.contacts():
        for found, counts in ((contacts.skin, of_skin), (contacts.toucher, by_toucher)):
            pairs = np.unique(contacts.row * len(counts) + found)
            counts += np.bincount(pairs % len(counts), minlength=len(counts))
    # A link that touches with its own skin is numbered as that skin.
    for number, toucher in enumerate(robot.touchers):
        for skin, worn in enumerate(robot.skins):
            if worn.geometry_id in toucher.geometry_ids:
                by_toucher[number] += by_toucher[len(touchers) + skin]
    return (
        dict(zip(skins, of_skin.tolist(), strict=True)),
        dict(zip(touchers, by_toucher[: len(touchers)].tolist(), strict=True)),
    )
