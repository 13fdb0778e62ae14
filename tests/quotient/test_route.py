from functools import partial
from itertools import pairwise

import by_hand
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from selftouch_drake.quotient import Representation
from selftouch_drake.quotient.firm import firm_rows, goal_rows
from selftouch_drake.quotient.kernels import KernelSets
from selftouch_drake.quotient.route import Query, RouteGraph, carried_route

laid_by_hand = partial(by_hand.laid_by_hand, kind=Representation)
make_ring = partial(by_hand.ring_by_hand, kind=Representation)


def graph_of(representation):
    """Its edges and the firm configurations of its kernels."""
    rows = [firm_rows(representation, k) for k in range(representation.num_targets)]
    x = representation.scaled(representation.kernel_q[np.concatenate(rows)]).astype(np.float32)
    firm = KernelSets(x, np.cumsum([0, *map(len, rows)]))
    return RouteGraph.of(firm, representation.edges)


def route(representation, q_start, start, goal, penalty=None):
    goal_q = representation.kernel_q[goal_rows(representation, goal)]
    penalty = np.ones(len(representation.edges)) if penalty is None else penalty
    query = Query(start, np.atleast_1d(q_start), goal, goal_q)
    return short_for_joints(graph_of(representation), query, penalty)


def short_for_joints(graph, query, penalty):
    """The route with the shortest motion of the joints: the body's length costs nothing."""
    return carried_route(graph, query, penalty, np.zeros(len(penalty)), power=1.5).tolist()


# Kernel 0 holds 0.0 (arm up) and 9.0 (arm down); kernel 1 is near the first, 2 near the second.
FORK = laid_by_hand([[0.0, 9.0], [1.0], [8.0], [4.5]], [[0, 1], [0, 2], [1, 3], [2, 3]])


@pytest.mark.parametrize(("q_start", "through"), [(0.0, 1), (9.0, 2)])
def test_the_route_depends_on_where_the_arm_is(q_start, through):
    assert route(FORK, q_start, 0, 3) == [0, through, 3]


def test_a_step_starts_from_the_configuration_that_was_carried_there():
    # Kernel 1 reaches 2 from its member 10.0, but the arm enters it at 1.0.
    line = laid_by_hand(
        [[0.0], [1.0, 10.0], [10.5], [3.0], [6.0]],
        [[0, 1], [1, 2], [0, 3], [3, 4], [2, 4]],
    )
    assert route(line, 0.0, 0, 2) == [0, 3, 4, 2]


def test_two_short_steps_are_preferred_to_a_long_one():
    detour = laid_by_hand([[0.0], [1.0], [2.0]], [[0, 1], [0, 2], [1, 2]])
    assert route(detour, 0.0, 0, 2) == [0, 1, 2]


def test_the_goal_is_entered_by_its_goal_configurations_alone():
    square = laid_by_hand([[0.0], [1.0], [3.0], [0.5, 2.9]], [[0, 1], [0, 2], [1, 3], [2, 3]])
    graph = graph_of(square)
    for at, found in ((0.5, [0, 1, 3]), (4.9, [0, 2, 3])):
        query = Query(0, np.zeros(1), 3, np.array([[at]]))
        assert short_for_joints(graph, query, np.ones(4)) == found


def test_a_penalty_turns_the_route_the_other_way_round():
    ring = make_ring(8)
    q_start = ring.kernel_q[0]
    assert route(ring, q_start, 0, 3) == [0, 1, 2, 3]
    penalty = np.where((ring.edges == [1, 2]).all(axis=1), 1000.0, 1.0)
    assert route(ring, q_start, 0, 3, penalty=penalty) == [0, 7, 6, 5, 4, 3]


def test_a_route_that_prefers_the_body_is_short_on_it_and_takes_no_long_step():
    # From 0 to 5, four small steps of the joints lead a long way round, and two larger ones lead
    # straight there. Most steps of this body are larger still.
    edges = [[0, 1], [0, 4], [1, 2], [2, 3], [3, 5], [4, 5], *([k, k + 1] for k in range(5, 12))]
    beyond = [[2.4 + 1.5 * k] for k in range(8)]
    for wide, way in ((1.2, [0, 4, 5]), (4.0, [0, 1, 2, 3, 5])):
        known = laid_by_hand([[0.0], [0.6], [1.2], [1.8], [wide], *beyond], edges)
        graph, query = graph_of(known), Query(0, np.zeros(1), 5, np.array([[2.4]]))
        assert short_for_joints(graph, query, np.ones(13)) == [0, 1, 2, 3, 5]
        price = graph.step_price(np.ones(13))
        assert carried_route(graph, query, price, np.ones(13)).tolist() == way


def test_no_route_between_parts_of_a_graph():
    apart = laid_by_hand([[0.0], [1.0], [2.0]], [[0, 1]])
    assert route(apart, 0.0, 0, 2) == []


@settings(deadline=None)
@given(seed=st.integers(0, 1000), start=st.integers(0, 7), goal=st.integers(0, 7))
def test_routes_follow_edges_from_start_to_goal(seed, start, goal):
    representation = make_ring(8, seed=seed)
    nodes = route(representation, representation.kernel_q[6 * start], start, goal)
    edges = {tuple(e) for e in representation.edges.tolist()}
    assert (nodes[0], nodes[-1]) == (start, goal)
    assert all((min(e), max(e)) in edges for e in pairwise(nodes))


def test_a_kernel_may_be_passed_twice_to_change_posture():
    # The goal is near 2.9, far from 0.5, where the arm enters kernel 1; kernel 2 is in between.
    detour = laid_by_hand([[0.0], [0.5, 2.9], [1.8], [3.4]], [[0, 1], [1, 2], [1, 3]])
    assert route(detour, 0.0, 0, 3) == [0, 1, 2, 1, 3]
