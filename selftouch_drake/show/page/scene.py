"""Shaded bodies on plain axes: an orthographic camera, sorted triangles, light.

Matplotlib's own 3-D axes sort whole collections by depth, not what is in them, and do not crop.
Here points are projected first, and whatever may hide each other is drawn as one collection.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from scipy.spatial import cKDTree

from selftouch_drake.lazy import trimesh
from selftouch_drake.show.style import INK, MUTED, View

# Share of the light that comes from everywhere.
_AMBIENT = 0.5
# Points tested at once for what hides them: bounds memory, not results.
_CHUNK = 64
# m, of a bar that shows the scale.
_BARS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
# Cosine of the angle between faces beyond which they meet in an edge, not in a smooth bend.
EDGE = 0.85


@dataclass(frozen=True, slots=True)
class ColoredMesh:
    """Triangles with colours.

    Attributes:
        triangles: `(N, 3, 3)` corners.
        normals: `(N, 3)` unit vectors, outward.
        rgb: `(N, 3)` before light falls on it.
    """

    triangles: np.ndarray
    normals: np.ndarray
    rgb: np.ndarray


def add_scene(figure: Figure, where: SubplotSpec, title: str = "") -> Axes:
    """Adds axes of one scale and without frame; they show what is drawn into them."""
    ax = figure.add_subplot(where, aspect="equal", title=title)
    ax.set_axis_off()
    ax.margins(0.02)
    return ax


def draw(
    ax: Axes,
    view: View,
    *meshes: ColoredMesh,
    opacity: float = 1.0,
    ambient: float = _AMBIENT,
    zorder: float = 1.0,
) -> None:
    """Draws the sides of meshes that face the camera, each triangle over those behind it.

    Args:
        ax: the axes of a scene.
        view: the camera.
        meshes: what is sorted together.
        opacity: of the whole; what is hidden behind the front of it stays hidden.
        ambient: share of the light that comes from everywhere; high where colours mean amounts.
        zorder: above what has a lower one.
    """
    triangles, normals, rgb = (
        np.concatenate([getattr(mesh, name) for mesh in meshes])
        for name in ("triangles", "normals", "rgb")
    )
    facing = normals @ view.towards > -0.02
    picture = view.project(triangles[facing])
    order = np.argsort(picture[..., 2].mean(axis=1))
    colors = _lit(rgb[facing], normals[facing], view, ambient)[order]
    # Edges in the colour of their face close the hairlines between neighbours.
    collection = PolyCollection(
        picture[order, :, :2],  # type: ignore[arg-type]  # an array is many times faster
        facecolors=colors,
        edgecolors=colors,
        linewidths=0.3,
        zorder=zorder,
        # Thousands of triangles stay pixels in a vector file, and can be translucent there.
        rasterized=True,
    )
    if opacity < 1.0:
        fade = np.array([1.0, 1.0, 1.0, opacity])
        collection.set_agg_filter(lambda image, dpi: (np.asarray(image) * fade, 0.0, 0.0))
    ax.add_collection(collection)
    ax.autoscale_view()


def visible(
    points: np.ndarray,
    vertices: np.ndarray,
    faces: np.ndarray,
    view: View,
    *,
    sheet: np.ndarray | bool = False,
    others: Sequence[tuple[np.ndarray, np.ndarray]] = (),
) -> np.ndarray:
    """Which points lie on the visible side of a surface.

    A point in the wall counts as the point of the surface nearest to it.

    Args:
        points: `(N, 3)`.
        vertices: `(V, 3)` of the surface.
        faces: `(F, 3)` indices, outward by the right hand.
        view: the camera.
        sheet: `(V,)` or one for all, whether the surface is seen from both sides there.
        others: vertices and faces of more surfaces that may hide points.

    Returns:
        `(N,)` whether nothing hides the point.
    """
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    _, nearest = cKDTree(vertices).query(points)
    asked, back = np.unique(nearest, return_inverse=True)
    normals = mesh.vertex_normals[asked]
    from_behind = np.broadcast_to(sheet, len(vertices))[asked] & (normals @ view.towards < 0)
    normals = np.where(from_behind[:, None], -normals, normals)
    lift = 1e-3 * np.ptp(vertices, axis=0).max()
    triangles = np.concatenate([mesh.triangles, *(vertices[faces] for vertices, faces in others)])
    return unhidden(mesh.vertices[asked] + lift * normals, triangles, view)[back]


def unhidden(points: np.ndarray, triangles: np.ndarray, view: View) -> np.ndarray:
    """`(N,)` which points `(N, 3)` none of some triangles `(M, 3, 3)` hides, wherever they are."""
    p = view.project(points)
    a, b, c = view.project(triangles).transpose(1, 2, 0)
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    flat = np.abs(area) < 1e-12
    area = np.where(flat, np.inf, area)
    hidden = np.zeros(len(points), dtype=bool)
    for first in range(0, len(points), _CHUNK):
        x, y, depth = p[first : first + _CHUNK, :, None].transpose(1, 0, 2)
        u = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
        v = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
        above = a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2]) > depth
        inside = (u >= 0) & (v >= 0) & (u + v <= 1) & ~flat
        hidden[first : first + _CHUNK] = (inside & above).any(axis=1)
    return ~hidden


def outline(
    ax: Axes, view: View, vertices: np.ndarray, faces: np.ndarray, *, zorder: float = 1.0
) -> None:
    """Draws the silhouette and the sharp edges of a closed surface, those behind it below all."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    towards = mesh.face_normals[mesh.face_adjacency] @ view.towards > 0
    sharp = np.cos(mesh.face_adjacency_angles) < 2 * EDGE**2 - 1
    front = (towards[:, 0] != towards[:, 1]) | (sharp & towards.any(axis=1))
    edges = mesh.vertices[mesh.face_adjacency_edges]
    # A silhouette that the body itself hides is not drawn.
    front[front] = visible(edges[front].mean(axis=1), vertices, faces, view)
    for shown, level in ((front, zorder), (sharp & ~towards.any(axis=1), 0.0)):
        lines = list(view.project(edges[shown])[..., :2])
        ax.add_collection(LineCollection(lines, colors=MUTED, linewidths=0.7, zorder=level))
    ax.autoscale_view()


