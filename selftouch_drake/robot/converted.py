"""Copies of models, and meshes converted for Drake, in a cache of the user."""

import hashlib
import os
from pathlib import Path
from typing import Any

from selftouch_drake.experiment import ExperimentError
from selftouch_drake.files import write_text_whole
from selftouch_drake.lazy import trimesh


def cached_copy(name: str, text: str) -> Path:
    """Keeps a rewritten file in the cache; the same text is the same file."""
    path = cache_folder() / "models" / hashlib.sha256(text.encode()).hexdigest() / name
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text_whole(path, text)
    return path


def cache_folder() -> Path:
    """Where converted files are kept: in `$XDG_CACHE_HOME`, or `~/.cache`."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "selftouch_drake"


def as_obj(path: Path) -> tuple[Path, bool]:
    """The OBJ file of a mesh in the cache, in metres, and whether it was made just now.

    The same content gives the same file; one that is there is used again.
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
        _read_mesh(path), include_normals=False, include_color=False, include_texture=False
    )
    converted.parent.mkdir(parents=True, exist_ok=True)
    write_text_whole(converted, text)
    return converted, True


def _read_mesh(path: Path) -> trimesh.Trimesh:
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
