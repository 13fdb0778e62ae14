"""Even triangles on a closed surface whose sharp edges stay where they are.

After Botsch and Kobbelt, "A remeshing approach to multiresolution modeling" (2004): long edges are
split, short ones collapsed, others flipped, and vertices even out along the surface.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from selftouch_drake.geometry.solids import from_manifold, to_manifold
from selftouch_drake.geometry.triangles import sample_triangles
from selftouch_drake.lazy import trimesh

#: rad; edges that bend by more are sharp. A cylinder of eleven faces is still round.
SHARP = np.radians(35)

# In edge lengths: longer edges are split, shorter ones collapsed (Botsch and Kobbelt: 4/3, 4/5);
# no collapse makes an edge longer than the third.
_SPLIT, _COLLAPSE, _LONGEST = 4 / 3, 0.7, 1.5
# A triangle may turn by this angle, as a cosine, when an edge is collapsed or flipped.
_TURN = 0.75
# Rounds of all steps.
_ROUNDS = 5
# Samples of the original surface around a vertex whose triangles are searched for its place.
_NEAR = 6


def has_sharp_edges(surface: trimesh.Trimesh) -> bool:
    """Whether a surface has edges that rounding would take away."""
    return bool((surface.face_adjacency_angles > SHARP).any())


def even_triangles(surface: trimesh.Trimesh, edge: float) -> trimesh.Trimesh:
    """Triangulates a closed surface with edges of about `edge` m, its sharp edges among them.

    Vertices lie on the surface. Where it is round, triangles cut off what lies between them.
    """
    split = to_manifold(surface)
    for _ in range(3):  # The first split leaves longer edges inside large triangles.
        split = split.refine_to_length(_SPLIT * edge)
    fine = from_manifold(split)
    bent = fine.face_adjacency_edges[fine.face_adjacency_angles > SHARP]
    sharp = {(a, b) for a, b in np.sort(bent, axis=1).tolist()}
    original = _Original(surface, edge)
    vertices, faces = np.array(fine.vertices), np.array(fine.faces)
    for _ in range(_ROUNDS):
        faces = _Collapsing(vertices, faces, sharp).collapse(edge)
        faces = _flipped(vertices, faces, sharp)
        vertices = _evened(vertices, faces, sharp, original)
    faces = _flipped(vertices, faces, sharp)
    even = trimesh.Trimesh(vertices, faces, process=False)
    even.remove_unreferenced_vertices()
    return even


class _Original:
    """The surface that vertices stay on."""

    def __init__(self, surface: trimesh.Trimesh, edge: float) -> None:
        self._triangles = np.array(surface.triangles)
        spacing = max(edge / 4, np.sqrt(surface.area / 400_000))  # samples that fit in memory
        samples, self._face = sample_triangles(self._triangles, spacing)
        self._tree = cKDTree(samples)

    def nearest(self, p: np.ndarray) -> np.ndarray:
        """`(N, 3)` m, the points of the surface nearest to `(N, 3)` m, up to its samples."""
        _, found = self._tree.query(p, _NEAR)
        triangles = self._triangles[self._face[found]].reshape(-1, 3, 3)
        points = np.repeat(p, _NEAR, axis=0)
        on = trimesh.triangles.closest_point(triangles, points).reshape(-1, _NEAR, 3)
        best = np.linalg.norm(on - p[:, None], axis=2).argmin(axis=1)
        return on[np.arange(len(p)), best]


class _Collapsing:
    """Collapses short edges of a mesh; `sharp` edges, as sorted pairs, change with it."""

    def __init__(
        self, vertices: np.ndarray, faces: np.ndarray, sharp: set[tuple[int, int]]
    ) -> None:
        self.p, self.faces, self.sharp = vertices, faces.tolist(), sharp
        self.around: list[set[int]] = [set() for _ in vertices]
        for number, face in enumerate(self.faces):
            for vertex in face:
                self.around[vertex].add(number)
        self.lines: list[set[int]] = [set() for _ in vertices]
        for a, b in sharp:
            self.lines[a].add(b)
            self.lines[b].add(a)

    def collapse(self, edge: float) -> np.ndarray:
        """`(F, 3)` the faces that are left when edges far shorter than `edge` m are gone."""
        ends = np.unique(
            np.sort(np.array(self.faces)[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)), axis=0
        )
        length = np.linalg.norm(self.p[ends[:, 0]] - self.p[ends[:, 1]], axis=1)
        short = np.flatnonzero(length < _COLLAPSE * edge)
        for number in short[np.argsort(length[short], kind="stable")].tolist():
            a, b = ends[number].tolist()
            for gone, kept in ((a, b), (b, a)):
                if self._may(gone, kept, _LONGEST * edge):
                    self._take_out(gone, kept)
                    break
        return np.array([face for face in self.faces if face is not None])

    def _neighbours(self, vertex: int) -> set[int]:
        return {v for f in self.around[vertex] for v in self.faces[f]} - {vertex}

    def _may(self, gone: int, kept: int, longest: float) -> bool:
        lines = self.lines[gone]
        if lines and (len(lines) != 2 or kept not in lines):
            return False  # It is a corner, or would leave its sharp edge.
        near = self._neighbours(gone)
        if kept not in near or len(near & self._neighbours(kept)) != 2:
            return False
        if any(self.lines[v] and v in lines and v != kept and kept in self.lines[v] for v in near):
            return False  # A sharp edge would be doubled.
        place = self.p[kept]
        if np.linalg.norm(self.p[list(near)] - place, axis=1).max() > longest:
            return False
        if lines:
            one, other = (self.p[v] - self.p[gone] for v in lines)
            cosine = -(one @ other) / (np.linalg.norm(one) * np.linalg.norm(other))
            if cosine < _TURN:
                return False  # It is a corner of the line.
        stay = [self.faces[f] for f in self.around[gone] if kept not in self.faces[f]]
        old = self.p[stay]
        new = np.where((np.array(stay) == gone)[:, :, None], place, old)
        before, after = (np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]) for t in (old, new))
        size = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
        return bool((np.einsum("fi,fi->f", before, after) > _TURN * size).all())

    def _take_out(self, gone: int, kept: int) -> None:
        for number in list(self.around[gone]):
            face = self.faces[number]
            if kept in face:
                for vertex in face:
                    self.around[vertex].discard(number)
                self.faces[number] = None
            else:
                self.faces[number] = [kept if v == gone else v for v in face]
                self.around[kept].add(number)
        self.around[gone] = set()
        for other in self.lines[gone]:
            self.lines[other].discard(gone)
            self.sharp.discard((min(gone, other), max(gone, other)))
            if other != kept:
                self.lines[other].add(kept)
                self.lines[kept].add(other)
                self.sharp.add((min(kept, other), max(kept, other)))
        self.lines[gone] = set()


def _flipped(vertices: np.ndarray, faces: np.ndarray, sharp: set[tuple[int, int]]) -> np.ndarray:
    """Flips edges until the angles opposite to each sum to less than 180 degrees, where it can."""
    faces = faces.copy()
    for _ in range(6):
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        pair, ends = mesh.face_adjacency, mesh.face_adjacency_edges
        tips = mesh.face_adjacency_unshared
        excess = _opposite_angles(vertices, ends, tips) - np.pi
        wanted = np.flatnonzero(excess > 1e-3)
        normal = mesh.face_normals
        known = {(a, b) for a, b in mesh.edges_unique.tolist()}
        taken, changed = set[int](), False
        for number in wanted[np.argsort(-excess[wanted], kind="stable")].tolist():
            one, other = pair[number].tolist()
            a, b = ends[number].tolist()
            c, d = tips[number].tolist()
            new = (min(c, d), max(c, d))
            if one in taken or other in taken or new in known or (min(a, b), max(a, b)) in sharp:
                continue
            first = [d if v == b else v for v in faces[one].tolist()]
            second = [c if v == a else v for v in faces[other].tolist()]
            turned = [_normal(vertices[face]) for face in (first, second)]
            if min(turn @ normal[f] for turn in turned for f in (one, other)) < _TURN:
                continue
            faces[one], faces[other] = first, second
            taken |= {one, other}
            known.add(new)
            changed = True
        if not changed:
            break
    return faces


def _opposite_angles(p: np.ndarray, ends: np.ndarray, tips: np.ndarray) -> np.ndarray:
    """`(E,)` rad, sum of the angles opposite to each edge, in its two triangles."""
    total = np.zeros(len(ends))
    for tip in tips.T:
        one, other = p[ends[:, 0]] - p[tip], p[ends[:, 1]] - p[tip]
        across = np.linalg.norm(np.cross(one, other), axis=1)
        total += np.arctan2(across, np.einsum("ei,ei->e", one, other))
    return total


def _normal(triangle: np.ndarray) -> np.ndarray:
    normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    return normal / max(np.linalg.norm(normal), 1e-300)


def _evened(
    vertices: np.ndarray, faces: np.ndarray, sharp: set[tuple[int, int]], original: _Original
) -> np.ndarray:
    """`(V, 3)` m, vertices closer to the middle of their neighbours, on the original surface.

    Vertices on sharp edges stay.
    """
    count = len(vertices)
    ends = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    near = coo_array((np.ones(len(ends)), tuple(ends.T)), shape=(count, count)).tocsr()
    free = near.sum(axis=1) > 0
    free[np.array(list(sharp), dtype=int).ravel()] = False
    moved = vertices.copy()
    middle = (near @ vertices)[free] / near.sum(axis=1)[free, None]
    moved[free] = original.nearest((vertices[free] + middle) / 2)
    # A step must not turn a triangle over: corners of those that would stay.
    before, after = (
        np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]) for t in (vertices[faces], moved[faces])
    )
    size = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    back = np.unique(faces[np.einsum("fi,fi->f", before, after) <= _TURN * size])
    moved[back] = vertices[back]
    return moved
