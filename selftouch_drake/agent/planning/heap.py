"""A queue of places by cost, compiled for use in searches.

numba's `heapq` compares tuples, which takes three times as long.
"""

from __future__ import annotations

from numba import njit

# Children per entry: with four, taking out moves half as many entries as with two.
_WIDTH = 4

# These are not cached: the functions that call them keep them.


@njit
def push(costs, places, size, cost, place):
    """Adds an entry to the `size` entries of a heap; returns their new number."""
    at = size
    while at > 0:
        above = (at - 1) // _WIDTH
        if costs[above] <= cost:
            break
        costs[at], places[at] = costs[above], places[above]
        at = above
    costs[at], places[at] = cost, place
    return size + 1


@njit
def drop(costs, places, size):
    """Takes out entry 0, the cheapest, of the `size` entries of a heap; returns their new number.

    Entry 0 is the cheapest of the rest then.
    """
    size -= 1
    cost, place, at = costs[size], places[size], 0
    while True:
        first = _WIDTH * at + 1
        if first >= size:
            break
        least = first
        for child in range(first + 1, min(first + _WIDTH, size)):
            if costs[child] < costs[least]:
                least = child
        if costs[least] >= cost:
            break
        costs[at], places[at] = costs[least], places[least]
        at = least
    costs[at], places[at] = cost, place
    return size
