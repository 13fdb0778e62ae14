import dataclasses

import numpy as np
import pytest

from selftouch_drake.agent.representation.learning import learn as learn_in_parts
from selftouch_drake.quotient import Representation, learn
from selftouch_drake.quotient.learn import Sizes
from selftouch_drake.quotient.sensations import assign


def test_a_kernel_holds_what_feels_like_its_target(experience, representation):
    q, sensation = experience
    label, _ = assign(sensation, representation.target_sensations)
    np.testing.assert_array_equal(q[representation.kernel_row], representation.kernel_q)
    for kernel in range(representation.num_targets):
        rows = representation.kernel_row[representation.members(kernel)]
        assert (label[rows] == kernel).all()
        assert len(rows) == min(40, np.sum(label == kernel))


def test_edges_join_neighbours_on_the_body(representation):
    members = map(representation.members, range(120))
    place = np.array([representation.kernel_q[rows, :3].mean(axis=0) for rows in members])
    i, j = representation.edges.T
    # 120 kernels lie 0.35 apart on a sphere of radius 1.
    assert np.linalg.norm(place[i] - place[j], axis=1).max() < 1.2


def test_of_one_body_the_agent_learns_the_same_to_the_byte(experience, representation):
    q, sensation = experience
    sizes = {"num_targets": 120, "max_kernel_size": 40, "seed": 3}
    found = learn_in_parts(lambda: [(sensation, q)], **sizes).representation
    assert not found.part.any()
    assert found.mode_joints.shape == (1, 5)
    for name in (field.name for field in dataclasses.fields(Representation)):
        # The agent finds that the last two joints do not matter, and measures without them.
        if name not in ("set_distance", "edges", "edge_cost"):
            here, there = getattr(representation, name), getattr(found, name)
            assert np.asarray(here).tobytes() == np.asarray(there).tobytes(), name


def test_the_same_seed_gives_the_same_bytes(experience, representation):
    again = learn(*experience, num_targets=120, max_kernel_size=40, seed=3)
    other = learn(*experience, num_targets=120, max_kernel_size=40, seed=4)
    assert again.set_distance.tobytes() == representation.set_distance.tobytes()
    assert other.kernel_row.tobytes() != representation.kernel_row.tobytes()


def test_more_seeds_leave_the_first_as_they_are():
    assert Sizes(seed=5).seeds(3)[:2] == Sizes(seed=5).seeds(2)
    assert Sizes(seed=5).seeds(1) != Sizes(seed=6).seeds(1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"num_targets": 1}, "num_targets is 1: give a whole number, 2 or more"),
        ({"max_kernel_size": True}, "max_kernel_size is True: give a whole number, 1 or more"),
        ({"seed": -1}, "seed is -1: give a whole number, 0 or more"),
        (
            {"num_targets": 6001},
            "num_targets is 6001, but there are only 6000 sensations: give a smaller number, or "
            "babble longer",
        ),
    ],
)
def test_sizes_that_cannot_be_are_refused(experience, change, message):
    with pytest.raises(ValueError, match=r".") as error:
        learn(*experience, **change)
    assert str(error.value) == message


def test_sensations_and_configurations_belong_together(experience):
    q, sensation = experience
    with pytest.raises(ValueError, match="q has 5999 rows and sensation 6000"):
        learn(q[1:], sensation)
