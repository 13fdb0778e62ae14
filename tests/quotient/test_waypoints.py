from itertools import product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from selftouch_drake.quotient.waypoints import smoothest_configurations


def cost(waypoints):
    return np.sum(np.linalg.norm(np.diff(waypoints, axis=0), axis=1) ** 3)


@settings(deadline=None)
@given(seed=st.integers(0, 10**6), sizes=st.lists(st.integers(1, 4), min_size=1, max_size=5))
def test_no_other_choice_has_smaller_cubed_steps(seed, sizes):
    rng = np.random.default_rng(seed)
    layers = [rng.normal(size=(n, 3)) for n in sizes]
    least = min(cost(np.stack(choice)) for choice in product(*layers))
    chosen = smoothest_configurations(layers)
    assert chosen.shape == (len(sizes), 3)
    assert np.isclose(cost(chosen), least)


def test_one_long_step_is_worse_than_two_of_half_its_length():
    layers = [np.array([[0.0]]), np.array([[0.1], [2.0]]), np.array([[4.0]])]
    assert smoothest_configurations(layers).ravel().tolist() == [0.0, 2.0, 4.0]
