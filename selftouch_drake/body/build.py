"""From an experiment to the skin of its agent."""

from __future__ import annotations

import trimesh

from selftouch_drake.body import surfaces
from selftouch_drake.body.hollow import HollowSkin, hollow_skin
from selftouch_drake.body.receptors import ReceptiveFields, place_receptors, receptive_fields
from selftouch_drake.experiment import Body, Experiment

# m, of the fingertips in models/.
FINGERTIP_RADIUS = 0.01


def build_body(experiment: Experiment) -> tuple[HollowSkin, ReceptiveFields]:
    """The hollow skin of an experiment and its receptive fields.

    Raises:
        ValueError: the body cannot be made; the text names the field, the value and the remedy.
    """
    surface = outer_surface(experiment.body)
    skin = hollow_skin(surface, experiment.skin.thickness, FINGERTIP_RADIUS)
    p_BS = place_receptors(surface, experiment.skin.num_receptors, experiment.seed)
    return skin, receptive_fields(surface, p_BS)


def outer_surface(body: Body) -> trimesh.Trimesh:
    """The closed outer surface that `body` describes."""
    make = {
        "sphere": lambda resolution: surfaces.sphere(body.radius, resolution=resolution),
        "cube": lambda resolution: surfaces.cube(body.side, resolution=resolution),
        "torus": lambda resolution: surfaces.torus(
            body.major_radius, body.minor_radius, resolution=resolution
        ),
        "ellipsoid": lambda resolution: surfaces.ellipsoid(
            tuple(body.semi_axes), resolution=resolution
        ),
        "cylinder": lambda resolution: surfaces.cylinder(
            body.radius, body.height, resolution=resolution
        ),
        "mesh": lambda resolution: surfaces.mesh_file(body.mesh, resolution=resolution),
    }
    return make[body.shape](body.resolution)
