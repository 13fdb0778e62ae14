"""Joints become pure turns and slides, with places as they were."""

import dataclasses

import numpy as np
import pytest
from made_up import SLIDING, made_up_model, readings

from selftouch_drake.export.pure_joints import with_pure_joints


def touches(model, number=1200):
    """Readings and targets of touches, one row for each of `kernel_toucher`."""
    target = np.repeat(np.arange(len(model.kernel_part)), 10)[:number]
    return readings(len(target), seed=3), target


def centres(model, q, target):
    """`(n, 3)` of the toucher that made each touch, in the frame of the touched part's link."""
    poses, rows = model.link_poses(q), np.arange(len(q))
    toucher = model.kernel_toucher[rows]
    hand = poses[rows, model.toucher_link[toucher]]
    skin = poses[rows, model.part_link[model.kernel_part[target]]]
    centre = np.concatenate([model.toucher_place[toucher], np.ones((len(q), 1))], axis=1)
    return (np.linalg.inv(skin) @ hand @ centre[:, :, None])[:, :3, 0]


def test_pure_joints_stay_as_they_are():
    model = made_up_model()
    pure = with_pure_joints(model, *touches(model))
    np.testing.assert_allclose(pure.model.twists, model.twists, atol=1e-15)
    assert pure.shift < 1e-12
    assert (pure.slides == SLIDING).all()


def test_screws_become_turns_and_places_stay_near():
    model = made_up_model()
    rng = np.random.default_rng(5)
    screwed = model.twists.copy()
    turning = screwed[:, :3].any(axis=1)
    pitch = 0.01 * rng.normal(size=(6, 1))
    screwed[:, 3:] += pitch * screwed[:, :3]
    screw = dataclasses.replace(model, twists=screwed)
    q, target = touches(model)
    q = 0.8 + 0.1 * q  # where a slide along an axis is nearly the same everywhere
    pure = with_pure_joints(screw, q, target)
    w, v = pure.model.twists[:, :3], pure.model.twists[:, 3:]
    np.testing.assert_allclose((w * v).sum(axis=1), 0.0, atol=1e-15)
    assert w[turning].any(axis=1).all()

    def moved(other):
        apart = centres(other, q, target) - centres(screw, q, target)
        return np.sqrt(np.square(apart).sum(axis=1).mean())

    # Simply without the pitch, places are ten times as far from where they were.
    assert moved(pure.model) == pytest.approx(pure.shift)
    assert pure.shift < 0.1 * moved(model)


@pytest.mark.parametrize("slid", [False, True])
def test_an_open_joint_is_taken_for_what_it_is(slid):
    """It turns by little: its axis is in the body, or so far away that it hardly turns."""
    model = made_up_model()
    rng = np.random.default_rng(2)
    twists = model.twists.copy()
    if slid:
        twists[2] = np.concatenate([0.02 * rng.normal(size=3), [0.3, 0.4, -0.2]])
    else:
        twists[2, 3:] += 0.002 * twists[2, :3]
    open_one = dataclasses.replace(model, twists=twists)
    pure = with_pure_joints(open_one, *touches(model))
    assert pure.slides[2] == slid
    assert pure.model.twists[2, :3].any() == (not slid)
