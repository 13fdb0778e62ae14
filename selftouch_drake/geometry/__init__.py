"""Skins of links: closed surfaces, the wall below them, and receptors spread over them."""

from selftouch_drake.geometry.closing import SimplifiedWarning, closed_surface
from selftouch_drake.geometry.farthest import farthest_points
from selftouch_drake.geometry.geodesics import surface_distances, surface_paths
from selftouch_drake.geometry.hollow import (
    HollowSkin,
    hollow_skin,
    tet_volumes,
    vtk_text,
)
from selftouch_drake.geometry.patches import betti_of_patch, touched_patch
from selftouch_drake.geometry.receptors import (
    ReceptiveFields,
    group_centres,
    place_receptors,
    placed_fields,
    receptive_fields,
)
from selftouch_drake.geometry.surfaces import (
    capsule,
    cube,
    cylinder,
    ellipsoid,
    mesh_file,
    sphere,
    torus,
)

__all__ = [
    "HollowSkin",
    "ReceptiveFields",
    "SimplifiedWarning",
    "betti_of_patch",
    "capsule",
    "closed_surface",
    "cube",
    "cylinder",
    "ellipsoid",
    "farthest_points",
    "group_centres",
    "hollow_skin",
    "mesh_file",
    "place_receptors",
    "placed_fields",
    "receptive_fields",
    "sphere",
    "surface_distances",
    "surface_paths",
    "tet_volumes",
    "torus",
    "touched_patch",
    "vtk_text",
]
