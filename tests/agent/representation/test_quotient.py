import dataclasses

import numpy as np
import pytest
from by_hand import ring_by_hand

from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.quotient.links import step_links

# Files and users of the package rely on these names.
CONTRACT = {
    "target_sensations",
    "kernel_offsets",
    "kernel_q",
    "kernel_row",
    "set_distance",
    "edges",
    "edge_cost",
    "part",
    "joint_scale",
}


def test_arrays_and_back_are_the_same(representation):
    arrays = representation.to_arrays()
    assert set(arrays) >= CONTRACT
    found = QuotientRepresentation.from_arrays(arrays | {"stamp": np.array("other")})
    for field in dataclasses.fields(representation):
        here, there = getattr(representation, field.name), getattr(found, field.name)
        assert type(here) is type(there)
        np.testing.assert_array_equal(here, there)


def test_missing_arrays_are_named(representation):
    arrays = representation.to_arrays()
    del arrays["edges"], arrays["kernel_q"]
    with pytest.raises(ValueError, match=r"^kernel_q is missing$"):
        QuotientRepresentation.from_arrays(arrays)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kernel_offsets": np.array(3)}, "kernel_offsets has shape (), expected (121,)"),
        ({"target_sensations": np.array(3)}, "target_sensations has shape (), expected "),
        ({"edges": np.full((9, 2), "x")}, "edges must hold whole numbers"),
        ({"edges": np.zeros((9, 2))}, "edges must hold whole numbers"),
        ({"kernel_q": np.full((9, 6), 1j)}, "kernel_q must hold finite numbers"),
        ({"overlap": np.ones((30, 30))}, "overlap must hold booleans"),
        ({"overlap": np.ones((3, 3), bool)}, "overlap has shape (3, 3), expected (30, 30)"),
        ({"joint_scale": np.ones(4)}, "joint_scale has shape (4,), expected (5,)"),
        ({"num_touches": np.array(-1)}, "num_touches is -1, expected a whole number >= 0"),
        ({"num_touches": np.array(1.5)}, "num_touches is 1.5, expected a whole number >= 0"),
    ],
)
def test_arrays_that_are_something_else_are_refused(representation, change, message):
    with pytest.raises(ValueError, match=r".") as error:
        QuotientRepresentation.from_arrays(representation.to_arrays() | change)
    assert str(error.value).startswith(message)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"edges": np.array([[0, 120]]), "edge_cost": np.ones(1)}, "edges must join kernels 0 to"),
        ({"kernel_offsets": np.zeros(121, int)}, "kernel_offsets must rise from 0 to"),
        (
            {"joint_scale": np.array([1.0, 1.0, 0.0, 1.0, 1.0])},
            "joint_scale is [1.0, 1.0, 0.0, 1.0, 1.0]: give positive factors",
        ),
        ({"part": np.full(120, 1)}, "part must number the parts from 0, largest first"),
        ({"part": np.arange(120) > 9}, "part must hold whole numbers"),
        ({"part": np.repeat([0, 1], [20, 100])}, "part must number the parts from 0, lar"),
    ],
)
def test_values_that_disagree_are_refused(representation, change, message):
    with pytest.raises(ValueError, match=r".") as error:
        dataclasses.replace(representation, **change)
    assert str(error.value).startswith(message)


def test_edges_between_parts_are_refused(representation):
    _, j = representation.edges[0]
    part = np.zeros(120, dtype=int)
    part[j] = 1
    with pytest.raises(ValueError, match="of different parts"):
        dataclasses.replace(representation, part=part)


def test_configurations_are_scaled_joint_by_joint(representation):
    scaled = dataclasses.replace(representation, joint_scale=np.array([1.0, 5.0, 0.2, 3.0, 0.7]))
    x = scaled.scaled(scaled.kernel_q)
    np.testing.assert_allclose(x[:, 1], 5.0 * scaled.kernel_q[:, 1])
    matter = scaled.mode_joints[scaled.kernel_mode]
    kernel_x = np.where(matter, x, x.mean(axis=0))
    np.testing.assert_array_equal(scaled.kernel_sets.x, kernel_x.astype(np.float32))


def test_some_kernels_alone_keep_their_rows_and_edges(representation):
    kernels = np.array([3, 40, 41, 100])
    alone = representation.restricted(kernels)
    assert alone.num_targets == 4
    for place, kernel in enumerate(kernels):
        here, there = alone.members(place), representation.members(kernel)
        np.testing.assert_array_equal(alone.kernel_q[here], representation.kernel_q[there])
        np.testing.assert_array_equal(alone.kernel_row[here], representation.kernel_row[there])
    inside = np.isin(representation.edges, kernels).all(axis=1)
    np.testing.assert_array_equal(kernels[alone.edges], representation.edges[inside])
    np.testing.assert_array_equal(alone.edge_cost, representation.edge_cost[inside])
    assert alone.set_distance[1, 2] == representation.set_distance[40, 41]
    assert representation.restricted(np.arange(120)) is representation


def test_nothing_links_two_parts():
    ring = ring_by_hand(20, links=[(0, 9)])
    two = dataclasses.replace(ring, part=np.repeat([0, 1], 10))
    free = step_links(two.target_sensations, two.edges)
    crossing = two.part[free[:, 0]] != two.part[free[:, 1]]
    assert crossing.any()
    assert two.step_links().tolist() == free[~crossing].tolist()
    assert [0, 9] in two.step_links().tolist()
