"""An exported robot as an experiment of ours: what was learned is a body to learn again."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from selftouch_drake.geometry.closing import SimplifiedWarning
from selftouch_drake.geometry.hollow import hollow_skin
from selftouch_drake.geometry.receptors import usual_radius
from selftouch_drake.geometry.surfaces import mesh_file

#: Of the experiment: the folder of its own file.
_HOME = "home"
# A skin is as thick as in other experiments; on a small part, a share of its least extent.
_THICKNESS, _THICKNESS_SHARE = 0.03, 0.08
# Edge of its triangles, as a share of the largest extent, and within what experiments allow.
_RESOLUTION_SHARE, _FINEST, _COARSEST = 0.07, 0.002, 0.03


# Shares of the thickness that are tried until a skin fits.
_THINNER = 1.0, 0.7, 0.5, 0.3
# What experiments allow for the width of fields.
_WIDTHS = 0.2, 3.0
# m, as in other experiments: the size of a toucher whose centre sinks into the skin is not known.
_RADIUS = 0.01


def toucher_radius(depth: float) -> float:
    """m, of a toucher whose centre passes so deep under the surface; negative if outside."""
    return -depth if depth < 0 else _RADIUS


def resolution(extents: np.ndarray) -> float:
    """m, edge of the triangles of a skin with `(3,)` extents."""
    return round(float(np.clip(_RESOLUTION_SHARE * extents.max(), _FINEST, _COARSEST)), 4)


def fitting_thickness(file: Path, extents: np.ndarray) -> float:
    """m, thickness of a skin that fits under the surface in a file; NaN if none does.

    Args:
        file: of a closed mesh.
        extents: `(3,)` m, of it.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SimplifiedWarning)  # the experiment says it again
            surface = mesh_file(file, resolution=resolution(extents))
    except ValueError:  # it crosses itself
        return np.nan
    for share in _THINNER:
        most = share * min(_THICKNESS, float(_THICKNESS_SHARE * extents.min()))
        try:
            return hollow_skin(surface, round(most, 4)).thickness
        except ValueError:
            continue
    return np.nan


def directives_text(name: str, file: str) -> str:
    """Drake model directives that add the robot.

    Args:
        name: of the robot.
        file: its name, in the folder of the directives.
    """
    model = {"name": name, "file": f"package://{_HOME}/{file}"}
    return yaml.safe_dump({"directives": [{"add_model": model}]}, sort_keys=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Worn:
    """A skin.

    Attributes:
        mesh: the file of its surface, in the experiment's folder.
        extents: `(3,)` m, of the surface.
        thickness: m, so much as fits under it.
        receptors: `(S, 3)` m, its receptors that were met.
        reach: m, how far a typical one feels; NaN if nobody knows.
    """

    mesh: str
    extents: np.ndarray
    thickness: float
    receptors: np.ndarray
    reach: float


def experiment_text(
    directives: str,
    receptors: str,
    worn: Mapping[str, Worn],
    touchers: Mapping[str, float],
) -> str:
    """The experiment.

    Skins are soft here, while files of robots hold them as rigid: so rigid parts may overlap by as
    much as a skin is thick.

    Args:
        directives: name of the file of directives, in the experiment's folder.
        receptors: name of the table of receptors there.
        worn: skins of links `part_K`.
        touchers: radius of each, m, by its frame.
    """
    skins: dict[str, Any] = {}
    for link, skin in worn.items():
        skins[link] = {
            "link": link,
            "surface": {"mesh": skin.mesh, "resolution": resolution(skin.extents)},
            "thickness": skin.thickness,
            "receptors": {"file": receptors, "part": int(link.removeprefix("part_"))},
        }
        if np.isfinite(skin.reach):
            width = skin.reach / usual_radius(skin.receptors)
            skins[link]["field_width"] = round(float(np.clip(width, *_WIDTHS)), 3)
    fields = {
        "robot": {
            "directives": directives,
            "packages": {_HOME: "."},
            "collision_depth": max(each["thickness"] for each in skins.values()),
        },
        "skins": skins,
        "touching": {name: {"frame": name, "radius": radius} for name, radius in touchers.items()},
    }
    return yaml.safe_dump(fields, sort_keys=False)
