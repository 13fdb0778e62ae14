"""Flat pictures in Meshcat: words and a legend, which it cannot draw by itself."""

from __future__ import annotations

import base64
import io
import json

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh, Meshcat
from pydrake.math import RigidTransform, RotationMatrix

from selftouch_drake.show.scene import View
from selftouch_drake.show.style import INK, PRESSURE, styled

# Pixels an inch: about those of the screen, as finer ones look thin.
_DPI = 100


@styled
def words(text: str, *, bold: bool = False) -> Figure:
    """One or two lines of text, centred."""
    figure = Figure(figsize=(8.0, 0.7), facecolor="none")
    weight = "bold" if bold else "normal"
    figure.text(0.5, 0.5, text, ha="center", va="center", fontsize=16, weight=weight)
    return figure


@styled
def pressure_legend(full: float) -> Figure:
    """What the colours of receptors mean; `full` N is the strongest."""
    figure = Figure(figsize=(4.0, 0.7), facecolor="none")
    bar = figure.add_axes((0.05, 0.72, 0.9, 0.22))
    mappable = ScalarMappable(Normalize(0.0, full), PRESSURE)
    colorbar = figure.colorbar(mappable, cax=bar, orientation="horizontal")
    colorbar.ax.tick_params(labelsize=13, colors=INK)
    colorbar.set_label("N a receptor", fontsize=13, labelpad=0)
    return figure


def put_card(
    meshcat: Meshcat, path: str, figure: Figure, centre: np.ndarray, view: View, *, width: float
) -> None:
    """Hangs a figure in the scene, so that it faces the camera of `view`.

    Args:
        meshcat: where.
        path: of the card in Meshcat; what hung there is replaced.
        figure: what is on it; its background is transparent if its face colour is none.
        centre: `(3,)` m.
        view: the camera.
        width: m.
    """
    image = io.BytesIO()
    figure.savefig(image, format="png", dpi=_DPI, metadata={"Software": None})
    height = width * figure.get_figheight() / figure.get_figwidth()
    card = MemoryFile(_gltf(image.getvalue(), width, height), ".gltf", path)
    meshcat.SetObject(path, Mesh(InMemoryMesh(mesh_file=card)))
    right, up, towards = view.axes
    # Drake takes the y of glTF for up, so that the card's front looks along -y.
    R_WC = RotationMatrix(np.stack([right, -towards, up], axis=1))
    meshcat.SetTransform(path, RigidTransform(R_WC, centre))


def _gltf(png: bytes, width: float, height: float) -> str:
    """A glTF file, without light on it, of a rectangle that shows a picture."""
    x, y = width / 2, height / 2
    corners = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]], dtype="<f4")
    in_picture = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype="<f4")
    triangles = np.array([0, 1, 2, 0, 2, 3], dtype="<u2")
    parts = [array.tobytes() for array in (corners, in_picture, triangles)]
    starts = np.cumsum([0, *map(len, parts)]).tolist()
    material = {
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0},
        "alphaMode": "BLEND",
        "doubleSided": True,
        "extensions": {"KHR_materials_unlit": {}},
    }
    primitive = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "extensionsUsed": ["KHR_materials_unlit"],
            "meshes": [{"primitives": [primitive]}],
            "materials": [material],
            "textures": [{"source": 0}],
            "images": [{"uri": _data_uri("image/png", png)}],
            "buffers": [
                {
                    "byteLength": starts[-1],
                    "uri": _data_uri("application/octet-stream", b"".join(parts)),
                }
            ],
            "bufferViews": [
                {"buffer": 0, "byteOffset": start, "byteLength": len(part)}
                for start, part in zip(starts, parts, strict=False)
            ],
            "accessors": [
                {
                    "bufferView": 0,
                    "componentType": 5126,  # float
                    "count": 4,
                    "type": "VEC3",
                    "min": corners.min(axis=0).tolist(),
                    "max": corners.max(axis=0).tolist(),
                },
                {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
                {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},  # uint16
            ],
        }
    )


def _data_uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
