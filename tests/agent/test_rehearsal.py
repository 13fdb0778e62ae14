import dataclasses

import numpy as np
import pytest

from selftouch_drake.agent.motions import Execution, Motion
from selftouch_drake.agent.rehearsal import (
    ForeignMemoryError,
    RehearsalMemory,
    Try,
    best,
    judge,
)
from selftouch_drake.agent.representation import QuotientRepresentation


def representation(num_kernels=4, links=((0, 1), (1, 2), (2, 3))):
    return QuotientRepresentation(
        target_sensations=np.eye(num_kernels),
        kernel_offsets=np.arange(num_kernels + 1),
        kernel_q=np.zeros((num_kernels, 2)),
        kernel_row=np.arange(num_kernels),
        kernel_strength=np.ones(num_kernels),
        kernel_error=np.zeros(num_kernels),
        kernel_mode=np.zeros(num_kernels, dtype=int),
        mode_joints=np.ones((1, 2), dtype=bool),
        joint_scale=np.ones(2),
        overlap=np.eye(num_kernels, dtype=bool),
        part=np.zeros(num_kernels, dtype=int),
        num_touches=num_kernels,
        set_distance=np.zeros((num_kernels, num_kernels)),
        edges=np.array(links),
        edge_cost=np.ones(len(links)),
        embedding=np.zeros((num_kernels, 3)),
    )


# Four kernels with nothing in common, linked only by edges.
CHAIN = representation()


def tried(contact, lost=(), *, reached=True):
    return Try(
        contact=contact,
        reached=reached,
        lost_links=np.array(lost, int),
        lost_steps=np.array([], int),
        execution=None,
    )


def judged(felt, *, links=(4, 7), goal=2, in_air=None, known=CHAIN):
    """Judges sensations at evenly spaced times along steps of one radian each."""
    felt = np.array(felt, dtype=float)
    num_steps, num_times = len(links), len(felt)
    at = np.linspace(0.0, num_steps, num_times)
    motion = Motion(
        nodes=np.array([*range(3, 3 + num_steps), goal]),
        links=np.array(links, dtype=int),
        in_air=np.zeros(num_steps, bool) if in_air is None else np.array(in_air),
        waypoints_q=np.zeros((num_steps + 1, 2)),
        waypoint_s=np.arange(num_steps + 1.0),
        time_s=at,
        s=at,
        q=np.zeros((num_times, 2)),
        v=np.zeros((num_times, 2)),
        predicted=felt,
        predicted_spread=np.zeros(num_times),
    )
    execution = Execution(
        motion=motion, felt=felt, q_measured=motion.q, v_measured=motion.v, torque=np.zeros((9, 2))
    )
    return judge(execution, known)


A, B, C, NOTHING = (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 0)


@pytest.mark.parametrize(
    ("felt", "contact", "reached", "lost"),
    [
        ([A, A, B, B, C], 1.0, True, []),
        ([A, NOTHING, B, B, C], 0.8, True, [4]),
        ([A, A, B, NOTHING, C], 0.8, True, [7]),
        ([A, NOTHING, B, NOTHING, C], 0.6, True, [4, 7]),
        ([A, A, NOTHING, B, C], 0.8, True, [7]),
        ([A, A, B, B, B], 1.0, False, [7]),
        ([A, A, B, B, NOTHING], 0.8, False, [7]),
        ([NOTHING] * 5, 0.0, False, [4, 7]),
    ],
)
def test_sensations_show_the_links_that_failed(felt, contact, reached, lost):
    one = judged(felt)
    assert (one.contact, one.reached, one.lost_links.tolist()) == (contact, reached, lost)
    assert one.perfect == (contact == 1.0 and reached)
    assert one.execution.felt.tolist() == [list(row) for row in felt]


def test_a_step_along_no_link_is_nobodys_fault():
    assert judged([A, NOTHING, B, NOTHING, C], links=(-1, 7)).lost_links.tolist() == [7]


def test_a_plan_to_stay_has_no_link_to_blame():
    assert judged([C, C], links=()).perfect
    assert judged([NOTHING, NOTHING], links=()).lost_links.tolist() == []


