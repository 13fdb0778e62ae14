import numpy as np
import pytest
from pydrake.math import BsplineBasis
from pydrake.multibody.optimization import Toppra
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia
from pydrake.trajectories import BsplineTrajectory
from scipy.interpolate import BSpline

from selftouch_drake.agent.planning.fastest import fastest_progress
from selftouch_drake.quotient.smooth import smooth_path

VELOCITY = np.array([1.0, 1.5, 2.0])
ACCELERATION = np.array([4.0, 5.0, 6.0])
LIMITS = {"velocity_limit": VELOCITY, "acceleration_limit": ACCELERATION}


def random_path(seed, num_waypoints, step):
    rng = np.random.default_rng(seed)
    return smooth_path(np.cumsum(step * rng.normal(size=(num_waypoints, 3)), axis=0))


def grid(path, spacing=0.03):
    length = path.t[-1] - path.t[0]
    return np.linspace(path.t[0], path.t[-1], max(20, int(np.ceil(length / spacing))))


def toppra_duration(path):
    """s, duration by Drake's Toppra for a chain of joints."""
    plant = MultibodyPlant(0.0)
    parent = plant.world_body()
    for joint in range(3):
        body = plant.AddRigidBody(f"link_{joint}", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
        frames = parent.body_frame(), body.body_frame()
        plant.AddJoint(RevoluteJoint(f"joint_{joint}", *frames, np.array([0.0, 0.0, 1.0])))
        parent = body
    plant.Finalize()
    basis = BsplineBasis(path.k + 1, path.t.tolist())
    drake_path = BsplineTrajectory(basis, [point[:, None] for point in path.c])
    toppra = Toppra(drake_path, plant, grid(path, 0.01))
    toppra.AddJointVelocityLimit(-VELOCITY, VELOCITY)
    toppra.AddJointAccelerationLimit(-ACCELERATION, ACCELERATION)
    return toppra.SolvePathParameterization().end_time()


@pytest.mark.parametrize("seed", range(12))
def test_it_is_as_fast_as_toppra(seed):
    path = random_path(seed, 2 + 3 * seed, 0.3)
    found = fastest_progress(path, grid(path, 0.01), **LIMITS)
    assert found.x[-1] == pytest.approx(toppra_duration(path), rel=0.02)


@pytest.mark.parametrize("step", [0.003, 0.05, 0.5])
@pytest.mark.parametrize("num_waypoints", [2, 3, 5, 20])
def test_it_keeps_the_limits_at_the_grid(num_waypoints, step):
    path = random_path(7, num_waypoints, step)
    points = grid(path)
    found = fastest_progress(path, points, **LIMITS)
    assert found(found.x) == pytest.approx(points)
    assert found(found.x[[0, -1]], 1) == pytest.approx([0.0, 0.0], abs=1e-7)
    slope, bend = path(points, 1), path(points, 2)
    speed = found(found.x, 1)[:, None]
    assert (np.abs(slope * speed) <= VELOCITY * (1 + 1e-6)).all()
    for end in (slice(None, -1), slice(1, None)):
        acceleration = slope[end] * 2 * found.c[0][:, None] + bend[end] * speed[end] ** 2
        assert (np.abs(acceleration) <= ACCELERATION * (1 + 1e-6)).all()


def test_something_is_always_at_its_limit():
    path = random_path(3, 10, 0.3)
    points = grid(path)
    found = fastest_progress(path, points, **LIMITS)
    speed = found(found.x, 1)[:, None]
    slope, bend = path(points, 1), path(points, 2)
    fast = (np.abs(slope * speed) / VELOCITY).max(axis=1)
    hard = np.zeros(len(points))
    for end in (slice(None, -1), slice(1, None)):
        acceleration = slope[end] * 2 * found.c[0][:, None] + bend[end] * speed[end] ** 2
        share = (np.abs(acceleration) / ACCELERATION).max(axis=1)
        hard[:-1] = np.maximum(hard[:-1], share)
    assert (np.maximum(np.maximum(fast[:-1], fast[1:]), hard[:-1]) > 0.999).mean() > 0.95


def test_where_nothing_moves_there_is_none():
    path = BSpline(np.repeat([0.0, 1.0], 6), np.zeros((6, 3)), 5)
    assert fastest_progress(path, np.linspace(0.0, 1.0, 20), **LIMITS) is None
