"""Touchers with a surface: found where they have one, and left out where they are points."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_chains import an_arm, misfit, rolling, touches

from selftouch_drake.agent.body_model.chain import exponentials, places, turns
from selftouch_drake.agent.body_model.refine import (
    Scene,
    Sizes,
    equations,
    gauge,
    moved_by,
    refined,
    settled,
    solution_places,
    started,
    with_skin_of_now,
)
from selftouch_drake.agent.body_model.sizes import (
    carried_over,
    outward_normals,
    sized,
    with_sizes,
)
from selftouch_drake.agent.body_model.support import (
    SHAPE_BASIS,
    beside,
    blended_normals,
    bulge,
    bulge_slopes,
    shape_moved,
)

WAY = tuple((joint, 1) for joint in range(4))
SHAPE = np.array([0.12, -0.1, 0.05, 0.08, -0.06])


def a_scene(shape=SHAPE, number=3000):
    twists, point = an_arm()
    if shape is None:
        q, target, y = touches(twists, point, number=number)
    else:
        q, target, y = rolling(twists, point, shape, number=number)
    scene = Scene(q, target, np.zeros(target.max() + 1, dtype=int), {(0, 0): WAY})
    return scene, twists, point[None], y


def test_turns_are_the_derivatives_of_places_by_the_point():
    twists, point = an_arm(slides=(2,))
    q = np.random.default_rng(0).normal(size=(20, 4))
    signs = np.array([1.0, -1.0, 1.0, -1.0])
    moved = places(q, twists, point + [0.3, -0.1, 0.2], signs) - places(q, twists, point, signs)
    assert turns(q, twists, signs) @ [0.3, -0.1, 0.2] == pytest.approx(moved)
    each = np.random.default_rng(1).normal(size=(20, 3))
    alone = [places(q[i : i + 1], twists, each[i])[0] for i in range(20)]
    assert places(q, twists, each) == pytest.approx(np.array(alone), abs=1e-15)


def test_a_bulge_is_linear_in_the_shape_and_turns_with_it():
    u = np.random.default_rng(0).normal(size=(30, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    assert bulge_slopes(u) @ SHAPE == pytest.approx(bulge(SHAPE, u))
    motion = exponentials(np.array([0.5, -1.0, 0.3, 2.0, 0.0, 1.0]))[0]
    motion[:3, :3] *= 2.5
    for mirror in (1.0, -1.0):
        motion[:3, 0] *= mirror
        turned = bulge(shape_moved(motion, SHAPE), u @ motion[:3, :3].T / 2.5)
        assert turned == pytest.approx(bulge(SHAPE, u) @ motion[:3, :3].T)


def test_normals_are_blended_between_kernels_of_a_part():
    angle = np.arange(40) * 2 * np.pi / 40
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    place = np.concatenate([ring, ring])
    normal = np.concatenate([ring, -ring])
    normal[3] = np.nan
    part = np.repeat([0, 1], 40)
    near = beside(place, part)
    assert (part[near[:40]] == 0).all()
    assert (near[:, 0] == np.arange(80)).all()
    half = np.array([[np.cos(0.5), np.sin(0.5), 0.0]])
    for target, sign in ((0, 1), (5, 1), (43, -1)):
        found = blended_normals(place, normal, near, np.array([target]), half)
        tolerance = 0.02 if target == 43 else 0.45
        assert found[0] == pytest.approx(sign * half[0], abs=tolerance)
    lonely = beside(place[:1], part[:1])
    alone = blended_normals(place[:1], normal[:1], lonely, np.array([0]), half)
    assert alone[0] == pytest.approx(normal[0])


def test_normals_look_to_where_the_toucher_comes_from():
    scene, twists, points, y = a_scene(None)
    solution = started(scene, twists, points)
    centre = np.linalg.lstsq(np.c_[2 * y, np.ones(len(y))], (y**2).sum(axis=1), rcond=None)[0][:3]
    outward = solution.place - centre
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    along = np.einsum("ka,ka->k", outward_normals(scene, solution), outward)
    # The touches of this arm come from both sides: most agree on one.
    assert np.abs(np.sign(along).mean()) > 0.5


def test_the_gradient_by_a_shape_is_that_of_finite_differences():
    scene, twists, points, _ = a_scene()
    solution = sized(scene, started(scene, twists, points))
    solution = replace(solution, share=np.ones_like(solution.share))
    solution = settled(scene, solution, solution_places(scene, solution))
    found = equations(scene, solution)
    assert len(found.gradient) == 32

    def criterion(step):
        moved = moved_by(solution, step)
        return settled(scene, moved, solution_places(scene, moved)).criterion[0]

    for entry in (0, 9, 25, *range(27, 32)):
        step = np.zeros(32)
        step[entry] = 1e-5
        slope = (criterion(step) - criterion(-step)) / 2e-5
        assert found.gradient[entry] == pytest.approx(slope, rel=2e-3, abs=2e-3)


def test_the_gauge_turns_a_shape_as_well():
    scene, twists, points, _ = a_scene()
    solution = sized(scene, started(scene, twists, points))
    sizes = replace(solution.sizes, shape=SHAPE[None])
    before = with_skin_of_now(scene, replace(solution, sizes=sizes))

    def criterion(step):
        moved = with_skin_of_now(scene, moved_by(before, step))
        moved = started(scene, moved.twists, moved.points)
        normal = outward_normals(scene, moved)
        shape = moved_by(before, step).sizes.shape
        sizes = Sizes.of(shape, before.sizes.sized, moved.place, normal, scene.part)
        return with_skin_of_now(scene, replace(moved, sizes=sizes)).criterion[0]

    for direction in gauge(before).T:
        assert abs(criterion(1e-4 * direction) - criterion(-1e-4 * direction)) < 1e-5


def test_a_fist_is_found():
    scene, twists, points, y = a_scene()
    train, tests = scene.some(np.arange(2600)), scene.some(np.arange(2600, 3000))
    start = refined(train, started(train, twists, points))
    random = np.random.default_rng(0)
    found = with_sizes(train, tests, start, random)
    assert found.sizes is not None
    whole = carried_over(scene, found)
    as_point = misfit(solution_places(scene, carried_over(scene, start))[0], y)
    assert misfit(solution_places(scene, whole)[0], y) < 0.35 * as_point
    # Up to the gauge, which turns and scales it, the spread of the shape is known.
    B = np.tensordot(whole.sizes.shape[0], SHAPE_BASIS, axes=1)
    true = np.tensordot(SHAPE, SHAPE_BASIS, axes=1)
    values, wanted = np.linalg.eigvalsh(B), np.linalg.eigvalsh(true)
    size = np.linalg.norm(whole.place.std(axis=0)) / np.linalg.norm(y.std(axis=0))
    assert values / size == pytest.approx(wanted, abs=0.03)


def test_a_point_stays_a_point():
    scene, twists, points, _ = a_scene(None)
    train, tests = scene.some(np.arange(2600)), scene.some(np.arange(2600, 3000))
    start = refined(train, started(train, twists, points))
    found = with_sizes(train, tests, start, np.random.default_rng(0))
    assert found.sizes is None
    assert found is start