def test_penalties_grow_and_stay_finite():
    memory = RehearsalMemory.blank(CHAIN)
    assert memory.link_penalty.tolist() == [1.0] * 3
    twice = memory.after(np.array([1])).after(np.array([1, 2]))
    assert twice.link_penalty.tolist() == [1.0, 64.0, 8.0]
    assert twice.num_tries == 2
    assert memory.link_penalty.tolist() == [1.0] * 3
    for _ in range(1000):
        twice = twice.after(np.array([0]))
    assert twice.link_penalty[0] == 8.0**6


def test_the_best_try_reaches_its_goal_and_keeps_contact():
    early, late = tried(0.9), tried(0.9)
    assert best([tried(1.0, reached=False), early, tried(0.8), late]) is early


@pytest.mark.parametrize(
    ("felt", "in_air", "contact", "lost"),
    [
        ([A, NOTHING, B, C, C], [True, False], 1.0, []),
        ([NOTHING, NOTHING, B, B, C], [True, False], 1.0, []),
        ([A, NOTHING, NOTHING, NOTHING, C], [True, False], 1 / 3, [7]),
        ([A, A, NOTHING, NOTHING, C], [False, True], 1.0, []),
        ([A, NOTHING, NOTHING, NOTHING, C], [False, True], 2 / 3, [4]),
    ],
)
def test_nothing_is_lost_in_the_air(felt, in_air, contact, lost):
    one = judged(felt, in_air=in_air)
    assert one.contact == pytest.approx(contact)
    assert one.lost_links.tolist() == lost
    assert one.reached


def test_a_goal_is_reached_though_something_else_is_touched_harder():
    both = (5, 0, 1, 0)
    assert not judged([A, A, both]).reached
    assert judged([A, A, both], known=dataclasses.replace(CHAIN, num_set_aside=1)).reached


def test_a_memory_is_the_same_after_a_night_as_arrays():
    memory = RehearsalMemory.blank(CHAIN).after(np.array([2]))
    ends = np.zeros(2), np.ones(2)
    slides = memory.slides.and_also(*ends, np.full((3, 2), 0.5), np.array([0, 1, 1]))
    memory = dataclasses.replace(memory, slides=slides)
    loaded = RehearsalMemory.from_arrays(memory.to_arrays() | {"stamp": np.array("x")}, CHAIN)
    assert np.array_equal(loaded.link_penalty, memory.link_penalty)
    assert (loaded.num_tries, loaded.belongs_to) == (memory.num_tries, memory.belongs_to)
    assert loaded.slides.between(*ends)[1].tolist() == [0, 1, 1]


def test_a_memory_of_another_representation_is_refused():
    other = RehearsalMemory.blank(representation(links=((0, 1), (1, 2), (1, 3))))
    with pytest.raises(ForeignMemoryError, match=r"rehearsals belong to another representation$"):
        RehearsalMemory.from_arrays(other.to_arrays(), CHAIN)


@pytest.mark.parametrize(
    ("name", "array", "message"),
    [
        ("num_tries", np.array(1.5), "num_tries is 1.5, expected a whole number >= 0"),
        ("num_tries", np.array(-1), "num_tries is -1, expected a whole number >= 0"),
        (
            "link_penalty",
            np.array([1.0, 0.5, 1.0]),
            "link_penalty must hold finite factors",
        ),
        ("link_penalty", np.array([1.0, np.nan, 1]), "link_penalty must hold finite factors"),
        (
            "slide_ends",
            np.zeros((0, 2, 3)),
            r"slide_ends is float64 of shape \(0, 2, 3\), expected",
        ),
        ("slide_x", np.full((1, 2), np.nan), "slide_x must hold finite numbers"),
        ("slide_offsets", np.array([3]), "slide_offsets must rise from 0 to 0"),
        ("slide_node", np.array([0.5]), "slide_node is float64 of .* expected whole numbers"),
    ],
)
def test_a_damaged_memory_is_refused(name, array, message):
    arrays = RehearsalMemory.blank(CHAIN).to_arrays()
    with pytest.raises(ValueError, match=message):
        RehearsalMemory.from_arrays(arrays | {name: array}, CHAIN)
    del arrays[name]
    with pytest.raises(ValueError, match=f"^{name} is missing$"):
        RehearsalMemory.from_arrays(arrays, CHAIN)
