"""The least-squares finish: its gradient, its gauge, and touchers that touch nothing."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_chains import an_arm, misfit, touches

from selftouch_drake.agent.body_model.chain import places
from selftouch_drake.agent.body_model.refine import equations, moved_by, refined
from selftouch_drake.agent.body_model.scene import Scene, all_places
from selftouch_drake.agent.body_model.standard_errors import as_if_true, covariance, gauge
from selftouch_drake.agent.body_model.who_touched import settled, started

WAY = tuple((joint, 1) for joint in range(4))


def a_scene(number=3000, kernels=150):
    twists, point = an_arm()
    q, target, y = touches(twists, point, number=number, kernels=kernels)
    scene = Scene(q, target, np.zeros(target.max() + 1, dtype=int), {(0, 0): WAY})
    return scene, twists, point[None], y


def test_a_bent_chain_is_straightened():
    scene, twists, points, y = a_scene()
    random = np.random.default_rng(2)
    bent = twists + 0.03 * random.standard_normal(twists.shape)
    before = misfit(places(scene.q, bent, points[0]), y)
    solution = refined(scene, started(scene, bent, points))
    after = misfit(places(scene.q, solution.twists, solution.points[0]), y)
    assert before > 1.0
    assert after < 0.5 * before


def test_the_gradient_is_that_of_finite_differences_and_blind_to_the_gauge():
    scene, twists, points, _ = a_scene()
    random = np.random.default_rng(2)
    solution = started(scene, twists + 0.02 * random.standard_normal(twists.shape), points)
    # Places and noise at fixed shares and normals, as the equations take them.
    share = np.ones_like(solution.share)
    solution = settled(
        scene, replace(solution, share=share), all_places(scene, solution.twists, points)
    )
    found = equations(scene, solution)

    def criterion(step, fresh_normals=False):
        moved = moved_by(solution, step)
        Y = all_places(scene, moved.twists, moved.points)
        return settled(scene, moved, Y, fresh_normals=fresh_normals).criterion[0]

    for entry in range(0, 27, 2):
        step = np.zeros(27)
        step[entry] = 1e-5
        slope = (criterion(step) - criterion(-step)) / 2e-5
        assert found.gradient[entry] == pytest.approx(slope, rel=1e-3, abs=1e-3)
    for direction in gauge(solution.twists, solution.points).T:
        # Normals turn with the whole.
        change = criterion(1e-5 * direction, True) - criterion(-1e-5 * direction, True)
        assert abs(change / 2e-5) < 1e-3


def test_standard_errors_shrink_with_more_touches_of_smaller_kernels():
    # With more touches of the same kernels the error that their size makes would stay.
    sizes = {}
    for number in (1500, 6000):
        scene, twists, points, _ = a_scene(number, kernels=number // 15)
        solution = refined(scene, started(scene, twists, points))
        sizes[number] = np.sqrt(np.diag(covariance(scene, solution))[:24]).mean()
    assert sizes[6000] < 0.8 * sizes[1500]


def test_standard_errors_count_the_size_of_kernels():
    scene, twists, points, _ = a_scene(6000)
    solution = refined(scene, started(scene, twists, points))
    Y = all_places(scene, solution.twists, solution.points)
    again = as_if_true(scene, solution, Y)
    # Most touches lie at their own kernel; the others lie beside its border.
    assert 0.6 < (again.target == scene.target).mean() < 1.0
    found = np.sqrt(np.diag(covariance(scene, solution)))
    moved = refined(again, solution)
    error = np.r_[moved.twists.ravel(), moved.points.ravel()]
    error -= np.r_[solution.twists.ravel(), solution.points.ravel()]
    # A similarity changes nothing.
    directions = gauge(solution.twists, solution.points)
    error -= directions @ (directions.T @ error)
    assert (np.abs(error) < 2 * found).mean() > 0.9
    # Held parameters have none.
    fixed = np.zeros(27, dtype=bool)
    fixed[:3] = True
    held = np.diag(covariance(scene, solution, fixed=fixed))
    assert np.isnan(held).tolist() == fixed.tolist()


def test_a_toucher_that_touches_nothing_and_a_part_without_touches_do_no_harm():
    scene, twists, points, y = a_scene()
    far = np.concatenate([points, points + 40])
    part = np.r_[scene.part, 1]
    scene = replace(scene, part=part, ways={(0, 0): WAY, (0, 1): WAY, (1, 0): WAY})
    with np.errstate(all="raise", under="ignore"):
        solution = refined(scene, started(scene, twists, far), steps=3)
    assert solution.frequency[0, 0] > 0.95
    assert misfit(all_places(scene, solution.twists, solution.points)[0], y) < 1.0
