import numpy as np
from numba import njit

from selftouch_drake.agent.planning.heap import drop, push


@njit
def in_order(given):
    """The places in the order in which a heap gives them out, half of them while it is filled."""
    costs, places = np.empty(len(given)), np.empty(len(given), dtype=np.int32)
    out, size = np.empty(len(given), dtype=np.int64), 0
    num = 0
    for place in range(len(given)):
        size = push(costs, places, size, given[place], place)
        if place % 2:
            out[num] = places[0]
            num += 1
            size = drop(costs, places, size)
    while size > 0:
        out[num] = places[0]
        num += 1
        size = drop(costs, places, size)
    return out


def test_the_cheapest_place_comes_first():
    given = np.random.default_rng(0).random(500)
    expected, waiting = [], []
    for place in range(500):
        waiting.append(place)
        if place % 2:
            expected.append(min(waiting, key=lambda k: given[k]))
            waiting.remove(expected[-1])
    expected += sorted(waiting, key=lambda k: given[k])
    assert in_order(given).tolist() == expected
