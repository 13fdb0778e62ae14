"""Physics that the tactile skin has to get right, each through Drake's own contact."""

import functools
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry import (
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    HydroelasticContactRepresentation,
    ProximityProperties,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.trajectories import PiecewisePolynomial

from selftouch_drake import body
from selftouch_drake.robot import KinematicTactileSkin, RegisterSkin, TactileSkin
from selftouch_drake.robot.contact import pressed_points

SURFACES = {
    "sphere": lambda: body.sphere(0.25),
    "cube": lambda: body.cube(0.44),
    "torus": lambda: body.torus(0.22, 0.09),
}
MODULUS = 3.0e4
TIP_RADIUS = body.FINGERTIP_RADIUS
# Where a fingertip is out of the way.
AWAY = RigidTransform([5.0, 0.0, 0.0])
GRAVITY = 9.81

seeds = st.integers(0, 2**32 - 1)


def _rigid(resolution_hint: float, friction: float) -> ProximityProperties:
    properties = ProximityProperties()
    AddRigidHydroelasticProperties(resolution_hint, properties)
    AddContactMaterial(friction=CoulombFriction(friction, friction), properties=properties)
    return properties


class TouchRig:
    """A free body with a skin and two free fingertips, to be put anywhere in a plant of its own."""

    def __init__(self, surface, *, thickness=0.03, num_receptors=100):
        self.surface = surface
        self.skin = body.hollow_skin(surface, thickness, TIP_RADIUS)
        p_BS = body.place_receptors(surface, num_receptors, seed=0)
        self.fields = body.receptive_fields(surface, p_BS)
        builder = DiagramBuilder()
        # A continuous plant: its contact results belong to the state, and at rest to it alone.
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
        plant.set_contact_surface_representation(HydroelasticContactRepresentation.kPolygon)
        covered = plant.AddRigidBody("covered", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
        skin_id = RegisterSkin(plant, covered, self.skin, hydroelastic_modulus=MODULUS)
        tips = []
        for name in ("tip_0", "tip_1"):
            tip = plant.AddRigidBody(name, SpatialInertia.SolidSphereWithMass(1.0, TIP_RADIUS))
            properties = _rigid(0.01, friction=0.2)
            X_FG = RigidTransform()
            plant.RegisterCollisionGeometry(tip, X_FG, Sphere(TIP_RADIUS), name, properties)
            tips.append(tip)
        plant.Finalize()
        self._touch = TactileSkin.AddToBuilder(
            builder, plant, fields=self.fields, body=covered, skin_id=skin_id
        )
        self._kinematic = builder.AddSystem(
            KinematicTactileSkin(fields=self.fields, skin_id=skin_id)
        )
        builder.Connect(scene_graph.get_query_output_port(), self._kinematic.get_input_port())
        self._plant, self._bodies = plant, (covered, *tips)
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._plant_context = plant.GetMyMutableContextFromRoot(self._context)

    def feel(self, X_BF, X_BF1=AWAY, X_WB=None):
        """The sensation of fingertips at `X_BF` and `X_BF1`, of a body at `X_WB`."""
        X_WB = X_WB or RigidTransform()
        for link, X_WL in zip(self._bodies, (X_WB, X_WB @ X_BF, X_WB @ X_BF1), strict=True):
            self._plant.SetFreeBodyPose(self._plant_context, link, X_WL)
        return self._touch.get_output_port().Eval(self._touch.GetMyContextFromRoot(self._context))

    def feel_kinematically(self):
        """The same from the system that needs no plant."""
        context = self._kinematic.GetMyContextFromRoot(self._context)
        return self._kinematic.get_output_port().Eval(context)

    def contacts(self):
        """The hydroelastic contacts of the last `feel`."""
        results = self._plant.get_contact_results_output_port().Eval(self._plant_context)
        count = results.num_hydroelastic_contacts()
        return [results.hydroelastic_contact_info(i) for i in range(count)]

    def touch(self, rng, depth=None):
        """A fingertip, turned at random, pressed into the skin at a random place."""
        face = rng.integers(len(self.surface.faces))
        p_BQ = rng.dirichlet(np.ones(3)) @ self.surface.triangles[face]
        # Its inscribed polyhedron reaches the skin from less than 2 mm on.
        depth = rng.uniform(0.002, 0.009) if depth is None else depth
        normal = self.surface.face_normals[face]
        return RigidTransform(_random_rotation(rng), p_BQ + (TIP_RADIUS - depth) * normal)


@functools.cache
def rig(shape: str) -> TouchRig:
    return TouchRig(SURFACES[shape]())


def _random_rotation(rng) -> RotationMatrix:
    rotation, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    return RotationMatrix(rotation * np.linalg.det(rotation))


def _integral_over_polygons(surface) -> tuple[float, np.ndarray]:
    """Pressure integrated over a contact surface, and the force it makes, triangle by triangle."""
    mesh, pressure = surface.poly_mesh_W(), surface.poly_e_MN()
    total, force = 0.0, np.zeros(3)
    for face in range(mesh.num_faces()):
        polygon = mesh.element(face)
        vertices = [polygon.vertex(i) for i in range(polygon.num_vertices())]
        for b, c in itertools.pairwise(vertices[1:]):
            p, q, r = (mesh.vertex(v) for v in (vertices[0], b, c))
            area_vector = np.cross(q - p, r - p) / 2
            mean = np.mean([pressure.EvaluateAtVertex(v) for v in (vertices[0], b, c)])
            total += mean * np.linalg.norm(area_vector)
            force += mean * area_vector
    return total, force


def test_a_resting_weight_is_felt_as_its_weight():
    surface = body.cube(0.44)
    skin = body.hollow_skin(surface, 0.03, TIP_RADIUS)
    fields = body.receptive_fields(surface, body.place_receptors(surface, 100, seed=0))
    mass, size = 0.2, (0.08, 0.08, 0.04)

    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.002)
    covered = plant.AddRigidBody("covered", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    plant.WeldFrames(plant.world_frame(), covered.body_frame())
    skin_id = RegisterSkin(plant, covered, skin, hydroelastic_modulus=MODULUS)
    block = plant.AddRigidBody("block", SpatialInertia.SolidBoxWithMass(mass, *size))
    plant.RegisterCollisionGeometry(
        block, RigidTransform(), Box(*size), "block", _rigid(0.1, friction=0.2)
    )
    plant.Finalize()
    touch = TactileSkin.AddToBuilder(builder, plant, fields=fields, body=covered, skin_id=skin_id)
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    plant.SetFreeBodyPose(plant_context, block, RigidTransform([0.03, -0.02, 0.24]))

    simulator.AdvanceTo(1.0)
    sensation = touch.get_output_port().Eval(touch.GetMyContextFromRoot(context))
    assert np.abs(plant.GetVelocities(plant_context)).max() < 1e-3
    # What is too much, 0.4 %, presses on the sides of the block, which sinks in by 0.15 mm.
    assert sensation.sum() == pytest.approx(mass * GRAVITY, rel=0.01)
    assert (fields.p_BS[sensation > 0][:, 2] > 0.2).all()


@settings(max_examples=60, deadline=None)
@given(shape=st.sampled_from(sorted(SURFACES)), seed=seeds)
def test_readings_sum_to_the_pressure_integrated_over_the_contact(shape, seed):
    rng = np.random.default_rng(seed)
    sensation = rig(shape).feel(rig(shape).touch(rng), rig(shape).touch(rng))
    integrals = [_integral_over_polygons(info.contact_surface()) for info in rig(shape).contacts()]
    assert len(integrals) >= 2
    assert sensation.min() >= 0
    assert sensation.sum() == pytest.approx(sum(total for total, _ in integrals), rel=1e-9)


@settings(max_examples=60, deadline=None)
@given(shape=st.sampled_from(sorted(SURFACES)), seed=seeds)
def test_pressed_points_make_the_force_that_drake_applies(shape, seed):
    # Nothing moves, so there is neither friction nor dissipation.
    rig(shape).feel(rig(shape).touch(np.random.default_rng(seed)))
    (info,) = rig(shape).contacts()
    surface = info.contact_surface()
    _, force = pressed_points(surface)
    normals = np.array([surface.face_normal(face) for face in range(surface.num_faces())])
    F_Ac_W = info.F_Ac_W().translational()
    scale = np.linalg.norm(F_Ac_W)
    assert scale > 0
    np.testing.assert_allclose(np.array(force) @ normals, F_Ac_W, rtol=0, atol=1e-4 * scale)


@settings(max_examples=30, deadline=None)
@given(shape=st.sampled_from(sorted(SURFACES)), seed=seeds)
def test_two_fingers_are_felt_as_the_sum_of_each_alone(shape, seed):
    rng = np.random.default_rng(seed)
    one, other = rig(shape).touch(rng), rig(shape).touch(rng)
    both = rig(shape).feel(one, other)
    alone = rig(shape).feel(one) + rig(shape).feel(other)
    np.testing.assert_allclose(both, alone, rtol=0, atol=1e-12 * alone.max())


@settings(max_examples=80, deadline=None)
@given(shape=st.sampled_from(sorted(SURFACES)), seed=seeds)
def test_a_rigid_motion_of_body_and_finger_changes_nothing(shape, seed):
    rng = np.random.default_rng(seed)
    X_BF = rig(shape).touch(rng)
    here = rig(shape).feel(X_BF)
    X_WB = RigidTransform(_random_rotation(rng), rng.uniform(-2, 2, 3))
    there = rig(shape).feel(X_BF, X_WB=X_WB)
    kinematic = rig(shape).feel_kinematically()
    assert here.max() > 0
    np.testing.assert_allclose(there, here, rtol=0, atol=1e-9 * here.max())
    np.testing.assert_allclose(kinematic, there, rtol=0, atol=1e-12 * here.max())


@settings(max_examples=60, deadline=None)
@given(shape=st.sampled_from(sorted(SURFACES)), seed=seeds)
def test_a_fingertip_in_the_cavity_feels_nothing(shape, seed):
    rng = np.random.default_rng(seed)
    # Below the middle of a face, beyond the skin and its own radius.
    free = {"sphere": 0.25, "cube": 0.22, "torus": 0.09}[shape]
    depth = rng.uniform(0.03 + 2 * TIP_RADIUS + 0.001, free)
    if shape == "cube":
        p_BF = rng.uniform(-1, 1, 3) * (0.22 - 0.03 - TIP_RADIUS - 0.0005)
        X_BF = RigidTransform(_random_rotation(rng), p_BF)
    else:
        X_BF = rig(shape).touch(rng, depth=depth)
    np.testing.assert_array_equal(rig(shape).feel(X_BF), 0.0)
    assert rig(shape).contacts() == []


@pytest.mark.parametrize("shape", SURFACES)
def test_a_fingertip_at_the_inner_wall_is_felt(shape):
    # So that silence in the cavity is not the silence of a skin that ends halfway.
    depth = 0.03 + 2 * TIP_RADIUS - 0.004
    assert rig(shape).feel(rig(shape).touch(np.random.default_rng(0), depth=depth)).any()


@settings(max_examples=150, deadline=None)
@given(shape=st.sampled_from(sorted(SURFACES)), seed=seeds)
def test_every_pressed_point_is_felt_by_three_receptors(shape, seed):
    rng = np.random.default_rng(seed)
    sensation = rig(shape).feel(rig(shape).touch(rng))
    (info,) = rig(shape).contacts()
    # The body is at the origin of the world.
    p_BQ, force = pressed_points(info.contact_surface())
    weights = rig(shape).fields.weights_at(np.array(p_BQ)).toarray()
    assert max(force) > 0
    assert (weights > 0).sum(axis=1).min() >= 3
    assert (sensation > 0).sum() >= 3


def test_opposite_walls_do_not_talk():
    # A disc so flat that fields measured through the body would reach the other side.
    flat = TouchRig(body.cylinder(0.2, 0.07), thickness=0.02, num_receptors=50)
    assert flat.fields.radius > 0.07
    for side in (1.0, -1.0):
        p_BF = [0.01, 0.02, side * (0.035 + TIP_RADIUS - 0.009)]
        sensation = flat.feel(RigidTransform(p_BF))
        assert sensation.sum() > 1.0
        assert (side * flat.fields.p_BS[sensation > 0][:, 2] > 0).all()


def test_a_moving_simulation_feels_what_the_kinematic_evaluation_feels(world, moving_agent):
    lower, upper = world.probe.agent.lower, world.probe.agent.upper
    q = np.random.default_rng(0).uniform(lower, upper, (4000, 6))
    touching = q[world.probe.sensations(q).any(axis=1)][:3]
    for middle in touching:
        swing = np.array([0.3, -0.3, 0.2, 0.4, -0.4, 0.4])
        way = np.clip(middle + np.outer([-1, 0, 1], swing), lower, upper).T
        rest = np.zeros((6, 1))
        trajectory = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(
            [0.0, 0.3, 0.6], way, rest, rest
        )
        felt = moving_agent.follow(trajectory, start=way[:, 0], duration=0.6)
        expected = world.probe.sensations(felt.q)
        assert felt.sensation.any(axis=1).sum() >= 10
        np.testing.assert_allclose(felt.sensation, expected, rtol=0, atol=1e-9 * expected.max())
