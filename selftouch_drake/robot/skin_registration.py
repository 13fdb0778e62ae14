"""Tactile skins for links of any plant."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    CollisionFilterDeclaration,
    GeometrySet,
    ProximityProperties,
    Rgba,
    Role,
    SceneGraph,
    SceneGraphConfig,
)
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import (
    LoadModelDirectivesFromString,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import MultibodyPlant

from selftouch_drake.experiment import ExperimentError, Skin, skins_from_fields
from selftouch_drake.experiment.loading import load_skins, yaml_sections
from selftouch_drake.experiment.schema import Imperfections, ReadingSettings
from selftouch_drake.geometry.hollow import vtk_text
from selftouch_drake.lazy import trimesh
from selftouch_drake.robot.facts import apply_facts
from selftouch_drake.robot.links import FRICTION, all_links, find_link, in_memory, link_geometries
from selftouch_drake.robot.models import one_line, rewritten
from selftouch_drake.robot.pairs import Neighbours, WornSkin
from selftouch_drake.robot.skins import SkinModel, make_skin, receptor_seed

# s/m, Hunt and Crossley's: enough that a finger does not bounce.
_DISSIPATION = 10.0
# Light grey and opaque, as a skin looks.
_COLOR = Rgba(0.78, 0.79, 0.82, 1.0)


def AddSkins(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    skins: str | Path | Mapping[str, Skin | Mapping[str, Any]],
    *,
    seed: int = 0,
    visible: bool = True,
) -> tuple[WornSkin, ...]:
    """Gives links of a plant soft skins, before the plant is finalized.

    A skin whose surface is `collision` or `visual` takes the place of its link's own collision
    geometry, which would else push away what presses the skin. Call it once per plant, with all
    skins.

    Args:
        plant: not yet finalized, registered with `scene_graph`.
        scene_graph: with the links' own geometry.
        skins: by name, as the `skins` of an experiment; or a YAML file that has such a mapping.
        seed: of the receptors' places.
        visible: whether Meshcat shows the skins' outer surfaces.

    Raises:
        ExperimentError: a skin cannot be made, or is not perfect; the text names the field, the
            value and the remedy.
    """
    wanted = load_skins(skins) if isinstance(skins, (str, Path)) else skins_from_fields(skins)
    for name, skin in wanted.items():
        if skin.imperfections != Imperfections():
            raise ExperimentError(
                f"skins.{name}.imperfections is given; leave it out, and connect a SkinReadout to "
                "the TactileSkin"
            )
    models = [
        make_skin(name, skin, plant, scene_graph, seed=receptor_seed(seed, number))
        for number, (name, skin) in enumerate(wanted.items())
    ]
    inspector = scene_graph.model_inspector()
    for model in models:
        if model.is_own_geometry:
            link = find_link(plant, model.link, f"skins.{model.name}.link")
            for geometry in link_geometries(plant, inspector, link, Role.kProximity):
                scene_graph.RemoveRole(plant.get_source_id(), geometry, Role.kProximity)
    return tuple(
        RegisterSkin(plant, model, visible=visible, reading=wanted[model.name].reading)
        for model in models
    )


def RegisterSkin(
    plant: MultibodyPlant,
    model: SkinModel,
    *,
    visible: bool = True,
    soft: bool = True,
    reading: ReadingSettings | None = None,
) -> WornSkin:
    """Gives the link of a skin its geometry, before the plant is finalized.

    Args:
        plant: registered with a scene graph.
        model: the skin, in the frame of its link.
        visible: whether Meshcat shows its outer surface.
        soft: whether Drake computes contact with it; without, a plant takes a tenth of the time to
            build.
        reading: what a `TactileSkin` reports of the forces on it; by default the forces.

    Raises:
        ExperimentError: the plant has no such link.
    """
    link = find_link(plant, model.link, f"skins.{model.name}.link")
    name, properties = f"skin_{model.name}", ProximityProperties()
    if soft:
        # Where one of Drake's defaults is missing, each context computes the pressure field again.
        defaults = SceneGraphConfig().default_proximity_properties
        AddContactMaterial(
            dissipation=_DISSIPATION,
            friction=FRICTION,
            point_stiffness=defaults.point_stiffness,
            properties=properties,
        )
        properties.AddProperty("material", "relaxation_time", defaults.relaxation_time)
        AddCompliantHydroelasticProperties(
            resolution_hint=model.wall.thickness,  # asked for, but a mesh has its own resolution
            hydroelastic_modulus=model.hydroelastic_modulus,
            properties=properties,
        )
    wall = in_memory(vtk_text(model.wall), ".vtk")
    geometry_id = plant.RegisterCollisionGeometry(link, RigidTransform(), wall, name, properties)
    if visible:
        # Drake's renderers, as a camera in a MuJoCo file brings along, want normals.
        surface = trimesh.Trimesh(model.wall.vertices, model.wall.faces, process=False)
        text = trimesh.exchange.obj.export_obj(surface, include_normals=True, digits=12)
        shape = in_memory(text, ".obj")
        plant.RegisterVisualGeometry(
            link, RigidTransform(), shape, f"{name}_visual", np.array(_COLOR.rgba)
        )
    return WornSkin(
        model=model, link=link, geometry_id=geometry_id, reading=reading or ReadingSettings()
    )


def AddModelsAndSkins(
    path: str | Path,
    parser: Parser,
    scene_graph: SceneGraph,
    *,
    seed: int = 0,
    visible: bool = True,
) -> tuple[WornSkin, ...]:
    """Adds the models and the skins of one YAML file to the plant of a parser.

    The file has Drake's own `directives`, and beside them `skins`, as an experiment has them. A
    file of a directive may also be a path, which starts at the YAML file.

    Args:
        path: of the file.
        parser: of a plant that is not yet finalized; its package map finds `package://` URIs.
        scene_graph: of the plant.
        seed: as in `AddSkins`.
        visible: as in `AddSkins`.

    Raises:
        ExperimentError: as in `AddSkins`; or the file has other keys, or a model does not parse.
    """
    path = Path(path)
    skins, sections = load_skins(path), yaml_sections(path)
    if strange := [key for key in sections if key not in _KEYS]:
        raise ExperimentError(f"unknown key {strange[0]} in {path}; known are {', '.join(_KEYS)}")
    with one_line(f"directives of {path} cannot be loaded"):
        directives = LoadModelDirectivesFromString(sections.get("directives", "directives: []"))
        facts = {}
        for directive in directives.directives:
            entry = directive.add_model or directive.add_directives
            if entry is not None and "://" not in entry.file:
                file = (path.parent / entry.file).resolve()
                if file.suffix == ".xml" and file.is_file():
                    file, facts[entry.name] = rewritten(file)
                entry.file = f"file://{file}"
        for info in ProcessModelDirectives(directives, parser):
            if info.model_name in facts:
                apply_facts(parser.plant(), info.model_instance, facts[info.model_name])
    return AddSkins(parser.plant(), scene_graph, skins, seed=seed, visible=visible)


_KEYS = ("directives", "skins")


def leave_neighbours_out(
    plant: MultibodyPlant, scene_graph: SceneGraph, worn: Sequence[WornSkin]
) -> None:
    """Filters contact of each skin with the links next to its own, into which it reaches.

    Drake leaves out links with one joint between them; here also those with several, as hips have
    in MuJoCo's format. The plant is finalized.
    """
    neighbours, filters = Neighbours(plant, scene_graph, {}), scene_graph.collision_filter_manager()
    # A body that floats or slides on the ground is next to it, and can still touch bodies on it.
    ground = neighbours.of(plant.world_body())
    moving = [link for link in all_links(plant) if neighbours.of(link) != ground]
    for skin in worn:
        if neighbours.of(skin.link) != ground:
            near = [
                plant.GetBodyFrameIdOrThrow(link.index())
                for link in moving
                if neighbours.are_neighbours(skin.link, link)
            ]
            both = GeometrySet(skin.geometry_id), GeometrySet(near)
            filters.Apply(CollisionFilterDeclaration().ExcludeBetween(*both))
