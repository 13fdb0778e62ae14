"""A hollow skin: a closed surface extruded inwards and filled with tetrahedra."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from selftouch_drake.geometry.geodesics import neighbouring_vertices
from selftouch_drake.geometry.triangles import first_self_intersection, sample_triangles
from selftouch_drake.lazy import trimesh

# If the normals around a vertex differ by more than this, it is on an edge, which is mitred; else
# the surface is smooth there. It is the ratio of their second to their first principal value: about
# 25 degrees.
MITRE_RATIO = 0.05

# Smallest wall, in thicknesses: on a smooth surface it is slightly thinner where triangles bend.
THINNEST_WALL = 0.9

# Distance from an edge, in thicknesses, up to which vertices slide to make room for its mitre.
_SLIDE_RANGE = 2

# Rounds of repairing a wall, and its desired share of the thickness where it is too thin.
_MENDINGS = 20
_MENDED_WALL = 0.95

# Largest number of samples of a surface, about.
_MOST_SAMPLES = 400_000


@dataclass(frozen=True, slots=True, kw_only=True)
class HollowSkin:
    """The wall between a closed outer surface and a copy of it moved inwards.

    All points are in the frame of the outer surface, the link's frame L, in metres.

    Attributes:
        vertices: `(V, 3)` m, of the outer surface.
        faces: `(F, 3)` indices into `vertices` and `inner_vertices`; normals point outward.
        inner_vertices: `(V, 3)` m, one below each outer vertex.
        thickness: m, from the outer faces to the inner ones.
        tet_vertices: `(3 V, 3)` m: the outer vertices, those at mid-depth, the inner ones.
        tetrahedra: `(6 F, 4)` indices into `tet_vertices`, all with positive volume.
    """

    vertices: np.ndarray
    faces: np.ndarray
    inner_vertices: np.ndarray
    thickness: float
    tet_vertices: np.ndarray
    tetrahedra: np.ndarray

    def samples(self, spacing: float) -> np.ndarray:
        """`(N, 3)` m, points on the outer, middle and inner layer of the wall.

        Every point of a layer is within `spacing` m of one of them.
        """
        layers = len(self.vertices) * np.arange(3)[:, None, None]
        triangles = self.tet_vertices[(self.faces + layers).reshape(-1, 3)]
        return sample_triangles(triangles, spacing)[0]


def hollow_skin(
    surface: trimesh.Trimesh, thickness: float, *, mendings: int = _MENDINGS
) -> HollowSkin:
    """Extrudes a closed surface inwards into a skin, with vertices at mid-depth.

    Hydroelastic pressure is zero on the boundary of a mesh, so a wall without inner vertices would
    feel nothing.

    Args:
        surface: Closed outer surface, in m, wound outwards.
        thickness: m, by which each face moves inwards.
        mendings: Rounds of repairing the inner wall where it folds, is thin or crosses itself.

    Raises:
        ValueError: If the skin is thicker than the surface allows.
    """
    if not thickness > 0:
        raise ValueError(f"thickness is {thickness:g} m; give a positive length in metres")
    vertices = np.array(surface.vertices)
    faces = np.array(surface.faces)
    tetrahedra = _fill_prisms(faces, len(vertices))
    inner_vertices = _inner_wall(surface, thickness, tetrahedra, mendings)
    return HollowSkin(
        vertices=vertices,
        faces=faces,
        inner_vertices=inner_vertices,
        thickness=thickness,
        tet_vertices=_three_layers(vertices, inner_vertices),
        tetrahedra=tetrahedra,
    )


def tet_volumes(vertices: np.ndarray, tetrahedra: np.ndarray) -> np.ndarray:
    """Returns `(T,)` m³, signed volumes: positive as Drake's `VolumeMesh` requires."""
    a, b, c, d = vertices[tetrahedra].swapaxes(0, 1)
    return np.einsum("ni,ni->n", np.cross(b - a, c - a), d - a) / 6


def vtk_text(skin: HollowSkin) -> str:
    """The tetrahedra as a legacy ASCII VTK file, as `pydrake.geometry.Mesh` reads them."""
    num_vertices, num_tets = len(skin.tet_vertices), len(skin.tetrahedra)
    lines = [
        "# vtk DataFile Version 3.0",
        f"Hollow skin, {skin.thickness!r} m thick",
        "ASCII",
        "DATASET UNSTRUCTURED_GRID",
        f"POINTS {num_vertices} double",
        *(f"{x!r} {y!r} {z!r}" for x, y, z in skin.tet_vertices.tolist()),
        f"CELLS {num_tets} {5 * num_tets}",
        *(f"4 {a} {b} {c} {d}" for a, b, c, d in skin.tetrahedra.tolist()),
        f"CELL_TYPES {num_tets}",
        *["10"] * num_tets,
    ]
    return "\n".join(lines) + "\n"


