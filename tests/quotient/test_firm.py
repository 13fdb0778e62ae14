import numpy as np
from by_hand import laid_by_hand, ring_by_hand

from selftouch_drake.quotient.firm import firm_rows, goal_rows


def test_only_firm_configurations_carry():
    strength = np.ones(4)
    strength[1] = 0.1
    known = laid_by_hand([[0.0], [1.0, 5.0, 6.0]], [[0, 1]])
    object.__setattr__(known, "kernel_strength", strength)
    assert firm_rows(known, 1).tolist() == [2, 3]


def test_goal_configurations_are_near_the_target_and_not_the_lightest():
    representation = ring_by_hand(members=100)
    rows = goal_rows(representation, 3)
    members = representation.members(3)
    error, strength = representation.kernel_error, representation.kernel_strength
    assert np.all((rows >= members.start) & (rows < members.stop))
    assert error[rows].max() <= np.median(error[members])
    assert strength[rows].min() >= np.quantile(strength[members], 0.25)
    assert len(rows) > 25


def test_a_light_touch_counts_as_firm_where_there_is_none_else():
    known = laid_by_hand([[0.0, 0.1, 0.2, 0.3, 0.4, 5.0, 6.0, 0.5, 0.6], [1.0]], [[0, 1]])
    strength = np.array([3.0, 3.0, 3.0, 2.0, 2.0, 2.0, 0.1, 1.0, 0.2, 1.0])
    object.__setattr__(known, "kernel_strength", strength)
    # The strongest third, and 5.0; 6.0 is isolated too, but very light.
    assert firm_rows(known, 0).tolist() == [0, 1, 2, 5]
