"""Mesh files in formats that Drake refuses, as OBJ files in a cache."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

from selftouch_drake.experiment import ExperimentError
from selftouch_drake.files import written_whole
from selftouch_drake.lazy import trimesh

# What Drake 1.51 and 1.58 take as collision geometry, and draw.
DRAKE_SUFFIXES = frozenset({".obj", ".vtk", ".gltf"})


def cache_folder() -> Path:
    """Where converted files are kept: in `$XDG_CACHE_HOME`, or `~/.cache`."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "selftouch_drake"


def as_obj(path: Path) -> tuple[Path, bool]:
    """Converts a mesh file to OBJ, in metres, once.

    The same content gives the same file; one that is there is used again.

    Returns:
        The OBJ file in the cache, and whether it was made just now.

    Raises:
        ExperimentError: the file is missing, or holds no triangles that can be read.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ExperimentError(
            f"mesh {path} cannot be read ({error.strerror}); give the path of a mesh file"
        ) from None
    digest = hashlib.sha256(path.suffix.lower().encode() + content).hexdigest()
    converted = cache_folder() / "meshes" / digest / f"{path.stem}.obj"
    if converted.is_file():
        return converted, False
    text = trimesh.exchange.obj.export_obj(
        _read(path), include_normals=False, include_color=False, include_texture=False
    )
    converted.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(converted) as aside:
        aside.write_text(text, encoding="utf-8")
    return converted, True


def _read(path: Path) -> trimesh.Trimesh:
    try:
        scale = _metres_per_unit(path)
        # Scenes of several pieces become one mesh, each piece in its place.
        scene: Any = trimesh.load(path, force="scene")
        mesh = trimesh.util.concatenate(scene.dump())
    except ExperimentError:
        raise
    except Exception as error:  # Each of trimesh's readers fails in its own way.
        reason = " ".join(str(error).split())[:200].rstrip(".") or type(error).__name__
        raise ExperimentError(f"mesh {path} cannot be read ({reason}); export it as OBJ") from error
    if not isinstance(mesh, trimesh.Trimesh) or mesh.is_empty:
        raise ExperimentError(f"mesh {path} has no triangles; export it as OBJ")
    return mesh.apply_scale(scale)


def _metres_per_unit(path: Path) -> float:
    """COLLADA states its unit, which trimesh does not apply; other formats are in metres."""
    if path.suffix.lower() != ".dae":
        return 1.0
    try:
        import collada
    except ImportError:
        raise ExperimentError(
            f"mesh {path} is a COLLADA file, which needs pycollada: "
            "pip install 'selftouch-drake[collada]'"
        ) from None
    return collada.Collada(str(path), ignore=[collada.common.DaeError]).assetInfo.unitmeter or 1.0
