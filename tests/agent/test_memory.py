import dataclasses
import re

import numpy as np
import pytest
from by_hand import laid_by_hand

from selftouch_drake.agent.memory import ForeignMemoryError, RehearsalMemory, Slides


def representation(links):
    return laid_by_hand([[0.0]] * 4, links)


# Four kernels with nothing in common, linked only by edges.
CHAIN = representation([[0, 1], [1, 2], [2, 3]])


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


def test_a_slide_is_known_by_its_ends():
    slides = Slides.none(2).and_also(
        np.zeros(2), np.ones(2), np.full((2, 2), 0.5), np.array([4, 5])
    )
    slides = slides.and_also(np.ones(2), np.zeros(2), np.full((1, 2), 0.2), np.array([7]))
    assert slides.between(np.zeros(2), np.ones(2) + 1e-7)[1].tolist() == [4, 5]
    assert slides.between(np.ones(2), np.zeros(2))[1].tolist() == [7]
    assert slides.between(np.ones(2), np.ones(2))[1].tolist() == []


@pytest.mark.parametrize(
    ("name", "array", "message"),
    [
        (
            "ends",
            np.zeros((1, 2, 2)),
            "slide_ends has shape (1, 2, 2), expected (1, 2, 3)",
        ),
        ("node", np.array([-1]), "slide_node must name kernels 0 to 8"),
        ("node", np.array([9]), "slide_node must name kernels 0 to 8"),
        ("offsets", np.array([0, 2]), "slide_offsets must rise from 0 to 1"),
        ("x", np.full((1, 3), np.inf), "slide_x must hold finite numbers"),
    ],
)
def test_invalid_slides_are_refused(name, array, message):
    slides = Slides.none(3).and_also(np.zeros(3), np.ones(3), np.full((1, 3), 0.5), np.array([8]))
    slides.check(3, 9)
    fields = {n: getattr(slides, n) for n in ("ends", "offsets", "x", "node")}
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        Slides(**fields | {name: array}).check(3, 9)


def test_a_slide_outside_the_limits_is_no_slide():
    slides = Slides.none(4).and_also(
        np.zeros(4), np.ones(4), np.full((2, 4), 0.5), np.array([1, 2])
    )
    slides = slides.and_also(np.ones(4), np.zeros(4), np.full((1, 4), 2.0), np.array([3]))
    kept = slides.within(np.full(4, -1.0), np.full(4, 1.0))
    assert len(kept.ends) == 1
    assert kept.between(np.zeros(4), np.ones(4))[1].tolist() == [1, 2]


def test_a_slide_that_mends_a_part_of_another_is_taken():
    a, m, b = np.zeros(4), np.full(4, 0.5), np.ones(4)
    slides = Slides.none(4).and_also(a, b, m[None], np.array([1]))
    slides = slides.and_also(m, b, np.full((1, 4), 0.8), np.array([2]))
    passed, node = slides.all_between(a, b)
    assert passed[:, 0].tolist() == [0.5, 0.8]
    assert node.tolist() == [1, 2]


def test_a_memory_is_the_same_after_a_night_as_arrays():
    memory = RehearsalMemory.blank(CHAIN).after(np.array([2]))
    ends = np.zeros(1), np.ones(1)
    slides = memory.slides.and_also(*ends, np.full((3, 1), 0.5), np.array([0, 1, 1]))
    memory = dataclasses.replace(memory, slides=slides)
    loaded = RehearsalMemory.restored(memory.to_arrays() | {"stamp": np.array("x")}, CHAIN)
    assert np.array_equal(loaded.link_penalty, memory.link_penalty)
    assert (loaded.num_tries, loaded.belongs_to) == (memory.num_tries, memory.belongs_to)
    assert loaded.slides.between(*ends)[1].tolist() == [0, 1, 1]


def test_a_memory_of_another_representation_is_refused():
    other = RehearsalMemory.blank(representation([[0, 1], [1, 2], [1, 3]]))
    with pytest.raises(ForeignMemoryError, match=r"rehearsals belong to another representation$"):
        RehearsalMemory.restored(other.to_arrays(), CHAIN)


def test_a_memory_of_another_scale_is_foreign():
    other = dataclasses.replace(CHAIN, joint_scale=np.full(1, 2.0))
    with pytest.raises(ForeignMemoryError):
        RehearsalMemory.restored(RehearsalMemory.blank(CHAIN).to_arrays(), other)


@pytest.mark.parametrize(
    ("name", "array", "message"),
    [
        ("num_tries", np.array(1.5), "num_tries is 1.5, expected a whole number >= 0"),
        ("num_tries", np.array(-1), "num_tries is -1, expected a whole number >= 0"),
        (
            "link_penalty",
            np.array([1.0, 0.5, 1.0]),
            "link_penalty must hold factors, 1 or more",
        ),
        ("link_penalty", np.array([1.0, np.nan, 1]), "link_penalty must hold finite numbers"),
        (
            "slide_ends",
            np.zeros((0, 2, 3)),
            r"slide_ends has shape \(0, 2, 3\), expected",
        ),
        ("slide_x", np.full((1, 1), np.nan), "slide_x must hold finite numbers"),
        ("slide_offsets", np.array([3]), "slide_offsets must rise from 0 to 0"),
        ("slide_node", np.array([0.5]), "slide_node has shape"),
    ],
)
def test_a_damaged_memory_is_refused(name, array, message):
    arrays = RehearsalMemory.blank(CHAIN).to_arrays()
    with pytest.raises(ValueError, match=message):
        RehearsalMemory.restored(arrays | {name: array}, CHAIN)
    del arrays[name]
    with pytest.raises(ValueError, match=f"^{name} is missing$"):
        RehearsalMemory.restored(arrays, CHAIN)


def test_rows_where_nothing_was_felt_are_remembered_once():
    memory = RehearsalMemory.blank(CHAIN).missing([3]).missing([1, 3])
    assert memory.missed.tolist() == [1, 3]
    assert not memory.same_as(RehearsalMemory.blank(CHAIN))
    arrays = memory.to_arrays()
    assert RehearsalMemory.restored(arrays, CHAIN).same_as(memory)
    del arrays["missed"]  # a file from before there were any
    assert RehearsalMemory.restored(arrays, CHAIN).missed.tolist() == []
    with pytest.raises(ValueError, match="missed must hold rows 0 to 3"):
        RehearsalMemory.restored({**arrays, "missed": np.array([4])}, CHAIN)
