"""What kernels feel tells where they are not."""

from dataclasses import replace

import numpy as np
from test_grow import two_arms_on_a_neck, what_is_felt

from selftouch_drake.agent.body_model.alike import Alike
from selftouch_drake.agent.body_model.fit import chain_way
from selftouch_drake.agent.body_model.scene import neighbour_distance
from selftouch_drake.agent.body_model.who_touched import started


def a_solution():
    """A scene of two hands that are no points, its solution, and which kernels feel alike."""
    scene, _, twists, points, y = two_arms_on_a_neck(points_of_a_hand=3)
    arms = [chain_way([0, 1, 2, 3, 4]), chain_way([0, 1, 5, 6, 7])]
    scene = replace(scene, ways={(0, toucher): arms[toucher // 3] for toucher in range(6)})
    alike = Alike.of(what_is_felt(y), scene.target, scene.part)
    return scene, started(scene, twists, points), alike


def test_kernels_at_their_places_are_left_there():
    scene, solution, alike = a_solution()
    assert not alike.misplaced(solution.place).any()
    assert np.array_equal(alike.mended(scene, solution).place, solution.place)
    assert np.array_equal(alike.without_misplaced(scene, solution).share, solution.share)


def test_kernels_elsewhere_are_named_and_brought_back():
    scene, solution, alike = a_solution()
    # On the other side of the ball, and beyond.
    lost = solution.place.copy()
    lost[[5, 17, 40]] += 3 * (solution.place.mean(axis=0) - lost[[5, 17, 40]])
    wrong = replace(solution, place=lost)
    assert list(np.flatnonzero(alike.misplaced(lost))) == [5, 17, 40]
    mended = alike.mended(scene, wrong)
    spacing = neighbour_distance(solution.place)
    assert np.linalg.norm(mended.place - solution.place, axis=1).max() < spacing
    given_up = alike.without_misplaced(scene, wrong)
    assert np.linalg.norm(given_up.place - solution.place, axis=1).max() < 2 * spacing
    assert set(scene.target[given_up.share.sum(axis=1) == 0]) >= {5, 17, 40}


def test_sensations_that_share_nothing_say_nothing():
    scene, solution, _ = a_solution()
    alone = np.zeros((len(scene.target), len(scene.part)))
    alone[np.arange(len(alone)), scene.target] = 1.0
    assert not Alike.of(alone, scene.target, scene.part).misplaced(solution.place).any()
