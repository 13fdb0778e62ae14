"""Text in Meshcat, which has none: letters as flat meshes.

Meshes and not pictures: a page requests a picture only after it has heard of it, and a slow page
requests pictures that are gone by then.
"""

from __future__ import annotations

import manifold3d
import numpy as np
from matplotlib.textpath import TextPath
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform, RotationMatrix

from selftouch_drake.show.meshcat.skin_drawing import rgba
from selftouch_drake.show.style import INK
from selftouch_drake.show.view import VIEW

# Size at which outlines are taken from the font: fine enough that bends look round.
_FONT_SIZE = 60.0
_LINE_SPACING = 1.5


def put_text(meshcat: Meshcat, path: str, text: str, centre: np.ndarray, size: float) -> None:
    """Writes lines that face the camera, the first round `centre` `(3,)` m, in a font of `size` m.

    What was written at the path before is replaced.
    """
    vertices, faces = letters(text)
    flat = np.vstack([size * vertices.T, np.zeros(len(vertices))])
    meshcat.SetTriangleMesh(path, flat, faces.T, rgba(INK))
    meshcat.SetTransform(path, RigidTransform(RotationMatrix(VIEW.axes.T), centre))


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
