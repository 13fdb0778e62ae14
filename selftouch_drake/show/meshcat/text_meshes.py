"""Text in Meshcat, which has none: letters as flat meshes, and the legend of the colours.

Meshes and not pictures: a page requests a picture only after it has heard of it, and a slow page
requests pictures that are gone by then.
"""

from __future__ import annotations

import manifold3d
import numpy as np
from matplotlib.textpath import TextPath
from pydrake.geometry import Meshcat, Rgba
from pydrake.math import RigidTransform, RotationMatrix

from selftouch_drake.show.style import PRESSURE
from selftouch_drake.show.view import View

# Size at which outlines are taken from the font: fine enough that bends look round.
_FONT_SIZE = 60.0
_LINE_SPACING = 1.5


def put_text(
    meshcat: Meshcat,
    path: str,
    text: str,
    centre: np.ndarray,
    view: View,
    *,
    size: float,
    color: Rgba,
) -> None:
    """Writes one or more lines so that they face the camera of `view`.

    Args:
        meshcat: where.
        path: in Meshcat; what was written there is replaced.
        text: the lines.
        centre: `(3,)` m, the middle of the first line.
        view: the camera.
        size: m, of the font.
        color: of the letters.
    """
    vertices, faces = letters(text)
    meshcat.SetTriangleMesh(path, _flat(size * vertices), faces.T, color)
    meshcat.SetTransform(path, _facing(view, centre))


def put_legend(
    meshcat: Meshcat,
    path: str,
    full: float,
    centre: np.ndarray,
    view: View,
    *,
    width: float,
    color: Rgba,
) -> None:
    """Draws the legend of the receptors' colours; `full` N has the strongest.

    Args:
        meshcat: where.
        path: in Meshcat.
        full: N.
        centre: `(3,)` m, the middle of the bar.
        view: the camera.
        width: m, of the bar.
        color: of the letters.
    """
    share = np.linspace(0.0, 1.0, 33)
    x = width * (share - 0.5)
    height = 0.06 * width
    points = np.stack([np.tile(x, 2), np.repeat([0.0, height], len(x))], axis=1)
    left, above = np.arange(len(x) - 1), len(x)
    lower = np.stack([left, left + 1, left + 1 + above], axis=1)
    upper = np.stack([left, left + 1 + above, left + above], axis=1)
    faces = np.concatenate([lower, upper])
    colors = np.tile(PRESSURE(share)[:, :3], (2, 1))
    meshcat.SetTriangleColorMesh(f"{path}/bar", _flat(points), faces.T, colors.T)
    meshcat.SetTransform(f"{path}/bar", _facing(view, centre))
    size = 1.3 * height
    for place, text in ((-0.5, "0"), (0.0, "N per receptor"), (0.5, f"{full:.1f}")):
        where = centre + place * width * view.axes[0] - 0.9 * height * view.axes[1]
        name = f"{path}/{text.replace(' ', '_')}"
        put_text(meshcat, name, text, where, view, size=size, color=color)


def letters(text: str) -> tuple[np.ndarray, np.ndarray]:
    """Lines of text, centred at the origin, at a font size of one.

    Returns:
        `(V, 2)` vertices and `(F, 3)` indices of triangles.
    """
    outlines = []
    for number, line in enumerate(text.split("\n")):
        if not line.strip():  # which TextPath cannot do
            continue
        glyphs = TextPath((0.0, 0.0), line, size=_FONT_SIZE)
        contours = [np.asarray(polygon)[:-1] for polygon in glyphs.to_polygons()]
        x = np.concatenate(contours)[:, 0]
        middle = (x.min() + x.max()) / 2
        down = (0.35 + _LINE_SPACING * number) * _FONT_SIZE
        outlines += [contour - [middle, down] for contour in contours]
    # The font alone knows which contours are holes.
    rings = manifold3d.CrossSection(outlines, manifold3d.FillRule.EvenOdd).to_polygons()
    if not rings:
        return np.zeros((0, 2)), np.zeros((0, 3), dtype=int)
    return np.concatenate(rings) / _FONT_SIZE, np.asarray(manifold3d.triangulate(rings))


def _flat(points: np.ndarray) -> np.ndarray:
    """`(3, V)` the points `(V, 2)` in the plane z = 0."""
    return np.vstack([points.T, np.zeros(len(points))])


def _facing(view: View, centre: np.ndarray) -> RigidTransform:
    return RigidTransform(RotationMatrix(view.axes.T), centre)
