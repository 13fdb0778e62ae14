"""Several skins on a user's own plant."""

import copy
import re

import numpy as np
import pytest
from pydrake.geometry import AddRigidHydroelasticProperties, Box, ProximityProperties, Role
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import SpatialInertia
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from selftouch_drake.experiment import Skin
from selftouch_drake.experiment.schema import SurfaceSettings
from selftouch_drake.systems import AddModelsAndSkins, AddSkins, TactileSkin

INERTIA = '<mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
BALL = """<collision><origin xyz="0 0 {z}"/><geometry><sphere radius="0.05"/></geometry>
</collision>"""
# Two links with balls that overlap, and a massless one between them.
URDF = f"""<robot name="pair">
  <link name="lower"><inertial>{INERTIA}</inertial>{BALL.format(z=0)}</link>
  <link name="between"/>
  <link name="upper"><inertial>{INERTIA}</inertial>{BALL.format(z=0.04)}</link>
  <joint name="first" type="revolute"><parent link="lower"/><child link="between"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0" effort="0"/></joint>
  <joint name="second" type="revolute"><parent link="between"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="0" effort="0"/></joint>
</robot>"""
SKIN = {"surface": "collision", "thickness": 0.015, "num_receptors": 20}
SKINS = {name: {"link": name, **SKIN} for name in ("lower", "upper")}


def add_floor(plant):
    properties = ProximityProperties()
    AddRigidHydroelasticProperties(1.0, properties)
    X_WF = RigidTransform([0, 0, -0.05])
    plant.RegisterCollisionGeometry(plant.world_body(), X_WF, Box(1, 1, 0.1), "floor", properties)


class Pair:
    """The two links over a floor."""

    def __init__(self, how, skins=SKINS, **more):
        if how == "robot_diagram":
            builder = RobotDiagramBuilder(time_step=0.0)
            plant, scene_graph, parser = builder.plant(), builder.scene_graph(), builder.parser()
        else:
            builder = DiagramBuilder()
            plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
            parser = Parser(plant)
        parser.AddModelsFromString(URDF, "urdf")
        add_floor(plant)
        self.worn = AddSkins(plant, scene_graph, skins, **more)
        plant.Finalize()
        inner = builder.builder() if how == "robot_diagram" else builder
        self.touch = TactileSkin.AddToBuilder(inner, plant, scene_graph, self.worn)
        self.log = LogVectorOutput(self.touch.GetOutputPort("sensation"), inner)
        self.plant, self.scene_graph, self.diagram = plant, scene_graph, builder.Build()

    def put(self, context, height):
        plant_context = self.plant.GetMyMutableContextFromRoot(context)
        pose = RigidTransform([0, 0, height])
        self.plant.SetFreeBodyPose(plant_context, self.plant.GetBodyByName("lower"), pose)

    def feel(self, context, port="sensation"):
        return self.touch.GetOutputPort(port).Eval(self.touch.GetMyContextFromRoot(context))


@pytest.fixture(scope="module")
def pair():
    return Pair("plant")


def test_both_ways_to_build_a_diagram_feel_the_same(pair):
    felt = []
    for made in (pair, Pair("robot_diagram")):
        context = made.diagram.CreateDefaultContext()
        made.put(context, 0.045)
        felt.append(made.feel(context))
    assert felt[0].sum() > 1.0
    np.testing.assert_array_equal(*felt)


def test_each_skin_has_a_port(pair):
    context = pair.diagram.CreateDefaultContext()
    pair.put(context, 0.045)
    lower, upper = (pair.feel(context, f"{name}_sensation") for name in SKINS)
    np.testing.assert_array_equal(np.concatenate([lower, upper]), pair.feel(context))
    assert lower.any()
    # It overlaps with the other, its neighbour, and is far from the floor.
    assert not upper.any()


def test_what_floats_is_felt_by_a_skin_that_is_welded_to_the_world():
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    inertia = SpatialInertia.SolidSphereWithMass(1.0, 0.1)
    fixed, free = (plant.AddRigidBody(name, inertia) for name in ("fixed", "free"))
    plant.WeldFrames(plant.world_frame(), fixed.body_frame())
    properties = ProximityProperties()
    AddRigidHydroelasticProperties(0.05, properties)
    plant.RegisterCollisionGeometry(free, RigidTransform(), Box(0.1, 0.1, 0.1), "box", properties)
    skin = {"link": "fixed", "surface": {"shape": "sphere", "radius": 0.1}, "num_receptors": 20}
    worn = AddSkins(plant, scene_graph, {"fixed": skin})
    plant.SetDefaultFloatingBaseBodyPose(free, RigidTransform([0, 0, 0.145]))
    plant.Finalize()
    touch = TactileSkin.AddToBuilder(builder, plant, scene_graph, worn)
    context = builder.Build().CreateDefaultContext()
    assert touch.get_output_port(0).Eval(touch.GetMyContextFromRoot(context)).sum() > 1.0


def test_a_skin_takes_the_place_of_its_links_own_geometry(pair):
    inspector = pair.scene_graph.model_inspector()
    for worn in pair.worn:
        frame = pair.plant.GetBodyFrameIdOrThrow(worn.link.index())
        assert inspector.GetGeometries(frame, Role.kProximity) == [worn.geometry_id]


def test_a_skin_of_a_shape_leaves_its_links_geometry_be():
    skin = Skin(
        link="upper", surface=SurfaceSettings(shape="sphere", radius=0.08), num_receptors=20
    )
    made = Pair("plant", {"upper": skin}, visible=False)
    inspector = made.scene_graph.model_inspector()
    frame = made.plant.GetBodyFrameIdOrThrow(made.plant.GetBodyByName("upper").index())
    assert len(inspector.GetGeometries(frame, Role.kProximity)) == 2
    assert not inspector.GetAllGeometryIds(Role.kIllustration)


