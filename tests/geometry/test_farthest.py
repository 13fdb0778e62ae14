import subprocess
import sys

import numpy as np
import pytest

from selftouch_drake.geometry.farthest import farthest_points


def _on_line(x):
    return lambda point: np.abs(x - x[point])


def test_by_hand():
    x = np.array([0.0, 1.0, 4.0, 10.0])
    assert farthest_points(_on_line(x), 4).tolist() == [0, 3, 2, 1]
    assert farthest_points(_on_line(x), 2, first=2).tolist() == [2, 3]
    assert farthest_points(_on_line(x), 9).tolist() == [0, 3, 2, 1]


def test_where_the_weight_is_small_points_are_picked_later():
    x = np.array([0.0, 1.0, 4.0, 10.0])
    weight = np.array([1.0, 1.0, 1.0, 0.1])
    assert farthest_points(_on_line(x), 4, weight=weight).tolist() == [0, 2, 1, 3]


def test_stops_where_all_is_near():
    x = np.array([0.0, 0.0, 4.0, 4.1])
    assert farthest_points(_on_line(x), 4, least=1e-6).tolist() == [0, 3, 2]
    assert farthest_points(_on_line(x), 4, least=1.0).tolist() == [0, 3]


def test_parts_that_are_not_joined_come_first():
    distance = np.array([[0, 1, np.inf], [1, 0, np.inf], [np.inf, np.inf, 0]])
    assert farthest_points(lambda point: distance[point], 3).tolist() == [0, 2, 1]


def test_the_distances_of_the_caller_are_left_alone():
    distance = np.abs(np.subtract.outer(np.arange(5.0), np.arange(5.0)))
    before = distance.copy()
    farthest_points(lambda point: distance[point], 5)
    np.testing.assert_array_equal(distance, before)


def _reference(distance_from, num_points, least=-np.inf):
    """The definition: each point is the first that is farthest from all picked before."""
    picked = [0]
    while len(picked) < num_points:
        nearest = np.min([distance_from(point) for point in picked], axis=0)
        if nearest.max() < least:
            break
        picked.append(int(nearest.argmax()))
    return picked


@pytest.mark.parametrize("seed", range(3))
def test_each_use_gives_the_points_of_the_definition(seed):
    rows = np.random.default_rng(seed).standard_normal((200, 6)).astype(np.float32)
    unit = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    unit[100:] = unit[:100]  # Rows that are equal end the sampling of sensations.

    def squared(point):
        return 2.0 - 2.0 * (unit @ unit[point])

    def euclidean(point):
        return np.linalg.norm(rows - rows[point], axis=1)

    found = farthest_points(squared, 150, least=1e-6)
    assert found.tolist() == _reference(squared, 150, least=1e-6)
    assert len(found) == 100
    assert farthest_points(euclidean, 30).tolist() == _reference(euclidean, 30)


def test_the_module_needs_numpy_only():
    import selftouch_drake.geometry.farthest as module

    code = (
        "import sys, numpy; before = set(sys.modules)\n"
        f"exec(open({module.__file__!r}).read())\n"
        "print(*sorted({name.split('.')[0] for name in set(sys.modules) - before}))"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert set(found) <= set(sys.stdlib_module_names) | {"numpy"}
