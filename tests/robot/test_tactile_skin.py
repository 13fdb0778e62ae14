"""A tactile skin in a user's own diagram."""

import warnings

import numpy as np
import pytest
import trimesh
from pydrake.geometry import (
    AddRigidHydroelasticProperties,
    Box,
    ProximityProperties,
    Role,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, ContactModel, CoulombFriction
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from selftouch_drake import geometry
from selftouch_drake.robot import AddTactileSkin, RegisterSkin, SkinModel, UnfeltContactWarning


@pytest.fixture(scope="module")
def skin():
    surface = geometry.sphere(0.1)
    wall = geometry.hollow_skin(surface, 0.03, None)
    p_LS = geometry.place_receptors(surface, 20, seed=0)
    fields = geometry.receptive_fields(surface, p_LS)
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
        return AddTactileSkin(self.builder, self.plant, self.scene_graph, [self.worn])


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
    touch = AddTactileSkin(builder, plant, scene_graph, [worn])
    context = builder.Build().CreateDefaultContext()
    pose = RigidTransform([0, 0, 0.09])
    plant.SetFreeBodyPose(plant.GetMyMutableContextFromRoot(context), body, pose)
    felt = touch.GetOutputPort("sensation").Eval(touch.GetMyContextFromRoot(context))
    assert felt.sum() > 1.0
