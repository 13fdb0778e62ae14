"""From an experiment to the skins of its robot, each in the frame of its link."""

import dataclasses
import operator
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.geometry import Role, SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from scipy.sparse import csr_matrix
from scipy.spatial import QhullError, cKDTree

from selftouch_drake.experiment import Experiment, ExperimentError, Skin
from selftouch_drake.experiment.receptor_files import ReceptorTable
from selftouch_drake.experiment.schema import SHAPES
from selftouch_drake.geometry import surfaces
from selftouch_drake.geometry.closing import RepairedWarning, SimplifiedWarning, closed_surface
from selftouch_drake.geometry.hollow import HollowSkin, hollow_skin
from selftouch_drake.geometry.receptors import (
    ReceptiveFields,
    group_centres,
    place_receptors,
    placed_fields,
    receptive_fields,
)
from selftouch_drake.lazy import trimesh
from selftouch_drake.randomness import random_stream
from selftouch_drake.robot.changes import skin_motion
from selftouch_drake.robot.links import find_link, link_geometries, pieces_in_link
from selftouch_drake.robot.models import load_model, parse

# m; the user is not told of receptors that were moved onto a surface by less.
_MOVED = 1e-4
# Receptors are in another unit if they are so many times farther from a surface than it is long.
_MILLIMETRES = 10
# A normal points inwards if the cosine of its angle to the surface's normal is below minus the
# first, and the side that it faces is far: the receptor's distance from the surface is at most the
# second share of that. The user is told if more than the third share of all normals do.
_INWARD, _NEARER, _SOME_INWARD = 0.3, 0.25, 0.05
# Depth of a pad of receptors below them, in resolutions or thicknesses.
_PAD = 4
# The surfaces that are the link's own.
_ROLES = {"collision": Role.kProximity, "visual": Role.kIllustration}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkinModel:
    """A skin in the frame L of the link that wears it, m.

    Attributes:
        name: as the experiment calls it.
        link: the name of the link.
        wall: the hollow skin.
        fields: receptive fields of its receptors.
        hydroelastic_modulus: Pa.
        is_own_geometry: whether it lies on the geometry that the model gives its link, or has the
            shape of its receptors, so that nothing gets inside.
    """

    name: str
    link: str
    wall: HollowSkin
    fields: ReceptiveFields
    hydroelastic_modulus: float
    is_own_geometry: bool

    def to_arrays(self) -> dict[str, np.ndarray]:
        """All but the texts, by the names of `ARRAYS`."""
        return {name: np.asarray(operator.attrgetter(name)(self)) for name in ARRAYS}

    @staticmethod
    def from_arrays(name: str, link: str, arrays: Mapping[str, np.ndarray]) -> "SkinModel":
        """The skin of `to_arrays`."""
        wall: dict[str, Any] = {key: arrays[f"wall.{key}"] for key in _WALL}
        fields: dict[str, Any] = {key: arrays[f"fields.{key}"] for key in _FIELDS}
        shape = len(fields["vertices"]), len(fields["p_LS"])
        weights = csr_matrix(tuple(arrays[key] for key in _WEIGHTS), shape)
        wall["thickness"], fields["radius"] = float(wall["thickness"]), float(fields["radius"])
        return SkinModel(
            name=name,
            link=link,
            wall=HollowSkin(**wall),
            fields=ReceptiveFields(**fields, vertex_weights=weights),
            hydroelastic_modulus=float(arrays["hydroelastic_modulus"]),
            is_own_geometry=bool(arrays["is_own_geometry"]),
        )


_WALL = [field.name for field in dataclasses.fields(HollowSkin)]
_FIELDS = [f.name for f in dataclasses.fields(ReceptiveFields) if f.name != "vertex_weights"]
_WEIGHTS = [f"fields.vertex_weights.{name}" for name in ("data", "indices", "indptr")]
#: Names of the arrays of `SkinModel.to_arrays`.
ARRAYS = (
    *(f"wall.{name}" for name in _WALL),
    *(f"fields.{name}" for name in _FIELDS),
    *_WEIGHTS,
    "hydroelastic_modulus",
    "is_own_geometry",
)


def make_skins(experiment: Experiment) -> "tuple[SkinModel, ...]":
    """The skins of an experiment, in its order.

    Raises:
        ValueError: a skin cannot be made; the text names the field, the value and the remedy.
    """
    scene_graph = SceneGraph()
    plant = MultibodyPlant(time_step=0.0)
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    parse(plant, load_model(experiment.robot.directives, experiment.robot.packages))

    try:
        return tuple(
            make_skin(
                name,
                skin,
                plant,
                scene_graph,
                seed=receptor_seed(experiment.seed, number),
                motion=skin_motion(plant, experiment, name),
            )
            for number, (name, skin) in enumerate(experiment.skins.items())
        )
    except _OffSurfaceError as error:
        plant.Finalize()
        elsewhere = _elsewhere(error, plant, scene_graph, experiment.skins)
        raise ExperimentError(f"{error}{elsewhere}") from None


