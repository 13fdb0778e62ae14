"""Physical checks of the tactile skin, with Drake's own contact."""

import functools
import itertools

import numpy as np
import pytest
import robots
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
from pydrake.multibody.tree import (
    PdControllerGains,
    PrismaticJoint,
    RevoluteJoint,
    SpatialInertia,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from selftouch_drake.geometry import hollow, receptors, surfaces
from selftouch_drake.robot import SensorModel, SkinModel
from selftouch_drake.robot.faces import Faces
from selftouch_drake.systems import RegisterSkin, TactileSkin
from selftouch_drake.systems.simulation import simulation_of

SURFACES = {
    "sphere": lambda: surfaces.sphere(0.25),
    "cube": lambda: surfaces.cube(0.44),
    "torus": lambda: surfaces.torus(0.22, 0.09),
}
MODULUS = 3.0e4
TIP_RADIUS = 0.01
# Where a fingertip is out of the way.
AWAY = RigidTransform([5.0, 0.0, 0.0])
GRAVITY = 9.81

seeds = st.integers(0, 2**32 - 1)
shapes = st.sampled_from(sorted(SURFACES))


def _rigid(resolution_hint: float, friction: float) -> ProximityProperties:
    properties = ProximityProperties()
    AddRigidHydroelasticProperties(resolution_hint, properties)
    AddContactMaterial(friction=CoulombFriction(friction, friction), properties=properties)
    return properties


@functools.cache
def _skin_of(shape):
    """One for all rigs: it takes seconds to make."""
    return _skin(SURFACES[shape]())


def _skin(surface, *, link="covered", thickness=0.03, num_receptors=100):
    p_LS = receptors.place_receptors(surface, num_receptors, seed=0)
    return SkinModel(
        name=link,
        link=link,
        wall=hollow.hollow_skin(surface, thickness),
        fields=receptors.receptive_fields(surface, p_LS),
        hydroelastic_modulus=MODULUS,
        is_own_geometry=False,
    )


class TouchRig:
    """A free body with a skin and two free fingertips, to be put anywhere in a plant of its own."""

    def __init__(self, surface, model):
        self.surface = surface
        self.fields = model.fields
        builder = DiagramBuilder()
        # A continuous plant: its contact results belong to the state, and at rest to it alone.
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
        plant.set_contact_surface_representation(HydroelasticContactRepresentation.kPolygon)
        covered, *tips = [
            plant.AddRigidBody(name, SpatialInertia.SolidSphereWithMass(1.0, 0.1))
            for name in ("covered", "tip_0", "tip_1")
        ]
        worn = RegisterSkin(plant, model)
        for tip in tips:
            shape, properties = Sphere(TIP_RADIUS), _rigid(0.01, friction=0.2)
            plant.RegisterCollisionGeometry(tip, RigidTransform(), shape, "tip", properties)
        plant.Finalize()
        self._touch = TactileSkin.AddToBuilder(builder, plant, scene_graph, [worn])
        self._sensor = SensorModel([worn])
        self._skin_id, self._scene_graph = worn.geometry_id, scene_graph
        self._plant, self._bodies = plant, (covered, *tips)
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._plant_context = plant.GetMyMutableContextFromRoot(self._context)

    def feel(self, X_BF, X_BF1=AWAY, X_WB=None):
        """The sensation for fingertips at `X_BF` and `X_BF1` on a body at `X_WB`."""
        X_WB = X_WB or RigidTransform()
        poses = X_WB, X_WB @ X_BF, X_WB @ X_BF1
        for body, X_WL in zip(self._bodies, poses, strict=True):
            self._plant.SetFreeBodyPose(self._plant_context, body, X_WL)
        return self._read(self._touch)

    def feel_kinematically(self):
        """Readings without the plant's contact results, at the poses of the last `feel`."""
        context = self._scene_graph.GetMyContextFromRoot(self._context)
        query = self._scene_graph.get_query_output_port().Eval(context)
        found = query.ComputeContactSurfaces(HydroelasticContactRepresentation.kPolygon)
        X_WL = query.GetPoseInWorld(self._skin_id).GetAsMatrix34()[None, None]
        return self._sensor.touches([(0, Faces.of(surface)) for surface in found], X_WL).sensation[
            0
        ]

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

    def _read(self, system):
        return system.get_output_port(0).Eval(system.GetMyContextFromRoot(self._context))


@functools.cache
def rig(shape: str) -> TouchRig:
    return TouchRig(SURFACES[shape](), _skin_of(shape))


def _random_rotation(rng) -> RotationMatrix:
    rotation, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    return RotationMatrix(rotation * np.linalg.det(rotation))


def _integral_over_polygons(surface) -> tuple[float, np.ndarray]:
    """Integral of the pressure over a contact surface, and its force, triangle by triangle."""
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


@settings(max_examples=20, deadline=None)
@given(shape=shapes, seed=seeds)
def test_readings_sum_to_the_pressure_integrated_over_the_contact(shape, seed):
    rng = np.random.default_rng(seed)
    sensation = rig(shape).feel(rig(shape).touch(rng), rig(shape).touch(rng))
    integrals = [_integral_over_polygons(info.contact_surface()) for info in rig(shape).contacts()]
    assert len(integrals) >= 2
    assert sensation.min() >= 0
    assert sensation.sum() == pytest.approx(sum(total for total, _ in integrals), rel=1e-9)


@settings(max_examples=20, deadline=None)
@given(shape=shapes, seed=seeds)
def test_that_pressure_makes_the_force_that_drake_applies(shape, seed):
    # Nothing moves, so there is neither friction nor dissipation.
    rig(shape).feel(rig(shape).touch(np.random.default_rng(seed)))
    (info,) = rig(shape).contacts()
    _, force = _integral_over_polygons(info.contact_surface())
    F_Ac_W = info.F_Ac_W().translational()
    scale = np.linalg.norm(F_Ac_W)
    assert scale > 0
    np.testing.assert_allclose(force, F_Ac_W, rtol=0, atol=1e-4 * scale)


@settings(max_examples=20, deadline=None)
@given(shape=shapes, seed=seeds)
def test_two_fingers_are_felt_as_the_sum_of_each_alone(shape, seed):
    rng = np.random.default_rng(seed)
    one, other = rig(shape).touch(rng), rig(shape).touch(rng)
    both = rig(shape).feel(one, other)
    alone = rig(shape).feel(one) + rig(shape).feel(other)
    np.testing.assert_allclose(both, alone, rtol=0, atol=1e-12 * alone.max())


@settings(max_examples=20, deadline=None)
@given(shape=shapes, seed=seeds)
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


@settings(max_examples=20, deadline=None)
@given(shape=shapes, seed=seeds)
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


@settings(max_examples=20, deadline=None)
@given(shape=shapes, seed=seeds)
def test_every_pressed_point_is_felt_by_three_receptors(shape, seed):
    rng = np.random.default_rng(seed)
    sensation = rig(shape).feel(rig(shape).touch(rng))
    (info,) = rig(shape).contacts()
    # The body is at the origin of the world.
    surface = info.contact_surface()
    p_BQ = np.array([surface.centroid(face) for face in range(surface.num_faces())])
    weights = rig(shape).fields.weights_at(p_BQ).toarray()
    assert (weights > 0).sum(axis=1).min() >= 3
    assert (sensation > 0).sum() >= 3


def test_opposite_walls_do_not_talk():
    # A disc so flat that fields measured through the body would reach the other side.
    disc = surfaces.cylinder(0.2, 0.07)
    flat = TouchRig(disc, _skin(disc, thickness=0.02, num_receptors=50))
    assert flat.fields.radius > 0.07
    for side in (1.0, -1.0):
        p_BF = [0.01, 0.02, side * (0.035 + TIP_RADIUS - 0.009)]
        sensation = flat.feel(RigidTransform(p_BF))
        assert sensation.sum() > 1.0
        assert (side * flat.fields.p_LS[sensation > 0][:, 2] > 0).all()


class Scale:
    """A cube with a skin on a link that moves as commanded, and a block that rests on it."""

    MASS, SIZE = 0.2, (0.08, 0.08, 0.04)

    def __init__(self, joint):
        model = _skin_of("cube")
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.004)
        covered = plant.AddRigidBody("covered", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
        world_frame, frame = plant.world_frame(), covered.body_frame()
        if joint == "weld":
            plant.WeldFrames(world_frame, frame)
        else:
            # A skin that moves has a pose of its own in the world, too.
            kind = {"rises": PrismaticJoint, "tilts": RevoluteJoint}[joint]
            axis = {"rises": [0, 0, 1.0], "tilts": [1.0, 0, 0]}[joint]
            joint = plant.AddJoint(kind("joint", world_frame, frame, np.array(axis)))
            actuator = plant.AddJointActuator("actuator", joint)
            actuator.set_controller_gains(PdControllerGains(p=1e6, d=1e4))
        worn = RegisterSkin(plant, model)
        self._block = plant.AddRigidBody(
            "block", SpatialInertia.SolidBoxWithMass(self.MASS, *self.SIZE)
        )
        shape, properties = Box(*self.SIZE), _rigid(0.1, friction=0.5)
        plant.RegisterCollisionGeometry(self._block, RigidTransform(), shape, "block", properties)
        plant.Finalize()
        self._touch = TactileSkin.AddToBuilder(builder, plant, scene_graph, [worn])
        self._source = None
        if plant.num_actuators():
            self._source = builder.AddSystem(
                TrajectorySource(PiecewisePolynomial(np.zeros((1, 1))), 1)
            )
            builder.Connect(
                self._source.get_output_port(),
                plant.get_desired_state_input_port(covered.model_instance()),
            )
        self._plant, self._fields = plant, model.fields
        self._simulator = Simulator(builder.Build())
        self.context = self._simulator.get_mutable_context()
        plant_context = plant.GetMyMutableContextFromRoot(self.context)
        plant.SetFreeBodyPose(plant_context, self._block, RigidTransform([0.03, -0.02, 0.24]))

    def follow(self, path):
        """The link follows a path of its joint."""
        self._source.UpdateTrajectory(path)
        self.context.SetTime(self.context.get_time())

    def advance_to(self, time_s):
        """Simulates on and returns the sensation."""
        self._simulator.AdvanceTo(time_s)
        touch_context = self._touch.GetMyContextFromRoot(self.context)
        return self._touch.get_output_port(0).Eval(touch_context)

    def felt_on(self, sensation):
        """`(n, 3)` m, the receptors that feel, in the frame of the link."""
        return self._fields.p_LS[sensation > 0]

    def speed(self):
        """The largest speed of any joint, rad/s or m/s."""
        plant_context = self._plant.GetMyContextFromRoot(self.context)
        return np.abs(self._plant.GetVelocities(plant_context)).max()


def test_a_resting_weight_is_felt_as_its_weight():
    scale = Scale("weld")
    sensation = scale.advance_to(1.0)
    assert scale.speed() < 1e-3
    # What is too much, 0.4 %, presses on the sides of the block, which sinks in by 0.15 mm.
    assert sensation.sum() == pytest.approx(scale.MASS * GRAVITY, rel=0.01)
    assert (scale.felt_on(sensation)[:, 2] > 0.2).all()


def test_a_weight_on_a_skin_that_rises_is_felt_as_its_weight_and_what_lifts_it():
    scale = Scale("rises")
    # At rest, then faster and faster, then at 0.5 m/s.
    rest, lift, speed = 0.7, 2.0, 0.5
    faster = speed / lift
    time_s = [0.0, rest, rest + faster, rest + faster + 1.0]
    z = [0.0, 0.0, speed * faster / 2, speed * faster / 2 + 1.0 * speed]
    v = [0.0, 0.0, speed, speed]
    path = PiecewisePolynomial.CubicHermite(time_s, np.array([z]), np.array([v]))
    scale.follow(path)
    felt = [scale.advance_to(t) for t in (rest, rest + faster - 0.05, rest + faster + 0.7)]
    expected = scale.MASS * np.array([GRAVITY, GRAVITY + lift, GRAVITY])
    assert [f.sum() for f in felt] == pytest.approx(expected, rel=0.01)
    # The cube has left the place where it was, and its frame with it.
    assert all((scale.felt_on(f)[:, 2] > 0.2).all() for f in felt)


def test_a_weight_on_a_skin_that_tilts_is_felt_as_its_weight():
    scale = Scale("tilts")
    angle = 0.3
    scale.follow(PiecewisePolynomial.FirstOrderHold([0.7, 2.7], np.array([[0.0, angle]])))
    level, tilted = scale.advance_to(0.7), scale.advance_to(2.7)
    weight = scale.MASS * GRAVITY
    assert level.sum() == pytest.approx(weight, rel=0.01)
    assert tilted.sum() == pytest.approx(weight * np.cos(angle), rel=0.01)


def test_stacked_heads_feel_what_they_bear():
    """Two heads with skins, 2 kg and 1 kg, on vertical rails over a rigid floor."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.005)
    surface = surfaces.cube(0.2, resolution=0.1)
    floor = Box(1.0, 1.0, 0.2)
    X_WF = RigidTransform([0, 0, -0.2])
    plant.RegisterCollisionGeometry(plant.world_body(), X_WF, floor, "floor", _rigid(1.0, 0.2))
    worn = []
    for name, mass, height in (("lower", 2.0, 0.001), ("upper", 1.0, 0.203)):
        head = plant.AddRigidBody(name, SpatialInertia.SolidSphereWithMass(mass, 0.1))
        rail = PrismaticJoint(name, plant.world_frame(), head.body_frame(), np.array([0, 0, 1.0]))
        plant.AddJoint(rail).set_default_translation(height)
        worn.append(RegisterSkin(plant, _skin(surface, link=name, num_receptors=60)))
    plant.Finalize()
    touch = TactileSkin.AddToBuilder(builder, plant, scene_graph, worn)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(1.0)
    context = simulator.get_context()
    touch_context = touch.GetMyContextFromRoot(context)
    lower_felt, upper_felt = (
        touch.GetOutputPort(f"{name}_sensation").Eval(touch_context) for name in ("lower", "upper")
    )
    fields = worn[0].model.fields
    top = fields.p_LS[:, 2] > 0.09
    bottom = fields.p_LS[:, 2] < -0.09
    assert upper_felt.sum() == pytest.approx(1.0 * GRAVITY, rel=0.01)
    assert upper_felt[top].sum() == 0.0
    assert lower_felt[bottom].sum() > lower_felt[top].sum() > 0.0
    # What presses from below bears both, what presses from above the upper one.
    assert lower_felt.sum() == pytest.approx((3.0 + 1.0) * GRAVITY, rel=0.01)


@pytest.fixture(scope="module")
def embracing(tmp_path_factory):
    """Two links that wear skins and are carried anywhere, and a ball on one of them."""
    arm = {"shape": "capsule", "radius": 0.05, "length": 0.1, "resolution": 0.04}
    return robots.build(
        tmp_path_factory.mktemp("embracing"),
        robots.link("base"),
        robots.carried("left"),
        robots.carried("right"),
        skins={
            "left": {"link": "left", "surface": arm, "thickness": 0.02, "num_receptors": 30},
            "right": {
                "link": "right",
                "surface": {
                    "shape": "ellipsoid",
                    "semi_axes": [0.08, 0.06, 0.1],
                    "resolution": 0.04,
                },
                "thickness": 0.02,
                "num_receptors": 50,
                "hydroelastic_modulus": 1.0e5,
            },
        },
        touching={"left": {"link": "left"}},
    )


@pytest.fixture(scope="module")
def pressed(embracing):
    """Configurations in which the two skins press each other, and what they feel."""
    robot = embracing.robot
    q = robots.anywhere(robot, 250, seed=0)
    rails = np.flatnonzero(~robot.turns)
    q[:, rails] *= 0.09 / robot.upper[rails]
    felt = embracing.probe.sensations(q)
    rows = np.flatnonzero((felt.sum(axis=1) > 1.0) & (felt.sum(axis=1) < 60.0))
    assert len(rows) > 20
    return q[rows], felt[rows]


def test_action_is_reaction_where_two_skins_press_each_other(pressed):
    _, felt = pressed
    left, right = felt[:, :30].sum(axis=1), felt[:, 30:].sum(axis=1)
    np.testing.assert_allclose(left, right, rtol=1e-9)


def test_action_is_reaction_under_dynamics(embracing, pressed):
    q, _ = pressed
    for start in q[:3]:
        simulation_of(embracing).rest_at(start)
        simulation_of(embracing).advance(0.1)
        felt = simulation_of(embracing).take_log().felt
        left, right = felt[:, :30].sum(axis=1), felt[:, 30:].sum(axis=1)
        assert left.min() > 0.1
        np.testing.assert_allclose(left, right, rtol=0.01)


def test_each_of_two_skins_says_who_presses_it(embracing, pressed):
    q = pressed[0][:10]
    touches = embracing.probe.touches(q)
    np.testing.assert_array_equal(touches.row, np.repeat(np.arange(10), 2))
    np.testing.assert_array_equal(touches.skin, np.tile([0, 1], 10))
    # There is one toucher: skins follow it.
    np.testing.assert_array_equal(touches.toucher, np.tile([1 + 1, 1 + 0], 10))
    X_WL = embracing.robot.skin_positions(q)
    p_WC = [
        np.einsum("nij,nj->ni", X_WL[:, k, :, :3], touches.p_LC[k::2]) + X_WL[:, k, :, 3]
        for k in (0, 1)
    ]
    # Both feel it at one place of the world.
    np.testing.assert_allclose(p_WC[0], p_WC[1], atol=1e-9)
