"""Touchers with a surface: found where they have one, and left out where they are points."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hand_made_chains import an_arm, misfit, rolling, touches

from selftouch_drake.agent.body_model.chain import exponentials, places, turns
from selftouch_drake.agent.body_model.find import judge_part
from selftouch_drake.agent.body_model.refine import (
    equations,
    moved_by,
    refined,
    with_skin_of_now,
)
from selftouch_drake.agent.body_model.scene import Scene, Sizes, solution_places
from selftouch_drake.agent.body_model.sizes import (
    carried_over,
    outward_normals,
    sized,
    with_sizes,
)
from selftouch_drake.agent.body_model.standard_errors import covariance, gauge
from selftouch_drake.agent.body_model.support import (
    beside,
    blended_normals,
    bulge,
    bulge_slopes,
    shape_moved,
)
from selftouch_drake.agent.body_model.who_touched import settled, started

WAY = tuple((joint, 1) for joint in range(6))
SHAPE = np.array([0.24, -0.18, 0.09, 0.15, -0.12])


def a_scene(shape=SHAPE, number=3000, joints=6):
    twists, point = an_arm(joints=joints)
    if shape is None:
        q, target, y = touches(twists, point, number=number)
    else:
        q, target, y = rolling(twists, point, shape, number=number)
    scene = Scene(q, target, np.zeros(target.max() + 1, dtype=int), {(0, 0): WAY[:joints]})
    return scene, twists, point[None], y


def test_turns_are_the_derivatives_of_places_by_the_point():
    twists, point = an_arm(slides=(2,))
    q = np.random.default_rng(0).normal(size=(20, 4))
    signs = np.array([1.0, -1.0, 1.0, -1.0])
    step = np.array([0.3, -0.1, 0.2])
    moved = places(q, twists, point + step, signs) - places(q, twists, point, signs)
    assert turns(q, twists, signs) @ step == pytest.approx(moved)
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
    half = np.array([[1.1 * np.cos(0.55), 1.1 * np.sin(0.55), 0.0]])
    for number, sign in ((0, 1), (1, -1)):
        own = np.where((part == number)[:, None], place, np.nan)
        found = blended_normals(own, normal, near, half)
        assert found[0] == pytest.approx(sign * half[0] / 1.1, abs=0.05)
    lonely = beside(place[:1], part[:1])
    alone = blended_normals(place[:1], normal[:1], lonely, np.array([*half, [np.nan] * 3]))
    assert alone[0] == pytest.approx(normal[0])
    assert np.isnan(alone[1]).all()


def test_normals_look_to_where_the_skin_bulges():
    scene, twists, points, y = a_scene(None)
    solution = started(scene, twists, points)
    centre = np.linalg.lstsq(np.c_[2 * y, np.ones(len(y))], (y**2).sum(axis=1), rcond=None)[0][:3]
    outward = solution.place - centre
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    turned = np.where(np.arange(len(outward)) % 2 > 0, 1, -1)[:, None] * solution.normal
    found = outward_normals(scene, replace(solution, normal=turned))
    assert np.einsum("ka,ka->k", found, outward).min() > 0.8


def test_a_kernel_without_a_normal_stays_without_and_harms_no_other():
    scene, twists, points, _ = a_scene(None)
    solution = started(scene, twists, points)
    all_known = outward_normals(scene, solution)
    normal = solution.normal.copy()
    normal[[0, 70]] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = outward_normals(scene, replace(solution, normal=normal))
    assert np.flatnonzero(np.isnan(found).any(axis=1)).tolist() == [0, 70]
    known = np.isfinite(found)
    assert np.array_equal(found[known], all_known[known])


def test_normals_of_a_flat_skin_look_to_the_link_of_the_toucher():
    # A finger of length 2 turns about the z axis, over a board that slides below it.
    slide = [[0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0]]
    twists = np.array([*slide, [1, 0, 0, 0, 2, 0], [0, 1, 0, -2, 0, 0]], dtype=float)
    random = np.random.default_rng(0)
    q = np.c_[random.uniform(-3, 3, (2000, 2)), random.uniform(-0.2, 0.2, (2000, 2))]
    point = np.zeros((1, 3))
    y = places(q, twists, point[0])
    target = np.floor(y[:, 0] + 4).astype(int) * 8 + np.floor(y[:, 1] + 4).astype(int)
    scene = Scene(q, target, np.zeros(64, dtype=int), {(0, 0): WAY[:4]})
    found = outward_normals(scene, started(scene, twists, point))
    known = np.isfinite(found).all(axis=1)
    assert known.sum() > 30
    assert (found[known, 2] > 0.5).all()


def test_the_gradient_by_a_shape_is_that_of_finite_differences():
    scene, twists, points, _ = a_scene()
    solution = sized(scene, started(scene, twists, points))
    solution = replace(solution, share=np.ones_like(solution.share))
    solution = settled(scene, solution, solution_places(scene, solution))
    found = equations(scene, solution)
    assert len(found.gradient) == 44

    def criterion(step):
        moved = moved_by(solution, step)
        return settled(scene, moved, solution_places(scene, moved)).criterion[0]

    for entry in (0, 9, 37, *range(39, 44)):
        step = np.zeros(44)
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

    for direction in gauge(before.twists, before.points, before.sizes.shape).T:
        assert abs(criterion(1e-4 * direction) - criterion(-1e-4 * direction)) < 1e-5


def halves(scene):
    """Training touches and held-out touches."""
    number = len(scene.q)
    return scene.some(np.arange(number - 400)), scene.some(np.arange(number - 400, number))


def test_a_fist_is_found():
    scene, twists, points, y = a_scene()
    train, tests = halves(scene)
    start = refined(train, started(train, twists, points))
    found = with_sizes(train, tests, start, np.random.default_rng(0))
    assert found.sizes is not None
    assert np.linalg.norm(found.sizes.shape) > 0.1
    whole = carried_over(scene, found)
    as_point = misfit(solution_places(scene, carried_over(scene, start))[0], y)
    assert misfit(solution_places(scene, whole)[0], y) < 0.35 * as_point


def test_a_fist_is_judged_with_its_surface():
    scene, twists, points, _ = a_scene()
    train, tests = halves(scene)
    as_point = started(train, twists, points)
    sizes = replace(sized(train, as_point).sizes, shape=SHAPE[None])
    as_fist = with_skin_of_now(train, replace(as_point, sizes=sizes))
    point, fist = (judge_part(train, tests, one, 0) for one in (as_point, as_fist))
    assert fist.near > point.near + 0.05
    assert fist.criterion < point.criterion - 1


def test_what_a_fit_holds_has_no_standard_error_and_a_shape_has_one():
    scene, twists, points, _ = a_scene()
    start = started(scene, twists, points)
    fixed = np.zeros(39, dtype=bool)
    fixed[6:9] = True
    solution = refined(scene, sized(scene, start), steps=3, fixed=fixed)
    assert np.array_equal(solution.twists[1, :3], twists[1, :3])
    assert solution.sizes.shape.any()
    variance = np.diag(covariance(scene, solution, fixed=fixed))
    assert len(variance) == 44
    assert np.flatnonzero(np.isnan(variance)).tolist() == [6, 7, 8]
    assert (variance[39:] > 0).all()


def test_a_point_stays_a_point():
    scene, twists, points, _ = a_scene(None)
    train, tests = halves(scene)
    start = refined(train, started(train, twists, points))
    assert with_sizes(train, tests, start, np.random.default_rng(0)) is start


def test_four_joints_tell_no_size():
    scene, twists, points, _ = a_scene(None, joints=4)
    train, tests = halves(scene)
    start = refined(train, started(train, twists, points))
    assert with_sizes(train, tests, start, np.random.default_rng(0)) is start
    # Without that rule it would have one.
    trial = refined(train, sized(train, start))
    assert trial.criterion[0] < start.criterion[0] - 0.1


def test_of_a_fist_and_a_fingertip_only_the_fist_has_a_shape():
    fist, twists, points, _ = a_scene()
    tip, _, _, _ = a_scene(None)
    # Two arms alike, each with a skin of its own.
    q = np.zeros((len(fist.q) + len(tip.q), 12))
    q[: len(fist.q), :6], q[len(fist.q) :, 6:] = fist.q, tip.q
    target = np.r_[fist.target, tip.target + len(fist.part)]
    part = np.repeat([0, 1], [len(fist.part), len(tip.part)])
    ways = {(0, 0): WAY, (1, 1): tuple((joint + 6, 1) for joint in range(6))}
    scene = Scene(q, target, part, ways)
    rows = np.random.default_rng(0).permutation(len(q))
    train, tests = scene.some(np.sort(rows[800:])), scene.some(np.sort(rows[:800]))
    start = started(train, np.concatenate([twists, twists]), np.concatenate([points, points]))
    start = refined(train, start)
    found = with_sizes(train, tests, start, np.random.default_rng(0))
    assert found.sizes.sized.tolist() == [True, False]
    assert found.sizes.shape[0].any()
    assert not found.sizes.shape[1].any()
