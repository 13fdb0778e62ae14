"""Receptors spread evenly over a surface or placed on it, and their receptive fields."""

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix, vstack
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from selftouch_drake.geometry.farthest import farthest_points
from selftouch_drake.geometry.geodesics import surface_paths
from selftouch_drake.lazy import trimesh

FEWEST_RECEPTORS, MOST_RECEPTORS = 4, 10_000

# Every point of the skin is felt by at least this number of receptors.
OVERLAP = 3

# Fields reach beyond the distance from the worst point to its third receptor, so that it feels it.
FIELD_MARGIN = 1.15

# m, edge length at which fields are sampled, and fewest edges between neighbouring receptors: dense
# receptors need shorter edges.
FIELD_RESOLUTION = 0.012
EDGES_BETWEEN_RECEPTORS = 4

# Receptors whose distances to the vertices are found at once: bounds the memory.
_AT_ONCE = 64


@dataclass(frozen=True, kw_only=True)
class ReceptiveFields:
    """Overlapping receptive fields of S receptors, measured along a surface.

    At each point of the surface the weights of all receptors sum to one, so distributing a force
    over the receptors conserves it. Where there are gaps between fields, they sum to less.

    Attributes:
        p_LS: `(S, 3)` m, receptors in the link's frame L.
        vertices: `(V, 3)` m, of the surface on which the fields are sampled.
        faces: `(F, 3)` indices into `vertices`.
        vertex_weights: `(V, S)` sparse, the share of each receptor at each vertex.
        radius: m, distance along the surface at which a typical field ends.
    """

    p_LS: np.ndarray
    vertices: np.ndarray
    faces: np.ndarray
    vertex_weights: csr_matrix
    radius: float

    @property
    def num_receptors(self) -> int:
        """S, the length of a sensation."""
        return len(self.p_LS)

    def weights_at(self, p_LQ: np.ndarray) -> csr_matrix:
        """`(N, S)` sparse: the share of each receptor in a force at each point `(N, 3)` m.

        A point in the wall of the skin counts as the nearest point of the surface.
        """
        vertices, parts = self.parts_at(p_LQ)
        ends = np.arange(0, parts.size + 1, 3, dtype=np.int32)
        shape = len(parts), len(self.vertices)
        return csr_matrix((parts.ravel(), vertices.ravel(), ends), shape) @ self.vertex_weights

    def parts_at(self, p_LQ: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`(N, 3)` vertices of the triangle nearest to points `(N, 3)` m, barycentric weights."""
        p_LQ = np.asarray(p_LQ, dtype=float)
        _, face = self._centroids.query(p_LQ)
        parts = np.einsum("nij,nj->ni", self.barycentric[face, :, :3], p_LQ)
        parts += self.barycentric[face, :, 3]
        np.maximum(parts, 0, out=parts)
        parts /= parts.sum(axis=1, keepdims=True)
        return self.faces[face], parts

    @cached_property
    def _centroids(self) -> cKDTree:
        # Larger leaves than scipy's 16 save a fifth of the time on points inside a wall.
        return cKDTree(self.vertices[self.faces].mean(axis=1), leafsize=32)

    @cached_property
    def barycentric(self) -> np.ndarray:
        """`(F, 3, 4)` weights of the corners of each triangle, linear in a point.

        The gradient in the triangle's plane, 1/m, and the weight at the link's origin.
        """
        corners = self.vertices[self.faces]
        a, b, c = corners.swapaxes(0, 1)
        normal = np.cross(b - a, c - a)
        opposite = np.stack([c - b, a - c, b - a], axis=1)
        area = np.einsum("fi,fi->f", normal, normal)[:, None, None]
        gradients = np.cross(normal[:, None], opposite) / area
        offsets = 1 / 3 - np.einsum("fij,fj->fi", gradients, corners.mean(axis=1))
        return np.concatenate([gradients, offsets[:, :, None]], axis=2)


def place_receptors(
    surface: trimesh.Trimesh, num_receptors: int, seed: int, *, unevenness: float = 0.0
) -> np.ndarray:
    """Spreads receptors evenly: each at the vertex farthest, along the surface, from earlier ones.

    For an uneven layout, distances count less towards one side of the surface. Returns
    `(num_receptors, 3)` m, in the link's frame L.

    Args:
        surface: Closed outer surface in the link's frame L, m.
        num_receptors: 4 to 10,000.
        seed: Chooses the first vertex, and the side where receptors are few.
        unevenness: 0 to below 1; at u, receptors there are 1 / (1 - u) times as far apart as on
            the other side.

    Raises:
        ValueError: If `num_receptors` is out of range, or more than the surface has vertices.
    """
    if not FEWEST_RECEPTORS <= num_receptors <= MOST_RECEPTORS:
        raise ValueError(
            f"num_receptors is {num_receptors}; give {FEWEST_RECEPTORS} to {MOST_RECEPTORS}"
        )
    surface = _refined(surface, math.sqrt(surface.area / num_receptors))
    paths = surface_paths(surface)
    nearest = np.full(len(surface.vertices), np.inf)

    def distance_from(vertex: int) -> np.ndarray:
        # Longer distances than the largest one left change nothing: the search ends there.
        found = dijkstra(paths, indices=vertex, limit=nearest.max())
        return np.minimum(nearest, found, out=nearest)

    along = surface.vertices @ np.random.default_rng([seed, 1]).standard_normal(3)
    receptors = farthest_points(
        distance_from,
        num_receptors,
        first=int(np.random.default_rng(seed).integers(len(surface.vertices))),
        # From 1 on one side of the surface to `1 - unevenness` on the other.
        weight=1 - unevenness * (along - along.min()) / np.ptp(along),
    )
    return surface.vertices[receptors]


def receptive_fields(
    surface: trimesh.Trimesh, p_LS: np.ndarray, *, width: float = 1.0
) -> ReceptiveFields:
    """Gives each receptor a smooth round field, wide enough that three overlap everywhere.

    The field of a receptor, `(S, 3)` m on the closed surface, is centred on the nearest vertex; its
    radius is the smallest one, times `width`. Below 1, a force in a gap between fields is not felt,
    and on the slope of a single one it is felt in part.
    """
    surface = _refined(surface, math.sqrt(surface.area / len(p_LS)))
    _, nearest = cKDTree(surface.vertices).query(p_LS)
    paths = surface_paths(surface)
    for reach in (3 * math.sqrt(surface.area / len(p_LS)), np.inf):
        distance, farthest = _distances_within(paths, nearest, reach)
        if (radius := width * FIELD_MARGIN * farthest) <= reach:
            break
    bump = np.square(np.maximum(1 - np.square(distance.data / radius), 0))
    vertex_weights = csr_matrix((bump, distance.indices, distance.indptr), distance.shape)
    vertex_weights.eliminate_zeros()
    vertex_weights = vertex_weights.T.tocsr()
    total = np.maximum(vertex_weights @ np.ones(len(p_LS)), 1.0 if width < 1 else 0.0)
    vertex_weights.data /= np.repeat(total, np.diff(vertex_weights.indptr))
    return ReceptiveFields(
        p_LS=surface.vertices[nearest],
        vertices=np.array(surface.vertices),
        faces=np.array(surface.faces, dtype=np.int32),
        vertex_weights=vertex_weights,
        radius=float(radius),
    )


def _distances_within(
    paths: csr_matrix, centre: np.ndarray, reach: float
) -> tuple[csr_matrix, float]:
    """`(S, V)` m, sparse, distances up to `reach` from `(S,)` vertices along the surface.

    Also the largest distance from a vertex to its third nearest centre: infinite if there is none
    within reach. A dense table would take gigabytes for some thousand receptors.
    """
    rows, nearest = [], np.full((OVERLAP, paths.shape[0]), np.inf)
    for some in np.array_split(centre, len(centre) // _AT_ONCE + 1):
        distance = dijkstra(paths, indices=some, limit=reach)
        nearest = np.sort(np.concatenate([nearest, distance]), axis=0)[:OVERLAP]
        row, vertex = np.nonzero(np.isfinite(distance))
        ends = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=len(some)))])
        # Zeros, which are the centres themselves, are kept.
        rows.append(csr_matrix((distance[row, vertex], vertex, ends), distance.shape))
    return vstack(rows, format="csr"), float(nearest[-1].max())


def placed_fields(
    surface: trimesh.Trimesh,
    p_LS: np.ndarray,
    *,
    normal: np.ndarray | None = None,
    radius: np.ndarray | None = None,
    width: float = 1.0,
) -> tuple[ReceptiveFields, np.ndarray]:
    """Gives receptors that lie where they lie a smooth round field each, overlapping or not.

    Each field is centred on the nearest vertex of the surface, with a normal on one that faces the
    same way. Time and memory follow what the fields cover, not their number.

    Args:
        surface: Closed outer surface in the link's frame L, m.
        p_LS: `(S, 3)` m, receptors on the surface or near it, at least four.
        normal: `(S, 3)` unit length, outward; or None.
        radius: `(S,)` m, of each field; None for one that reaches, for a typical receptor, a little
            beyond the third nearest one.
        width: Factor on the radius.

    Returns:
        The fields; and `(S,)` m, by how much each receptor was moved onto the surface.
    """
    if radius is None:
        radius = np.full(len(p_LS), usual_radius(p_LS))
    radius = width * radius
    typical = float(np.median(radius))
    surface = _refined(surface, float(np.median(cKDTree(p_LS).query(p_LS, 2)[0][:, 1])))
    nearest = _nearest_vertices(surface, p_LS, normal, typical)
    weights = _round_fields(surface, nearest, radius)
    total = np.maximum(weights.sum(axis=1).A1, 1.0)
    weights.data /= np.repeat(total, np.diff(weights.indptr))
    vertices = np.array(surface.vertices)
    fields = ReceptiveFields(
        p_LS=vertices[nearest],
        vertices=vertices,
        faces=np.array(surface.faces, dtype=np.int32),
        vertex_weights=weights,
        radius=typical,
    )
    corner, part = fields.parts_at(p_LS)
    foot = np.einsum("nk,nki->ni", part, vertices[corner])
    to_surface = np.linalg.norm(p_LS - foot, axis=1)
    to_vertex = np.linalg.norm(p_LS - fields.p_LS, axis=1)
    return fields, np.minimum(to_surface, to_vertex)


def usual_radius(p_LS: np.ndarray) -> float:
    """m, radius of a field that reaches a little beyond the third nearest of `(S, 3)` receptors."""
    distance, _ = cKDTree(p_LS).query(p_LS, 1 + OVERLAP)
    return float(FIELD_MARGIN * np.median(distance[:, OVERLAP]))


def _nearest_vertices(
    surface: trimesh.Trimesh, p_LS: np.ndarray, normal: np.ndarray | None, radius: float
) -> np.ndarray:
    """`(S,)` the vertex nearest to each receptor; with normals, one that faces the same way."""
    if normal is None:
        return cKDTree(np.array(surface.vertices)).query(p_LS)[1]
    # To face the other way costs as much as a distance of the radius.
    vertices = np.hstack([surface.vertices, radius / 2 * surface.vertex_normals])
    return cKDTree(vertices).query(np.hstack([p_LS, radius / 2 * normal]))[1]


def _round_fields(surface: trimesh.Trimesh, centre: np.ndarray, radius: np.ndarray) -> csr_matrix:
    """`(V, S)` smooth round bumps about `(S,)` vertices, each 0 from its `(S,)` radius, m, on."""
    paths, rows = surface_paths(surface), []
    for some in np.array_split(np.arange(len(centre)), len(centre) // _AT_ONCE + 1):
        distance = dijkstra(paths, indices=centre[some], limit=radius[some].max())
        bump = np.square(np.maximum(1 - np.square(distance / radius[some, None]), 0))
        rows.append(csr_matrix(bump))
    return vstack(rows).T.tocsr()


def group_centres(fields: ReceptiveFields, group: np.ndarray) -> ReceptiveFields:
    """Fields of three readings for each group: its total force and its centre of pressure.

    The corners of a triangle around the group, in its plane, share the force of each receptor by
    its barycentric coordinates. So the three sum to the total, and the mean of the corners,
    weighted by them, is the centre.

    Args:
        fields: of S receptors.
        group: `(S,)` 0 to G - 1, the group of each.
    """
    corners, share = [], np.zeros((len(group), 3 * (int(group.max()) + 1)))
    turns = 2 * np.pi / 3 * np.arange(3)
    for number in range(share.shape[1] // 3):
        members = np.flatnonzero(group == number)
        centre = fields.p_LS[members].mean(axis=0)
        away = fields.p_LS[members] - centre
        plane = np.linalg.svd(away, full_matrices=True)[2][:2]
        directions = np.stack([np.cos(turns), np.sin(turns)], axis=1)
        radius = max(np.linalg.norm(away @ plane.T, axis=1).max(), 1e-9)
        share[members, 3 * number : 3 * number + 3] = (
            1 + away @ plane.T @ directions.T / radius
        ) / 3
        corners.append(centre + radius * directions @ plane)
    nearest = cKDTree(fields.vertices).query(np.concatenate(corners))[1]
    return dataclasses.replace(
        fields,
        p_LS=fields.vertices[nearest],
        vertex_weights=csr_matrix(fields.vertex_weights @ share),
    )


def _refined(surface: trimesh.Trimesh, spacing: float) -> trimesh.Trimesh:
    """Refines the triangles of a surface enough for fields; its vertices stay, and come first."""
    resolution = min(FIELD_RESOLUTION, spacing / EDGES_BETWEEN_RECEPTORS)
    mean_edge = surface.edges_unique_length.mean()
    halvings = max(round(math.log2(mean_edge / resolution)), 0)
    return surface.subdivide(iterations=halvings) if halvings else surface
