"""What is known of a body in a lesson, and what to do next; no file is read."""

from dataclasses import replace

import numpy as np
import pytest

from selftouch_drake.agent.lesson import (
    JointKnown,
    Known,
    PartKnown,
    _able,
    known,
    next_steps,
)


def joint(name, **changed):
    return JointKnown(**{"name": name, "seen": 0.9, "kind": "turns", "error_deg": 0.5} | changed)


ENOUGH = Known(
    num_touches=300,
    joints=(joint("neck"), joint("elbow")),
    felt=np.full(20, 10),
    names=[f"taxel {n}" for n in range(20)],
    accepted=True,
    reason="Touches agree.",
)


def test_when_all_is_known_nothing_is_left_to_do():
    assert ENOUGH.is_enough
    assert next_steps(ENOUGH) == []


@pytest.mark.parametrize(
    "change",
    [
        {"accepted": False},
        {"felt": np.repeat([0, 10], [3, 17])},
        {"joints": (joint("neck"), joint("elbow", error_deg=5.0))},
        {"joints": (joint("neck"), joint("elbow", kind="unknown", error_deg=np.nan))},
    ],
)
def test_it_is_not_enough_while_something_is_open(change):
    found = replace(ENOUGH, **change)
    assert not found.is_enough
    assert next_steps(found)


def test_joints_of_no_use_and_open_axes_do_not_keep_it_waiting():
    of_no_use = joint("spare", kind="not used", error_deg=np.nan)
    is_open = joint("rail", kind="turns or slides", error_deg=np.nan)
    assert replace(ENOUGH, joints=(of_no_use, is_open)).is_enough


def test_the_first_step_is_a_touch():
    (step,) = next_steps(replace(ENOUGH, num_touches=0, accepted=False))
    assert step.text.startswith("touch the skin anywhere, gently")


def test_joints_of_which_little_was_seen_come_first_and_receptors_by_name():
    felt = np.full(20, 10)
    felt[[4, 9, 11]] = 0, 2, 1
    found = replace(
        ENOUGH,
        accepted=False,
        felt=felt,
        joints=(joint("neck", seen=0.3), joint("elbow", seen=0.1), joint("wrist", error_deg=8.0)),
    )
    still, unsure, rare = next_steps(found)
    assert still.joints == [1, 0]
    assert still.text == (
        "touch with other positions of elbow (10% of its range seen), neck (30% of its range seen)"
    )
    assert unsure.joints == [2]
    assert "wrist (axis ± 8.0°)" in unsure.text
    assert rare.receptors == [4, 11, 9]
    assert rare.text == (
        "touch receptors that felt less than 3 touches: taxel 4 (0), taxel 11 (1), taxel 9 (2)"
    )


def test_what_touches_covered_is_seen_beside_the_reach_of_a_joint():
    q = np.array([[0.0, 5.0], [1.0, 5.0]])
    sensation = np.array([[1.0, 0.0, 0.0], [0.5, 2.0, 0.0]])
    reach = np.array([[-1.0, 0.0], [1.0, 10.0]])
    found = known(q, sensation, ["a", "b"], ["x", "y", "z"], reach, None)
    assert [one.seen for one in found.joints] == [0.5, 0.0]
    assert found.felt.tolist() == [2, 1, 0]
    assert (found.accepted, found.num_touches) == (False, 2)
    assert found.reason == "too few touches to look for a body"
    assert found.share_felt == 0.0


def test_of_several_parts_the_least_touched_is_next_by_the_limb_that_can():
    parts = [
        PartKnown(receptors=[7, 8], num_touches=30, limb=[1]),
        PartKnown(receptors=[0, 1, 2], num_touches=90, limb=[0]),
    ]
    found = replace(ENOUGH, accepted=False, parts=parts, limbs=[[0], [1]])
    (step,) = next_steps(found)
    assert (step.joints, step.receptors) == ([1], [7, 8])
    assert step.text == (
        "touch near taxel 7, taxel 8, the part of the skin with the fewest touches (30); move "
        "elbow alone, and hold the other joints still for ten touches"
    )
    by_nobody = [replace(parts[0], limb=()), parts[1]]
    (unknown,) = next_steps(replace(found, parts=by_nobody, limbs=[]))
    assert unknown.text.endswith(
        "; move one limb at a time, and hold the other joints still for ten touches"
    )
    (of_one,) = next_steps(replace(found, parts=parts[:1]))
    assert of_one.text.startswith("go on")


@pytest.mark.parametrize(("by_first", "least"), [(3, [2, 3]), (10, [0, 1]), (20, [0, 1])])
def test_parts_and_who_touched_them_are_told_from_touches(by_first, least):
    q = np.random.default_rng(0).uniform(-1, 1, (120, 4))
    first_moves = np.repeat(np.arange(12) % 3 < 2, 10)  # in blocks of ten
    for block in range(12):
        standing = [2, 3] if first_moves[10 * block] else [0, 1]
        q[10 * block : 10 * block + 10, standing] = q[10 * block, standing]
    sensation = np.zeros((120, 6))
    # The second part is touched by the second limb, and by the first one in few touches.
    on_first = first_moves.copy()
    on_first[np.flatnonzero(first_moves)[:by_first]] = False
    sensation[on_first, :2] = 1.0
    sensation[~on_first, 2:5] = 1.0
    found = known(q, sensation, list("abcd"), list("uvwxyz"), np.array([[-1] * 4, [1] * 4]), None)
    assert [list(limb) for limb in found.limbs] == [[0, 1], [2, 3]]
    rare, often = found.parts
    assert sorted(rare.receptors) == [2, 3, 4]
    assert list(rare.limb) == least
    assert rare.num_touches == (40 if least == [2, 3] else by_first)
    assert (list(often.limb), often.num_touches) == ([0, 1], 80 - by_first)


def test_limbs_that_no_part_joins_are_asked_to_meet_where_they_nearly_do():
    by = np.array([[18, 0, 86], [95, 100, 1]])
    assert _able(by, by.sum(axis=0)).tolist() == [[True, False, True], [True, True, False]]
    # Where two limbs meet, touches by chance on another part are no reason to ask for more.
    by = np.array([[60, 0, 86], [95, 100, 10]])
    assert _able(by, by.sum(axis=0)).tolist() == [[True, False, True], [True, True, False]]
    assert not _able(np.zeros((0, 2)), np.array([5, 5])).any()
