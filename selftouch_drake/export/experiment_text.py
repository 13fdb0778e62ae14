"""An exported robot as an experiment of ours: what was learned is a body to learn again."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml

#: Of the experiment: the folder of its own file.
_HOME = "home"
# A skin is as thick as in other experiments; on a small part, a share of its least extent.
_THICKNESS, _THICKNESS_SHARE = 0.03, 0.08
# Edge of its triangles, as a share of the largest extent, and within what experiments allow.
_RESOLUTION_SHARE, _FINEST, _COARSEST = 0.07, 0.002, 0.03


# m, as in other experiments: the size of a toucher whose centre sinks into the skin is not known.
_RADIUS = 0.01


def toucher_radius(depth: float) -> float:
    """m, of a toucher whose centre passes so deep under the surface; negative if outside."""
    return -depth if depth < 0 else _RADIUS


def directives_text(name: str, file: str) -> str:
    """Drake model directives that add the robot.

    Args:
        name: of the robot.
        file: its name, in the folder of the directives.
    """
    model = {"name": name, "file": f"package://{_HOME}/{file}"}
    return yaml.safe_dump({"directives": [{"add_model": model}]}, sort_keys=False)


def experiment_text(
    directives: str,
    receptors: str,
    worn: Mapping[str, tuple[str, np.ndarray]],
    touchers: Mapping[str, float],
) -> str:
    """The experiment.

    Skins are soft here, while files of robots hold them as rigid: so rigid parts may overlap by as
    much as a skin is thick.

    Args:
        directives: name of the file of directives, in the experiment's folder.
        receptors: name of the table of receptors there.
        worn: of links `part_K`, the file of the surface and its `(3,)` extents, m.
        touchers: radius of each, m, by its frame.
    """
    skins: dict[str, Any] = {}
    for link, (mesh, extents) in worn.items():
        resolution = np.clip(_RESOLUTION_SHARE * extents.max(), _FINEST, _COARSEST)
        skins[link] = {
            "link": link,
            "surface": {"mesh": mesh, "resolution": round(float(resolution), 4)},
            "thickness": round(min(_THICKNESS, float(_THICKNESS_SHARE * extents.min())), 4),
            "receptors": {"file": receptors, "part": int(link.removeprefix("part_"))},
        }
    fields = {
        "robot": {
            "directives": directives,
            "packages": {_HOME: "."},
            "collision_depth": max(skin["thickness"] for skin in skins.values()),
        },
        "skins": skins,
        "touching": {name: {"frame": name, "radius": radius} for name, radius in touchers.items()},
    }
    return yaml.safe_dump(fields, sort_keys=False)