def share_scale(axes: Sequence[Axes]) -> None:
    """Gives scenes the same limits."""
    limits = np.array([[*ax.get_xlim(), *ax.get_ylim()] for ax in axes])
    low, high = limits.min(axis=0), limits.max(axis=0)
    for ax in axes:
        ax.set(xlim=(low[0], high[1]), ylim=(low[2], high[3]))


def finish_row(figure: Figure) -> None:
    """Gives a row of scenes one scale, and a bar that shows it."""
    share_scale(figure.axes)
    scale_bar(figure.axes[0])


def scale_bar(ax: Axes) -> None:
    """Draws a bar of a round length in the lower left of the axes of a scene in metres."""
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    length = max((x for x in _BARS if x <= (right - left) / 5), default=_BARS[0])
    x, y = left + 0.01 * (right - left), bottom + 0.01 * (top - bottom)
    ax.plot([x, x + length], [y, y], color=INK, linewidth=1.6, solid_capstyle="butt", zorder=9)
    label = f"{100 * length:.0f} cm" if length < 1 else f"{length:.0f} m"
    ax.annotate(label, (x + length / 2, y), (0, 3), textcoords="offset points", ha="center")


def _lit(rgb: np.ndarray, normals: np.ndarray, view: View, ambient: float) -> np.ndarray:
    """Lambert's law with ambient light, and a soft highlight."""
    half = view.light + view.towards
    shine = 0.16 * np.clip(normals @ half / np.linalg.norm(half), 0.0, 1.0) ** 30
    brightness = ambient + (1.04 - ambient) * np.clip(normals @ view.light, 0.0, 1.0)
    shine *= (1.0 - ambient) / (1.0 - _AMBIENT)
    return np.clip(rgb * brightness[:, None] + shine[:, None], 0.0, 1.0)


def surface(
    vertices: np.ndarray, faces: np.ndarray, color: str | np.ndarray, *, max_edge: float = np.inf
) -> ColoredMesh:
    """A triangle surface.

    Args:
        vertices: `(V, 3)`.
        faces: `(F, 3)` indices, outward by the right hand.
        color: one for all, or `(V, 3)` RGB.
        max_edge: longest edge. Triangles with longer ones are cut, with normals and colours between
            those of their corners: a coarse surface looks smooth and stays where it is, and short
            edges can be sorted by depth.
    """
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    whole = mesh.area_faces > 0
    triangles, faces, flat = mesh.triangles[whole], mesh.faces[whole], mesh.face_normals[whole]
    smooth = mesh.vertex_normals[faces]
    is_edge = (flat[:, None] * smooth).sum(axis=2, keepdims=True) < EDGE
    rgb = np.broadcast_to(to_rgb(color) if isinstance(color, str) else color, np.shape(vertices))
    # What each corner carries; no corner is shared.
    carried = np.concatenate([np.where(is_edge, flat[:, None], smooth), rgb[faces]], axis=2)
    corners = np.arange(3 * len(faces)).reshape(-1, 3)
    cut, pieces, face = trimesh.remesh.subdivide_to_size(
        triangles.reshape(-1, 3), corners, max_edge=max_edge, return_index=True
    )
    pieces = cut[pieces]
    with np.errstate(all="ignore"):  # slivers get no normals, and are not drawn
        share = trimesh.triangles.points_to_barycentric(triangles[face], pieces.mean(axis=1))
    normals, rgb = np.split(np.einsum("fc,fcx->fx", share, carried[face]), 2, axis=1)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return ColoredMesh(pieces, normals, rgb)


def balls(
    centres: np.ndarray, radius: float | np.ndarray, color: str | np.ndarray, *, detail: int = 2
) -> ColoredMesh:
    """Spheres round `centres` `(N, 3)`, of one radius or `(N,)`, in one colour or `(N, 3)` RGB."""
    ball = trimesh.creation.icosphere(subdivisions=detail)
    corners = np.asarray(ball.triangles)
    rgb = np.broadcast_to(to_rgb(color) if isinstance(color, str) else color, centres.shape)
    radii = np.broadcast_to(radius, len(centres))[:, None, None, None]
    return ColoredMesh(
        (centres[:, None, None] + radii * corners).reshape(-1, 3, 3),
        np.tile(np.asarray(ball.face_normals), (len(centres), 1)),
        np.repeat(rgb, len(corners), axis=0),
    )
