"""The body: a closed surface, the hollow skin inside it, and the receptors spread over it."""

from selftouch_drake.geometry.farthest import farthest_points
from selftouch_drake.geometry.wall import wall_points
def closed_surface(*a, **k): raise ValueError('not yet')
from selftouch_drake.geometry.hollow import (
    HollowSkin,
    hollow_skin,
    tet_volumes,
    vtk_text,
    write_vtk,
)
from selftouch_drake.geometry.receptors import ReceptiveFields, place_receptors, receptive_fields
from selftouch_drake.geometry.surfaces import cube, cylinder, ellipsoid, mesh_file, sphere, torus

__all__ = [
    "ARM_REACH",
    "FINGERTIP_RADIUS",
    "P_B_SHOULDER",
    "HollowSkin",
    "ReceptiveFields",
    "build_body",
    "cube",
    "cylinder",
    "ellipsoid",
    "hollow_skin",
    "mesh_file",
    "place_receptors",
    "receptive_fields",
    "sphere",
    "tet_volumes",
    "torus",
    "vtk_text",
    "write_vtk",
]