def make_skin(
    name: str,
    skin: Skin,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    *,
    seed: int,
    motion: tuple[np.ndarray, np.ndarray] | None = None,
) -> "SkinModel":
    """One skin of a link of `plant`, which may be finalized or not.

    The seed chooses the receptors' places. The motion since the skin was made is of `skin_motion`.

    Raises:
        ExperimentError: the skin cannot be made; the text names the field, the value and the
            remedy.
    """
    link = find_link(plant, skin.link, f"skins.{name}.link")
    try:
        surface = _outer_surface(name, skin, link, plant, scene_graph)
        given = None if skin.receptors is None else skin.receptors.read()
        if given is None:
            p_LS = place_receptors(surface, skin.num_receptors, seed, unevenness=skin.unevenness)
        else:
            p_LS = given.p_LS
        if motion is not None:
            A, b = motion
            p_LS = p_LS @ A.T + b
            surface = trimesh.Trimesh(surface.vertices @ A.T + b, surface.faces, process=False)
        wall = hollow_skin(surface, skin.thickness)
        if given is None:
            fields = receptive_fields(surface, p_LS, width=skin.field_width)
        else:
            fields = _fields_of_file(name, skin, surface, given, p_LS)
    except ExperimentError:
        raise
    except ValueError as error:
        # Geometry names its own arguments, and knows no experiment.
        raise ExperimentError(f"skins.{name}.{error}") from error
    return SkinModel(
        name=name,
        link=skin.link,
        wall=wall,
        fields=fields,
        hydroelastic_modulus=skin.hydroelastic_modulus,
        is_own_geometry=skin.surface.shape in (*_ROLES, "receptors"),
    )


class MovedReceptorsWarning(UserWarning):
    """Receptors of a file were not on the surface, and were moved onto it."""


class InwardNormalsWarning(UserWarning):
    """Normals of receptors in a file point into the link."""


class _OffSurfaceError(ExperimentError):
    """Receptors of a file are too far from the surface of their skin."""

    def __init__(self, line: str, skin: str, p_LS: np.ndarray, moved: np.ndarray) -> None:
        super().__init__(line)
        self.skin, self.p_LS, self.moved = skin, p_LS, moved


def _fields_of_file(
    name: str, skin: Skin, surface: trimesh.Trimesh, given: ReceptorTable, p_LS: np.ndarray
) -> ReceptiveFields:
    """The fields of receptors at `(S, 3)` m, which stand in a file and may have moved since."""
    assert skin.receptors is not None
    field, number = f"skins.{name}.receptors", len(p_LS)
    centre = skin.reading.mode == "centre"
    if (num_readings := given.num_readings(centre)) != skin.num_receptors:
        raise ExperimentError(
            f"skins.{name}.num_receptors is {skin.num_receptors}; {skin.receptors.file} has "
            f"{num_readings}: leave num_receptors out"
        )
    normal = _outward_normals(field, surface, given, p_LS)
    fields, moved = placed_fields(
        surface, p_LS, normal=normal, radius=given.width, width=skin.field_width
    )
    reach = fields.radius if given.width is None else skin.field_width * given.width
    if len(off := np.flatnonzero(moved > reach)):
        line = (
            f"{field} {skin.receptors.file} has {len(off)} of {number} receptors off the surface "
            f"by more than their fields reach, {1e3 * fields.radius:.1f} mm: {given.those(off)}, "
            f"by up to {1e3 * moved.max():.3g} mm; correct them, or the surface"
        )
        if np.median(moved) > _MILLIMETRES * np.ptp(surface.vertices, axis=0).max():
            line += f". Are these millimetres? Then give {field}.scale: 0.001"
        raise _OffSurfaceError(line, name, p_LS[off], moved[off])
    if moved.max() > _MOVED:
        farthest = given.those([int(moved.argmax())])
        warnings.warn(
            f"{field}: {number} receptors were moved onto the surface, by {1e3 * moved.mean():.1f} "
            f"mm on average and at most {1e3 * moved.max():.1f} mm ({farthest})",
            MovedReceptorsWarning,
            stacklevel=2,
        )
    return group_centres(fields, given.group) if centre and given.group is not None else fields


