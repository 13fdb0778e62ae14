"""A tactile skin in a user's own diagram."""

import dataclasses
import warnings

import numpy as np
import pytest
import trimesh
from pydrake.geometry import (
    AddRigidHydroelasticProperties,
    Box,
    HydroelasticContactRepresentation,
    ProximityProperties,
    Role,
    Sphere,
)
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, ContactModel, CoulombFriction
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from selftouch_drake.geometry import hollow, receptors, surfaces
from selftouch_drake.robot import SkinModel
from selftouch_drake.robot.faces import Faces
from selftouch_drake.systems import RegisterSkin, TactileSkin, UnfeltContactWarning


@pytest.fixture(scope="module")
def skin():
    surface = surfaces.sphere(0.1)
    wall = hollow.hollow_skin(surface, 0.03)
    p_LS = receptors.place_receptors(surface, 20, seed=0)
    fields = receptors.receptive_fields(surface, p_LS)
    return SkinModel(
        name="palm",
        link="body",
        wall=wall,
        fields=fields,
        hydroelastic_modulus=3e4,
        is_own_geometry=False,
    )


class Plant:
    """A plant with a body that wears a skin, and a finger without hydroelastic properties."""

    def __init__(self, skin, *, contact_model=ContactModel.kHydroelasticWithFallback, **more):
        self.builder = DiagramBuilder()
        # A continuous plant: its contact results belong to the state, and not to the last step.
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(self.builder, time_step=0.0)
        self.plant.set_contact_model(contact_model)
        self.body, self.finger = [
            self.plant.AddRigidBody(name, SpatialInertia.SolidSphereWithMass(1.0, 0.1))
            for name in ("body", "finger")
        ]
        self.plant.RegisterCollisionGeometry(
            self.finger, RigidTransform(), Sphere(0.02), "tip", CoulombFriction(0.5, 0.5)
        )
        self.worn = RegisterSkin(self.plant, skin, **more)
        self.plant.Finalize()

    def add_skin(self):
        return TactileSkin.AddToBuilder(self.builder, self.plant, self.scene_graph, [self.worn])


def test_a_plant_with_point_contact_is_refused(skin):
    made = Plant(skin, contact_model=ContactModel.kPoint)
    message = (
        r"^the plant's contact model is kPoint, which no skin can feel; call "
        r"plant.set_contact_model\(ContactModel.kHydroelasticWithFallback\) before Finalize$"
    )
    with pytest.raises(ValueError, match=message):
        made.add_skin()


@pytest.mark.parametrize("pressing", [True, False])
def test_a_contact_that_no_skin_feels_is_warned_of(skin, pressing):
    made = Plant(skin)
    touch = made.add_skin()
    diagram = made.builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = made.plant.GetMyMutableContextFromRoot(context)
    made.plant.SetFreeBodyPose(plant_context, made.body, RigidTransform())
    at = [0, 0, 0.11] if pressing else [0, 0, 0.5]
    made.plant.SetFreeBodyPose(plant_context, made.finger, RigidTransform(at))
    sensation = touch.GetOutputPort("sensation")
    if pressing:
        message = (
            r"^a skin is pressed by a geometry without hydroelastic properties, which it cannot "
            r"feel; give that geometry AddRigidHydroelasticProperties$"
        )
        with pytest.warns(UnfeltContactWarning, match=message):
            felt = sensation.Eval(touch.GetMyContextFromRoot(context))
    else:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            felt = sensation.Eval(touch.GetMyContextFromRoot(context))
    np.testing.assert_array_equal(felt, 0.0)


def test_a_skin_is_drawn_where_it_is(skin):
    made = Plant(skin)
    inspector = made.scene_graph.model_inspector()
    frame = made.plant.GetBodyFrameIdOrThrow(made.body.index())
    (drawn,) = inspector.GetGeometries(frame, Role.kIllustration)
    (felt,) = inspector.GetGeometries(frame, Role.kProximity)
    assert felt == made.worn.geometry_id
    for geometry_id in (drawn, felt):
        assert inspector.GetPoseInFrame(geometry_id).IsExactlyIdentity()
    file = inspector.GetShape(drawn).source().in_memory().mesh_file
    surface = trimesh.load_mesh(
        trimesh.util.wrap_as_stream(file.contents()), file_type="obj", process=False
    )
    np.testing.assert_allclose(surface.vertices, skin.wall.vertices, atol=1e-12)
    assert surface.is_watertight
    assert surface.volume > 0
    assert inspector.GetName(drawn).endswith("skin_palm_visual")