def _inner_wall(
    surface: trimesh.Trimesh, thickness: float, tetrahedra: np.ndarray, mendings: int
) -> np.ndarray:
    """Moves a surface inwards by one method after another, until its wall is valid.

    Returns `(V, 3)` m, the inner vertices.

    Raises:
        ValueError: The wall of the last attempt folds, is too thin or crosses itself.
    """
    check = _WallCheck(surface, thickness, tetrahedra)
    vertices = surface.vertices
    # The smoothest steps come first. On a long limb they slide far along it, and into its ends.
    for slide_range in (np.inf, _SLIDE_RANGE * thickness):
        inner = vertices + thickness * _inward_steps(surface, slide_range)
        if (fault := check.first_fault(inner)) is None:
            return inner
    # Then a few vertices of a rugged surface are repaired.
    steps, neighbours = inner - vertices, neighbouring_vertices(surface)
    for attempt in range(mendings):
        steps = _mended(steps, check, neighbours, rings=1 + attempt // 4)
        if (fault := check.first_fault(vertices + steps)) is None:
            return vertices + steps
    assert fault is not None
    raise ValueError(
        f"thickness is {thickness:g} m, thicker than the surface allows near "
        f"{point_text(fault)} m; make the skin thinner or the surface larger"
    )


class _WallCheck:
    """Checks inner walls of one surface.

    Attributes:
        surface: the outer surface.
        thickness: m, of the wall.
        cloud: `(N, 3)` m, points of the outer surface.
        outer: a tree of them.
    """

    def __init__(self, surface: trimesh.Trimesh, thickness: float, tetrahedra: np.ndarray) -> None:
        self.surface, self.thickness, self._tetrahedra = surface, thickness, tetrahedra
        # Distances to these samples exceed those to the surface by less than 1 % of the thickness.
        finest = np.sqrt(surface.area / _MOST_SAMPLES)  # whose samples fit in memory
        self.cloud, _ = sample_triangles(surface.triangles, max(thickness / 8, finest))
        self.outer = cKDTree(self.cloud)

    def folded(self, inner: np.ndarray) -> np.ndarray:
        """`(F,)` bool, faces below which the wall is turned inside out."""
        volumes = tet_volumes(_three_layers(self.surface.vertices, inner), self._tetrahedra)
        return volumes.reshape(-1, 6).min(axis=1) <= 0

    def first_fault(self, inner: np.ndarray) -> np.ndarray | None:
        """`(3,)` m, a place where the wall folds, is too thin or crosses itself; None if none."""
        if (folds := self.folded(inner)).any():
            return self.surface.triangles_center[folds.argmax()]
        distance, _ = self.outer.query(inner)
        if distance.min() < THINNEST_WALL * self.thickness:
            return self.surface.vertices[distance.argmin()]
        return first_self_intersection(inner, self.surface.faces)


def _mended(
    steps: np.ndarray, check: _WallCheck, neighbours: scipy.sparse.csr_array, rings: int
) -> np.ndarray:
    """`(V, 3)` m, better steps from outer to inner vertices.

    Where the wall folds or crosses itself, vertices, and some rings of neighbours around them, move
    as their neighbours do; where it is thin, they move deeper.
    """
    vertices, faces, thickness = check.surface.vertices, check.surface.faces, check.thickness
    bad = np.zeros(len(vertices), dtype=bool)
    bad[faces[check.folded(vertices + steps)]] = True
    if not bad.any():
        crossing = first_self_intersection(vertices + steps, faces)
        if crossing is not None:
            near = np.linalg.norm(vertices + steps - crossing, axis=1)
            bad = near <= max(thickness, near.min())
    for _ in range(rings):
        bad |= neighbours @ bad > 0
    steps = steps.copy()
    steps[bad] = (neighbours[bad] @ steps) / neighbours[bad].sum(axis=1)[:, None]
    distance, nearest = check.outer.query(vertices + steps)
    missing = np.maximum(_MENDED_WALL * thickness - distance, 0)
    away = (vertices + steps - check.cloud[nearest]) / np.maximum(distance, 1e-12)[:, None]
    return steps + missing[:, None] * away


def _inward_steps(surface: trimesh.Trimesh, slide_range: float) -> np.ndarray:
    """Returns `(V, 3)` steps d that move every face inwards by one: n · d = -1.

    The faces around each vertex fix d in the directions that their normals span (least squares,
    weighted by their angles there): one on a smooth surface, two on an edge, three at a corner.
    In the other directions d is the smoothest field (of least Dirichlet energy), so that vertices
    next to an edge make room for it: a cube simply shrinks. A finite `slide_range`, in m, limits
    how far from an edge they do so.
    """
    num_vertices = len(surface.vertices)
    corners = surface.faces.ravel()
    normals = np.repeat(surface.face_normals, 3, axis=0)
    weights = surface.face_angles.ravel()
    mean = np.zeros((num_vertices, 3))
    spread = np.zeros((num_vertices, 3, 3))
    np.add.at(mean, corners, weights[:, None] * normals)
    np.add.at(spread, corners, weights[:, None, None] * normals[:, :, None] * normals[:, None, :])
    values, axes = np.linalg.eigh(spread)
    spanned = values > MITRE_RATIO * values[:, -1:]
    along = np.einsum("vik,vi->vk", axes, mean)
    lengths = np.divide(along, values, where=spanned, out=np.zeros_like(along))
    fixed = -np.einsum("vik,vk->vi", axes, lengths).ravel()
    vertex, axis = np.nonzero(~spanned)
    rows = 3 * vertex[:, None] + np.arange(3)
    columns = np.repeat(np.arange(len(vertex)), 3)
    free = scipy.sparse.csc_array(
        (axes[vertex, :, axis].ravel(), (rows.ravel(), columns)),
        shape=(3 * num_vertices, len(vertex)),
    )
    stiffness = scipy.sparse.kron(_laplacian(surface), scipy.sparse.eye_array(3), format="csc")
    energy = free.T @ stiffness @ free
    if np.isfinite(slide_range):
        share = np.repeat(surface.area_faces / 3, 3)
        area = np.bincount(corners, weights=share, minlength=num_vertices)
        energy = energy + scipy.sparse.diags_array(area[vertex] / slide_range**2)
    slide = spsolve(energy.tocsc(), -free.T @ (stiffness @ fixed))
    return (fixed + free @ slide).reshape(-1, 3)


def _laplacian(surface: trimesh.Trimesh) -> scipy.sparse.csr_array:
    """Returns the `(V, V)` cotangent Laplacian with positive weights."""
    faces = surface.faces
    weights = np.maximum(1 / np.tan(surface.face_angles), 1e-9).ravel() / 2
    ends = np.stack([np.roll(faces, -1, axis=1).ravel(), np.roll(faces, -2, axis=1).ravel()])
    shape = (len(surface.vertices), len(surface.vertices))
    adjacency = scipy.sparse.coo_array((weights, tuple(ends)), shape=shape).tocsr()
    adjacency = adjacency + adjacency.T
    return scipy.sparse.diags_array(adjacency.sum(axis=1)) - adjacency


def _three_layers(vertices: np.ndarray, inner_vertices: np.ndarray) -> np.ndarray:
    """Returns `(3 V, 3)` m: the outer vertices, those at mid-depth, the inner ones."""
    return np.concatenate([vertices, (vertices + inner_vertices) / 2, inner_vertices])


def _fill_prisms(faces: np.ndarray, num_vertices: int) -> np.ndarray:
    """Returns `(6 F, 4)` tetrahedra between three layers of `num_vertices` vertices each.

    Every prism is split along a staircase that steps down at its lowest vertex first, so that two
    neighbours split the wall between them along the same diagonal.
    """
    order = np.argsort(faces, axis=1)
    a, b, c = np.take_along_axis(faces, order, axis=1).T
    # Sorting an outward face may flip it; swapping two corners flips its tetrahedra back.
    even = (order[:, 1] - order[:, 0]) % 3 == 1
    layers = []
    for top in (0, num_vertices):
        bottom = top + num_vertices
        for tet in (
            (a + top, b + top, c + top, c + bottom),
            (a + top, b + top, c + bottom, b + bottom),
            (a + top, b + bottom, c + bottom, a + bottom),
        ):
            corners = np.stack(tet, axis=1)
            corners[even] = corners[even][:, [1, 0, 2, 3]]
            layers.append(corners)
    return np.stack(layers, axis=1).reshape(-1, 4)


def point_text(p: np.ndarray) -> str:
    """A place `(3,)` m as errors show it."""
    return "(" + ", ".join(f"{value:.3f}" for value in p) + ")"