def _outward_normals(
    field: str, surface: trimesh.Trimesh, given: ReceptorTable, p_LS: np.ndarray
) -> np.ndarray | None:
    """`(S, 3)` the normals of a file, turned round if most of them point into the link.

    Warns:
        InwardNormalsWarning: they were turned, or some point inwards and others do not.
    """
    if given.normal is None:
        return None
    vertices, facing = np.array(surface.vertices), np.array(surface.vertex_normals)
    near, nearest = cKDTree(vertices).query(p_LS)
    # On a thin link, the side that a receptor faces is about as near as the other.
    far = np.ptp(vertices, axis=0).max()
    _, along = cKDTree(np.hstack([vertices, far * facing])).query(
        np.hstack([p_LS, far * given.normal])
    )
    inward = np.einsum("si,si->s", given.normal, facing[nearest]) < -_INWARD
    inward &= near < _NEARER * np.linalg.norm(vertices[along] - p_LS, axis=1)
    if inward.mean() > 0.5:
        text = f"{field}: the normals point into the link, and were turned outwards"
        warnings.warn(text, InwardNormalsWarning, stacklevel=2)
        return -given.normal
    if inward.mean() > _SOME_INWARD:
        warnings.warn(
            f"{field}: {inward.sum()} of {len(inward)} normals point into the link, unlike the "
            f"others ({given.those(np.flatnonzero(inward))}): their receptors may have been moved "
            "to the opposite side; turn them outwards in the file",
            InwardNormalsWarning,
            stacklevel=2,
        )
    return given.normal


def _elsewhere(
    error: _OffSurfaceError, plant: MultibodyPlant, scene_graph: SceneGraph, skins: Mapping
) -> str:
    """Says which other skin is nearer to receptors that are off theirs, if there is one.

    The plant is finalized.
    """
    context = plant.CreateDefaultContext()
    links = {name: find_link(plant, skins[name].link, f"skins.{name}.link") for name in skins}
    X_WL = links.pop(error.skin).EvalPoseInWorld(context)
    for name, link in links.items():
        tree = cKDTree(_outer_surface(name, skins[name], link, plant, scene_graph).vertices)
        X_LL = link.EvalPoseInWorld(context).InvertAndCompose(X_WL)
        # In the frame of the other link, if the file is that link's.
        for p_LS in (X_LL.multiply(error.p_LS.T).T, error.p_LS):
            if (near := tree.query(p_LS)[0] < error.moved).any():
                return f". {near.sum()} of them are nearer to skins.{name}: give them to that skin"
    return ""


def receptor_seed(seed: int, number: int) -> int:
    """The seed of the receptors' places on skin `number`; the first skin's is the experiment's."""
    if number == 0:
        return seed
    stream = random_stream(seed, "skin", 2, number)
    return int(stream.generate_state(1)[0])


def _outer_surface(
    name: str, skin: Skin, link: RigidBody, plant: MultibodyPlant, scene_graph: SceneGraph
) -> trimesh.Trimesh:
    """The closed outer surface that is described, in the frame of `link`."""
    wanted = skin.surface
    if wanted.shape in _ROLES or wanted.shape == "receptors":
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", SimplifiedWarning)
            warnings.simplefilter("always", RepairedWarning)
            surface = closed_surface(
                _pieces(skin, link, plant, scene_graph),
                resolution=wanted.resolution,
                thickness=skin.thickness,
                # The hull of receptors has edges that the robot has not.
                sharp=wanted.shape != "receptors",
            )
        for warning in said:
            warnings.warn(f"skins.{name}.{warning.message}", warning.category, stacklevel=2)
    elif wanted.shape == "mesh":
        surface = surfaces.mesh_file(
            str(wanted.mesh), resolution=wanted.resolution, scale=wanted.scale
        )
    else:
        dimensions = [getattr(wanted, name) for name in SHAPES[wanted.shape]]
        surface = getattr(surfaces, wanted.shape)(*dimensions, resolution=wanted.resolution)
    if any(wanted.translation) or any(wanted.rpy_deg):
        X_LA = RigidTransform(RollPitchYaw(np.radians(wanted.rpy_deg)), wanted.translation)
        surface = trimesh.Trimesh(X_LA.multiply(surface.vertices.T).T, surface.faces, process=False)
    return surface


def _pieces(
    skin: Skin, link: RigidBody, plant: MultibodyPlant, scene_graph: SceneGraph
) -> list[trimesh.Trimesh]:
    """What a closed surface is made around, in the frame of `link`."""
    if skin.receptors is not None and skin.surface.shape == "receptors":
        try:
            p_LS = skin.receptors.read().p_LS
            # Receptors on one side only leave a thin edge, which would be rounded away.
            outward = trimesh.convex.convex_hull(p_LS).vertex_normals.mean(axis=0)
            depth = _PAD * max(skin.surface.resolution, skin.thickness)
            return [trimesh.convex.convex_hull(np.concatenate([p_LS, p_LS - depth * outward]))]
        except QhullError:
            raise ValueError(
                "surface is 'receptors', but these lie in a plane; give another shape"
            ) from None
    inspector, wanted = scene_graph.model_inspector(), skin.surface.shape
    geometries = link_geometries(plant, inspector, link, _ROLES[wanted])
    if not geometries:
        (other,) = _ROLES.keys() - {wanted}
        has_other = bool(link_geometries(plant, inspector, link, _ROLES[other]))
        remedy = f"take {other!r}" if has_other else "add some in its model"
        raise ValueError(
            f"surface is {wanted!r}, but link {link.name()!r} has no such geometry; {remedy}, or "
            "give a shape or a mesh"
        )
    return pieces_in_link(inspector, geometries)