def test_two_contexts_do_not_disturb_each_other(pair):
    contexts = [pair.diagram.CreateDefaultContext() for _ in range(2)]
    heights = 0.045, 0.047
    alone = []
    for context, height in zip(contexts, heights, strict=True):
        pair.put(context, height)
        alone.append(pair.feel(context))
    # A copy goes its own way, too.
    clone = contexts[0].Clone()
    pair.put(clone, 1.0)
    assert not pair.feel(clone).any()
    for context, felt in zip(contexts, alone, strict=True):
        np.testing.assert_array_equal(pair.feel(context), felt)
    assert alone[0].sum() > alone[1].sum() > 0


def test_two_simulations_of_one_diagram_keep_logs_of_their_own(pair):
    simulators = [Simulator(pair.diagram, pair.diagram.CreateDefaultContext()) for _ in range(2)]
    for simulator, height in zip(simulators, (0.047, 1.0), strict=True):
        pair.put(simulator.get_mutable_context(), height)
    for end in (0.005, 0.01):
        for simulator in simulators:
            simulator.AdvanceTo(end)
    near, far = (pair.log.FindLog(simulator.get_context()).data() for simulator in simulators)
    assert near.any()
    assert far.shape[1] > 1
    assert not far.any()


def test_what_drake_cannot_do_with_a_system_in_python(pair):
    # If one of these goes through, docs/drake_users.md is out of date.
    for system in (pair.touch, pair.diagram):
        with pytest.raises(RuntimeError, match="does not support Cloning"):
            system.Clone()
        with pytest.raises(RuntimeError, match="does not support Cloning"):
            copy.deepcopy(system)
        with pytest.raises(RuntimeError, match="does not support scalar conversion"):
            system.ToAutoDiffXd()
        assert system.ToSymbolicMaybe() is None
    # The plant in the diagram, skins and all, has gradients by itself.
    assert pair.plant.ToAutoDiffXd().num_positions() == pair.plant.num_positions()


def test_models_and_skins_come_from_one_file(tmp_path):
    (tmp_path / "pair.urdf").write_text(URDF, encoding="utf-8")
    (tmp_path / "pair.yaml").write_text(
        """
        directives:
        - add_model: {name: one, file: pair.urdf}
        - add_weld:
            parent: world
            child: one::lower
            X_PC: {translation: [0, 0, 0.2], rotation: !Rpy {deg: [0, 90, 0]}}
        skins:
          upper: {link: "one::upper", surface: collision, thickness: 0.015, num_receptors: 20}
        """,
        encoding="utf-8",
    )
    builder = RobotDiagramBuilder()
    parser, scene_graph = builder.parser(), builder.scene_graph()
    (worn,) = AddModelsAndSkins(tmp_path / "pair.yaml", parser, scene_graph)
    assert worn.link.name() == "upper"
    assert worn.model.fields.num_receptors == 20
    builder.plant().Finalize()
    touch = TactileSkin.AddToBuilder(builder.builder(), builder.plant(), scene_graph, [worn])
    assert isinstance(touch, TactileSkin)
    assert touch.GetOutputPort("upper_sensation").size() == 20
    # The same file gives skins alone.
    other = RobotDiagramBuilder()
    other.parser().AddModels(str(tmp_path / "pair.urdf"))
    alone = tmp_path / "skins.yaml"
    alone.write_text("skins: {lower: {link: lower, surface: collision, thickness: 0.015}}")
    (worn,) = AddSkins(other.plant(), other.scene_graph(), alone)
    assert worn.model.name == "lower"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "cannot be read as YAML: "),
        ("[1]", "is not a mapping; write `skins:` and skins by name"),
        ("skin: {}", "skins is {}; give at least one skin"),
        ("skins: {a: {}}\nplace: 3", "skins.a.link is missing"),
        (
            "skins: {a: {link: lower, surface: collision}}\nplace: 3",
            "unknown key place in FILE; known are directives, skins",
        ),
        (
            "directives: [{add_modle: {}}]\nskins: {a: {link: lower, surface: collision}}",
            "directives of FILE cannot be loaded: ",
        ),
        (
            "skins: {a: {link: lower, surface: collision}}",
            "skins.a.link is 'lower'; the robot has no such link: ",
        ),
        (
            "skins: {a: {link: l, surface: collision, imperfections: {dead: 0.1}}}",
            "skins.a.imperfections is given; leave it out, and connect a SkinReadout to the "
            "TactileSkin",
        ),
    ],
)
def test_mistakes_are_named_in_one_line(tmp_path, text, message):
    file = tmp_path / "skins.yaml"
    if text is not None:
        file.write_text(text, encoding="utf-8")
    builder = RobotDiagramBuilder()
    with pytest.raises(ValueError, match=re.escape(message.replace("FILE", str(file)))) as raised:
        AddModelsAndSkins(file, builder.parser(), builder.scene_graph())
    assert "\n" not in str(raised.value)


def test_drakes_parsers_ignore_tags_of_others_and_read_none():
    # Why skins have a file of their own: a tag of ours is let through, and lost.
    sdf = """<sdf version="1.7"><model name="m"><link name="l">
      <{tag} surface="collision"/></link></model></sdf>"""
    parsers = [RobotDiagramBuilder().parser() for _ in range(2)]
    parsers[0].AddModelsFromString(sdf.format(tag="selftouch:skin"), "sdf")
    with pytest.raises(RuntimeError, match="Unsupported SDFormat element in link"):
        parsers[1].AddModelsFromString(sdf.format(tag="drake:skin"), "sdf")