def test_a_skin_may_be_invisible(skin):
    made = Plant(skin, visible=False)
    inspector = made.scene_graph.model_inspector()
    assert not inspector.GetAllGeometryIds(Role.kIllustration)


def test_what_no_experiment_names_is_felt_too(skin):
    # As the floor of a diagram of one's own: hydroelastic, and of no toucher's geometry.
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    properties = ProximityProperties()
    AddRigidHydroelasticProperties(0.5, properties)
    plant.RegisterCollisionGeometry(
        plant.world_body(), RigidTransform([0, 0, -0.5]), Box(1, 1, 1), "floor", properties
    )
    body = plant.AddRigidBody("body", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    worn = RegisterSkin(plant, skin)
    plant.Finalize()
    touch = TactileSkin.AddToBuilder(builder, plant, scene_graph, [worn])
    context = builder.Build().CreateDefaultContext()
    pose = RigidTransform([0, 0, 0.09])
    plant.SetFreeBodyPose(plant.GetMyMutableContextFromRoot(context), body, pose)
    felt = touch.GetOutputPort("sensation").Eval(touch.GetMyContextFromRoot(context))
    assert felt.sum() > 1.0


@pytest.mark.parametrize("representation", ["kPolygon", "kTriangle"])
def test_readings_are_those_of_the_faces_one_by_one(skin, representation):
    # Three skins, the first two pressed by balls and by each other; the third by nothing. A ball
    # without hydroelastic properties puts a point contact into the plant's results.
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    plant.set_contact_model(ContactModel.kHydroelasticWithFallback)
    plant.set_contact_surface_representation(
        getattr(HydroelasticContactRepresentation, representation)
    )
    rigid = ProximityProperties()
    AddRigidHydroelasticProperties(0.01, rigid)
    inertia = SpatialInertia.SolidSphereWithMass(1.0, 0.1)
    names = ("one", "two", "three", "ball_a", "ball_b", "post", "pin")
    bodies = {name: plant.AddRigidBody(name, inertia) for name in names}
    worn = [
        RegisterSkin(plant, dataclasses.replace(skin, name=name, link=name))
        for name in ("one", "two", "three")
    ]
    for ball in ("ball_a", "ball_b", "post"):
        shape = Sphere(0.01)
        plant.RegisterCollisionGeometry(bodies[ball], RigidTransform(), shape, ball, rigid)
    plant.RegisterCollisionGeometry(
        bodies["pin"], RigidTransform(), Sphere(0.01), "pin", CoulombFriction(0.5, 0.5)
    )
    plant.Finalize()
    touch = TactileSkin.AddToBuilder(builder, plant, scene_graph, worn)
    context = builder.Build().CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    rng = np.random.default_rng(0)
    for _ in range(20):
        at = {"one": [0, 0, 0], "two": [0, 0.19, 0], "three": [0, 9, 0], "pin": [0, 5, 0]}
        at["post"] = [0.01, 5.01, 0.01]
        for ball, centre in (("ball_a", "one"), ("ball_b", "two")):
            away = rng.standard_normal(3)
            at[ball] = at[centre] + rng.uniform(0.08, 0.105) * away / np.linalg.norm(away)
        for name, body in bodies.items():
            turn = RollPitchYaw(rng.uniform(-1, 1, 3))
            plant.SetFreeBodyPose(plant_context, body, RigidTransform(turn, at[name]))
        felt = touch.GetOutputPort("sensation").Eval(touch.GetMyContextFromRoot(context))
        contact = plant.get_contact_results_output_port().Eval(plant_context)
        assert contact.num_point_pair_contacts() == 1
        expected = np.zeros((3, 20))
        for i in range(contact.num_hydroelastic_contacts()):
            faces = Faces.of(contact.hydroelastic_contact_info(i).contact_surface())
            for reading, each in zip(expected, worn, strict=True):
                if each.geometry_id in faces.ends:
                    X_LW = plant.EvalBodyPoseInWorld(plant_context, each.link).inverse()
                    p_LQ = X_LW.multiply(faces.centroid.T).T
                    reading += faces.force @ skin.fields.weights_at(p_LQ).toarray()
        assert (expected.sum(axis=1) > 0).tolist() == [True, True, False]
        np.testing.assert_allclose(felt, expected.ravel(), rtol=0, atol=1e-12)
