"""The exact solid that pieces of geometry enclose together, repaired where they are bad."""

from collections.abc import Sequence
from dataclasses import dataclass

import manifold3d
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from selftouch_drake.lazy import trimesh

# An open piece is a sheet if, closed by lids, it encloses less than this share of its convex hull.
_SHEET = 0.1

#: A detached part with less than this share of the volume is debris of the drawing.
DEBRIS = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Pieces:
    """Pieces of geometry, closed.

    Attributes:
        triangles: `(F, 3, 3)` m, of all pieces and of the lids that close them.
        solid: what they enclose together, without cavities; None if that cannot be told exactly.
        remarks: what was wrong with the pieces and what was done about it, for the user.
    """

    triangles: np.ndarray
    solid: manifold3d.Manifold | None
    remarks: tuple[str, ...]

    @property
    def area(self) -> float | None:
        """Area of the solid, m²."""
        return None if self.solid is None else self.solid.surface_area()


def from_manifold(manifold: manifold3d.Manifold) -> trimesh.Trimesh:
    """The surface of a solid of manifold3d."""
    mesh = manifold.to_mesh64()
    # A copy: a view would keep manifold3d's mesh alive, which warns when Python exits.
    vertices = mesh.vert_properties[:, :3].copy()
    return trimesh.Trimesh(vertices, mesh.tri_verts.astype(np.int64), process=False)


def to_manifold(surface: trimesh.Trimesh) -> manifold3d.Manifold:
    """The solid of a closed surface."""
    # 64 bits, since single precision would move a face of a cube by 1e-8 m.
    return manifold3d.Manifold(
        manifold3d.Mesh64(
            np.ascontiguousarray(surface.vertices, dtype=np.float64),
            np.ascontiguousarray(surface.faces, dtype=np.uint64),
        )
    )


def closed_pieces(pieces: Sequence[trimesh.Trimesh]) -> Pieces:
    """Closes each piece, turns it outwards, and unites all.

    Raises:
        ValueError: there are no triangles.
    """
    closed, bodies = [], []
    holes = inverted = loose = flipped = 0
    for piece in pieces:
        if not len(piece.faces):
            continue
        lidded, num_rims, is_hull = _with_lids(piece)
        closed.append(lidded.triangles)
        holes += num_rims
        loose += is_hull
        if lidded.is_winding_consistent:
            inverted += int(lidded.volume < 0)
        for body in lidded.split(only_watertight=False):
            before = body.faces.copy()
            body.fix_normals(multibody=False)
            if not is_hull and not lidded.is_winding_consistent:
                flipped += int(np.count_nonzero((body.faces != before).any(axis=1)))
            bodies.append(body)
    if not closed:
        raise ValueError("surface has no triangles; choose a shape, or another link")
    remarks = []
    if loose:
        remarks.append(f"{_pieces(loose)} of triangles that enclose nothing became a convex hull")
    if holes:
        remarks.append(f"{holes} {'hole was' if holes == 1 else 'holes were'} closed by flat lids")
    if inverted:
        was = "was" if inverted == 1 else "were"
        remarks.append(f"{_pieces(inverted)} with normals that point inwards {was} turned outwards")
    if flipped:
        remarks.append(
            f"{flipped} triangles that faced inwards, among others that did not, were turned"
        )
    return Pieces(triangles=np.concatenate(closed), solid=_united(bodies), remarks=tuple(remarks))


def _pieces(number: int) -> str:
    return f"{number} {'piece' if number == 1 else 'pieces'}"


def _with_lids(piece: trimesh.Trimesh) -> tuple[trimesh.Trimesh, int, bool]:
    """A piece with lids on its rims, how many rims it had, and whether its hull replaced it."""
    piece = trimesh.Trimesh(piece.vertices, piece.faces, process=False)
    piece.merge_vertices()
    piece.update_faces(piece.nondegenerate_faces() & piece.unique_faces())
    _, first, count = np.unique(piece.edges_unique_inverse, return_index=True, return_counts=True)
    rim = piece.edges[first[count % 2 == 1]]
    if not len(rim):
        return piece, 0, False
    # Edges with an odd number of triangles form closed loops. A fan of triangles around its middle
    # closes each.
    part = trimesh.graph.connected_component_labels(rim, len(piece.vertices))
    _, loop = np.unique(part[rim[:, 0]], return_inverse=True)
    num_loops = int(loop.max()) + 1
    sums = np.zeros((num_loops, 3))
    np.add.at(sums, loop, piece.vertices[rim].mean(axis=1))
    middles = sums / np.bincount(loop)[:, None]
    lids = np.stack([rim[:, 1], rim[:, 0], len(piece.vertices) + loop], axis=1)
    closed = trimesh.Trimesh(
        np.concatenate([piece.vertices, middles]),
        np.concatenate([piece.faces, lids]),
        process=False,
    )
    try:
        hull = ConvexHull(piece.vertices)
    except QhullError:
        return closed, num_loops, False  # It is flat, and encloses nothing anyway.
    enclosed = np.linalg.det(closed.triangles - piece.vertices.mean(axis=0)).sum() / 6
    if abs(enclosed) > _SHEET * hull.volume:
        return closed, num_loops, False
    return trimesh.convex.convex_hull(piece.vertices), 0, True


def _united(bodies: Sequence[trimesh.Trimesh]) -> manifold3d.Manifold | None:
    """The one solid of closed bodies, cavities filled; None if they are open or do not touch."""
    solids = []
    for body in bodies:
        if not (body.is_watertight and body.is_winding_consistent) or body.volume == 0:
            return None
        solids.append(to_manifold(body))
        if solids[-1].status() != manifold3d.Error.NoError:
            return None
    united = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add)
    # A cavity is a part with a negative volume.
    parts = [part for part in united.decompose() if part.volume() > DEBRIS * united.volume()]
    return parts[0] if len(parts) == 1 else None
