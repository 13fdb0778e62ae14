"""True parts of touches placed by hand."""

import numpy as np
import pytest
from laying import kernels_on, places

from selftouch_drake.evaluation.parts import TouchCounts, true_parts


def parts_of(fields, hand, truth):
    return true_parts(fields, TouchCounts(fields, [hand.contacts()]), truth)


@pytest.mark.parametrize(
    ("surface", "where", "betti"),
    [
        ("sphere", lambda p: np.isfinite(p[:, 0]), (1, 0, 1)),
        ("sphere", lambda p: p[:, 2] > 0.0, (1, 0, 0)),
        ("sphere", lambda p: np.abs(p[:, 2]) < 0.12, (1, 1, 0)),
        ("torus", lambda p: np.isfinite(p[:, 0]), (1, 2, 1)),
        # The outer half is a band, an end of it a tube.
        ("torus", lambda p: np.hypot(p[:, 0], p[:, 1]) > 0.22, (1, 1, 0)),
        ("torus", lambda p: p[:, 0] > 0.0, (1, 1, 0)),
        ("tube", lambda p: np.abs(p[:, 2]) < 0.17, (1, 1, 0)),
        ("tube", lambda p: np.isfinite(p[:, 0]), (1, 0, 1)),
    ],
)
def test_holes_are_those_of_what_was_touched(request, hand, surface, where, betti):
    fields = request.getfixturevalue(surface)
    p = places(fields, 6000, where=where)
    (part,) = parts_of([fields], hand.touch_all(p), kernels_on([p], number=200))
    assert part.betti == betti
    assert part.skins == (0,)
    np.testing.assert_array_equal(part.kernels, np.arange(200))


def test_two_patches_of_one_skin_are_two_parts(sphere, hand):
    p = places(sphere, 6000, where=lambda p: np.abs(p[:, 2]) > 0.1)
    upper = p[p[:, 2] > 0]
    hand.touch_all(p)
    truth = kernels_on([upper, p[p[:, 2] < 0][:1000]], skins=[0, 0], number=50)
    parts = parts_of([sphere], hand, truth)
    assert [part.betti for part in parts] == [(1, 0, 0)] * 2
    assert sorted(tuple(part.kernels) for part in parts) == [
        tuple(range(50)), tuple(range(50, 100)),
    ]  # fmt: skip


def test_two_skins_apart_are_two_parts_the_larger_one_first(sphere, tube, hand):
    on_sphere, on_tube = places(sphere, 1500), places(tube, 4000)
    hand.touch_all(on_sphere, skin=0).touch_all(on_tube, skin=1, toucher=1)
    truth = kernels_on([on_sphere, on_tube[:1000]], number=100)
    keep = np.concatenate([np.arange(40), np.arange(100, 200)])
    truth = type(truth)(
        skin=truth.skin[keep],
        positions=truth.positions[keep],
        spread=truth.spread[keep],
        share_single=1.0,
    )
    large, small = parts_of([sphere, tube], hand, truth)
    assert (large.skins, small.skins) == ((1,), (0,))
    np.testing.assert_array_equal(large.kernels, np.arange(40, 140))
    np.testing.assert_array_equal(small.kernels, np.arange(40))
    assert large.betti == small.betti == (1, 0, 1)


def _side_by_side(sphere, hand, share, toucher_of_other=0):
    """Touches of two spheres; near the first one's top a share of them presses the other, too.

    The other's bottom, opposite to it, is not touched alone.
    """
    one, other = places(sphere, 4000, seed=1), places(sphere, 4000, seed=2)
    at_top = one[:, 2] > 0.1
    rng = np.random.default_rng(0)
    for place, top in zip(one, at_top, strict=True):
        contacts = [(0, 0, place)]
        if top and rng.uniform() < share:
            contacts.append((1, toucher_of_other, place * [1.0, 1.0, -1.0]))
        hand.touch(*contacts)
    hand.touch_all(other[other[:, 2] > -0.1], skin=1)
    return parts_of([sphere, sphere], hand, kernels_on([one, other]))


def test_two_skins_that_one_toucher_presses_at_once_are_one_part(sphere, hand):
    (part,) = _side_by_side(sphere, hand, share=0.95)
    assert part.skins == (0, 1)
    np.testing.assert_array_equal(part.kernels, np.arange(120))
    # Its surface is no patch of one skin.
    assert part.betti is None


def test_a_finger_that_is_caught_between_two_skins_now_and_then_joins_nothing(sphere, hand):
    assert [part.skins for part in _side_by_side(sphere, hand, share=0.05)] == [(0,), (1,)]


def test_two_touchers_at_once_join_nothing(sphere, hand):
    parts = _side_by_side(sphere, hand, share=1.0, toucher_of_other=1)
    assert [part.skins for part in parts] == [(0,), (1,)]


def test_a_skin_without_kernels_joins_nothing(sphere, tube, hand):
    left, right, middle = (
        places(f, 3000, seed=s) for f, s in ((sphere, 1), (sphere, 2), (tube, 3))
    )
    hand.touch_all(left).touch_all(right, skin=1)
    # What of the third skin was touched was touched with one of the others.
    for place, other in zip(middle[:600], left[:600], strict=True):
        hand.touch((0, 0, other), (2, 0, place))
    for place, other in zip(middle[600:1200], right[:600], strict=True):
        hand.touch((1, 0, other), (2, 0, place))
    parts = parts_of([sphere, sphere, tube], hand, kernels_on([left, right]))
    assert sorted(part.skins for part in parts) == [(0,), (1,)]


def test_a_few_stray_touches_are_no_part(sphere, hand):
    p = places(sphere, 3000, where=lambda p: p[:, 2] > 0.0)
    stray = np.array([[0.0, 0.0, -0.2]] * 5)
    truth = kernels_on([p, stray], skins=[0, 0])
    (part,) = parts_of([sphere], hand.touch_all(p).touch_all(stray), truth)
    # The kernel that is there counts to what is nearest; its few touches leave no hole.
    assert part.betti == (1, 0, 0)


def test_a_patch_with_few_kernels_is_left_out(sphere, tube, hand):
    on_sphere, on_tube = places(sphere, 3000), places(tube, 3000)
    hand.touch_all(on_sphere).touch_all(on_tube, skin=1)
    truth = kernels_on([on_sphere, on_tube[:11]])
    (part,) = parts_of([sphere, tube], hand, truth)
    assert part.skins == (0,)
    assert len(part.kernels) == 60


def test_touches_are_counted_where_they_are_however_they_are_cut_up(sphere, tube, hand):
    on_sphere, on_tube = places(sphere, 300), places(tube, 200)
    for a, b in zip(on_sphere[:200], on_tube, strict=True):
        hand.touch((0, 0, a), (1, 0, b))
    hand.touch_all(on_sphere[200:])
    contacts = hand.contacts()
    fields = [sphere, tube]
    whole = TouchCounts(fields, [contacts])
    cut = TouchCounts(fields, [contacts[np.arange(130)], contacts[np.arange(130, 300)]])
    for a, b in zip(whole.counts, cut.counts, strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(whole.together, cut.together)
    assert [counts.sum() for counts in whole.counts] == [300, 200]
    assert whole.together.shape == (200, 2)
    first, second = whole.together[0]
    assert np.linalg.norm(sphere.vertices[first] - on_sphere[0]) < 0.02
    assert np.linalg.norm(tube.vertices[second - whole.ends[1]] - on_tube[0]) < 0.02
    assert TouchCounts(fields, []).together.shape == (0, 2)
