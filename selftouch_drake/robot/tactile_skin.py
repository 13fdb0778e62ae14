"""The tactile skin in Drake: skins for links of any plant, and the systems that feel."""

import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common.value import Value
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
from pydrake.multibody.plant import ContactModel, ContactResults, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from selftouch_drake.experiment import ExperimentError, Skin, skins_from_fields
from selftouch_drake.experiment.loading import load_skins, yaml_sections
from selftouch_drake.experiment.schema import Imperfections, Reading
from selftouch_drake.geometry.hollow import vtk_text
from selftouch_drake.lazy import trimesh
from selftouch_drake.robot.contact import SensorModel
from selftouch_drake.robot.faces import FaceReader
from selftouch_drake.robot.imperfections import ImperfectSkins
from selftouch_drake.robot.links import FRICTION, all_links, find_link, in_memory, link_geometries
from selftouch_drake.robot.models import one_line
from selftouch_drake.robot.pairs import Neighbours, WornSkin
from selftouch_drake.robot.readings import readings
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
    reading: Reading | None = None,
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
    return WornSkin(model=model, link=link, geometry_id=geometry_id, reading=reading or Reading())


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
        seed: as of `AddSkins`.
        visible: as of `AddSkins`.

    Raises:
        ExperimentError: as of `AddSkins`; or the file has other keys, or a model does not parse.
    """
    path = Path(path)
    skins, sections = load_skins(path), yaml_sections(path)
    if strange := [key for key in sections if key not in _KEYS]:
        raise ExperimentError(f"unknown key {strange[0]} in {path}; known are {', '.join(_KEYS)}")
    with one_line(f"directives of {path} cannot be loaded"):
        directives = LoadModelDirectivesFromString(sections.get("directives", "directives: []"))
        for directive in directives.directives:
            entry = directive.add_model or directive.add_directives
            if entry is not None and "://" not in entry.file:
                entry.file = f"file://{(path.parent / entry.file).resolve()}"
        ProcessModelDirectives(directives, parser)
    return AddSkins(parser.plant(), scene_graph, skins, seed=seed, visible=visible)


_KEYS = ("directives", "skins")


def AddTactileSkin(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    worn: Sequence[WornSkin],
    *,
    name: str = "tactile_skin",
) -> "TactileSkin":
    """Adds one `TactileSkin` for all skins of a plant to its diagram, and connects it.

    A skin does not feel the links next to its own, into which it reaches at the joint. Drake leaves
    out links with one joint between them; here also those with several, as hips have in MuJoCo's
    format.

    Args:
        builder: of the diagram; of a `RobotDiagramBuilder` its `builder()`.
        plant: finalized, in the diagram.
        scene_graph: of the plant.
        worn: of `AddSkins`.
        name: of the system.

    Returns:
        The system, with the output ports `sensation` of all skins and `NAME_sensation` of each.

    Raises:
        ValueError: the plant computes point contacts, which no skin feels.
    """
    if plant.get_contact_model() == ContactModel.kPoint:
        raise ValueError(
            "the plant's contact model is kPoint, which no skin can feel; call "
            "plant.set_contact_model(ContactModel.kHydroelasticWithFallback) before Finalize"
        )
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
    touch = builder.AddNamedSystem(name, TactileSkin(worn))
    builder.Connect(plant.get_contact_results_output_port(), touch.GetInputPort("contact_results"))
    builder.Connect(plant.get_body_poses_output_port(), touch.GetInputPort("body_poses"))
    return touch


class UnfeltContactWarning(UserWarning):
    """Something presses a skin with a contact that the skin cannot feel."""


class TactileSkin(LeafSystem):
    """Feels the contact on the skinned bodies of a running `MultibodyPlant`.

    The sensation belongs to the same instant as the state if the plant was made with
    `use_sampled_output_ports=False`; otherwise contact results lag by one step.

    .. pydrake_system::

        name: TactileSkin
        input_ports:
        - contact_results
        - body_poses
        output_ports:
        - sensation
        - NAME_sensation (one per skin)

    - contact_results: `ContactResults` of the plant, hydroelastic.
    - body_poses: `list[RigidTransform]` of the plant, so that the skins may move.
    - sensation: `(S,)` N, one reading per receptor, skin after skin; or what the `reading` of a
      skin says. Without a state, a reading has no hysteresis.
    - NAME_sensation: N, the readings of one skin.

    It has no state: two contexts of one diagram do not disturb each other. Like every Drake system
    that is written in Python it can neither be cloned nor converted to another scalar type.

    Args:
        skins: in the order of their readings; call `AddTactileSkin` for one that is connected.
    """

    def __init__(self, skins: Sequence[WornSkin]):
        super().__init__()
        self._sensor = SensorModel(skins)
        self._faces = FaceReader(skins[0].link.GetParentPlant())
        self._links = [int(skin.link.index()) for skin in skins]
        self._skin_ids = frozenset(skin.geometry_id for skin in skins)
        self._contact = self.DeclareAbstractInputPort("contact_results", Value(ContactResults()))
        self._poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        self._readings = [skin.reading for skin in skins]
        self.DeclareVectorOutputPort("sensation", self._sensor.num_receptors, self._calc_sensation)
        for skin, columns in zip(skins, self._sensor.readings, strict=True):
            name, size = f"{skin.model.name}_sensation", skin.model.fields.num_receptors
            self.DeclareVectorOutputPort(name, size, partial(self._calc_part, columns))

    def _calc_part(self, readings, context, output):
        output.SetFromVector(self.GetOutputPort("sensation").Eval(context)[readings])

    def _calc_sensation(self, context, output):
        contact = self._contact.Eval(context)
        self._warn_of_points(contact)
        force = np.zeros(self._sensor.num_receptors)
        if surfaces := list(self._faces.read(contact, self._skin_ids)):
            poses = self._poses.Eval(context)
            X_WL = np.array([poses[link].GetAsMatrix34() for link in self._links])
            for faces in surfaces:
                self._sensor.press(faces, X_WL, force)
        for columns, reading in zip(self._sensor.readings, self._readings, strict=True):
            force[columns] = readings(force[columns], reading)
        output.SetFromVector(force)

    def _warn_of_points(self, contact: ContactResults) -> None:
        numbers = range(contact.num_point_pair_contacts())
        pairs = (contact.point_pair_contact_info(i).point_pair() for i in numbers)
        if any(not self._skin_ids.isdisjoint((pair.id_A, pair.id_B)) for pair in pairs):
            warnings.warn(
                "a skin is pressed by a geometry without hydroelastic properties, which it "
                "cannot feel; give that geometry AddRigidHydroelasticProperties",
                UnfeltContactWarning,
                stacklevel=2,
            )


class SkinReadout(LeafSystem):
    """Turns sensations into readings of real skins: noisy, partly dead, delayed, binary.

    Goes behind a `TactileSkin`.

    .. pydrake_system::

        name: SkinReadout
        input_ports:
        - sensation
        - q
        output_ports:
        - reading

    - sensation: `(S,)` N, of perfect skins.
    - q: `(J,)` rad or m, the configuration in which it is felt; noise comes from it.
    - reading: `(S,)` N.

    Args:
        imperfections: what is read of a sensation.
        num_receptors: S.
        num_joints: J.
        period_s: of the world's discrete steps; delays are rounded to whole ones.
    """

    def __init__(
        self,
        imperfections: ImperfectSkins,
        *,
        num_receptors: int,
        num_joints: int,
        period_s: float,
    ):
        super().__init__()
        self._imperfections = imperfections
        self._sensation = self.DeclareVectorInputPort("sensation", num_receptors)
        self._q = self.DeclareVectorInputPort("q", num_joints)
        self._delay = np.zeros(num_receptors, dtype=int)
        for columns, skin in imperfections.skins:
            self._delay[columns] = round(skin.flaws.delay / period_s)
        remembers = any(skin.reading.hysteresis for _, skin in imperfections.skins)
        self._num_late = max(int(self._delay.max()), int(remembers))
        self.DeclareVectorOutputPort("reading", num_receptors, self._calc_reading)
        if self._num_late:
            # The readings of the last steps, oldest first.
            self.DeclareDiscreteState(self._num_late * num_receptors)
            self.DeclareInitializationDiscreteUpdateEvent(self._begin)
            self.DeclarePeriodicDiscreteUpdateEvent(period_s, 0.0, self._step)

    def _now(self, context, before: np.ndarray | None = None) -> np.ndarray:
        sensation, q = self._sensation.Eval(context), self._q.Eval(context)
        return self._imperfections(sensation[None], q[None], before)[0]

    def _past(self, context) -> np.ndarray:
        return context.get_discrete_state_vector().value().reshape(self._num_late, -1)

    def _begin(self, context, discrete_state):
        # A touch at the start of the world counts as older than any delay.
        discrete_state.set_value(np.tile(self._now(context), self._num_late))

    def _step(self, context, discrete_state):
        past = self._past(context)
        now = self._now(context, past[-1:])
        discrete_state.set_value(np.append(past[1:], now))

    def _calc_reading(self, context, output):
        past = self._past(context) if self._num_late else None
        now = self._now(context, None if past is None else past[-1:])
        if past is not None:
            late = self._delay > 0
            now[late] = past[self._num_late - self._delay[late], np.flatnonzero(late)]
        output.SetFromVector(now)
