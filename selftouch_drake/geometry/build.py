"""From an experiment to the skin of its agent."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh

from selftouch_drake.experiment import SHAPES, Body, Experiment
from selftouch_drake.geometry import surfaces
from selftouch_drake.geometry.hollow import HollowSkin, hollow_skin
from selftouch_drake.geometry.receptors import ReceptiveFields, place_receptors, receptive_fields

# m, of the arms and fingers in models/: radius of a fingertip, the shoulder's place on the body,
# and the length of the arm from there to a fingertip.
FINGERTIP_RADIUS = 0.01
P_B_SHOULDER = (0.0, 0.0, 0.40)
ARM_REACH = 0.92


def build_body(experiment: Experiment) -> tuple[HollowSkin, ReceptiveFields]:
    """The hollow skin of an experiment and its receptive fields.

    Raises:
        ValueError: the body cannot be made; the text names the field, the value and the remedy.
    """
    surface = outer_surface(experiment.body)
    _require_reach(surface, experiment.body)
    skin = hollow_skin(surface, experiment.skin.thickness, FINGERTIP_RADIUS)
    layout = experiment.skin
    p_BS = place_receptors(
        surface, layout.num_receptors, experiment.seed, unevenness=layout.unevenness
    )
    return skin, receptive_fields(surface, p_BS, width=layout.field_width)


def outer_surface(body: Body) -> trimesh.Trimesh:
    """The closed outer surface that `body` describes."""
    make: dict[str, Callable[..., trimesh.Trimesh]] = {
        "sphere": surfaces.sphere,
        "cube": surfaces.cube,
        "torus": surfaces.torus,
        "ellipsoid": surfaces.ellipsoid,
        "cylinder": surfaces.cylinder,
        "mesh": surfaces.mesh_file,
    }
    dimensions = [getattr(body, name) for name in SHAPES[body.shape]]
    return make[body.shape](*dimensions, resolution=body.resolution)


def _require_reach(surface: trimesh.Trimesh, body: Body) -> None:
    farthest = np.linalg.norm(surface.vertices - P_B_SHOULDER, axis=1).max()
    if farthest > ARM_REACH:
        name = SHAPES[body.shape][0]
        raise ValueError(
            f"body.{name} is {getattr(body, name)!r}; the fingertip reaches {ARM_REACH} m from the "
            f"shoulder, but the skin is up to {farthest:.2f} m away; make the body smaller"
        )
