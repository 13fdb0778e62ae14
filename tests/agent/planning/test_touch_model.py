import dataclasses

import numpy as np
import pytest
from by_hand import laid_by_hand
from scipy.sparse import csr_array

from selftouch_drake.agent.memory import RehearsalMemory, Slides
from selftouch_drake.agent.planning import touch_model
from selftouch_drake.agent.planning.planner import Planner
from selftouch_drake.agent.planning.touch_model import TouchModel

#: A ring of skin round a rigid core, touched by a point whose x is the sum of the first three
#: joints, and y that of the others.
SKIN, CORE, NUM_KERNELS = 2.0, 1.6, 8


def radius(q):
    return np.hypot(q[..., :3].sum(axis=-1), q[..., 3:].sum(axis=-1))


def felt(q):
    """Receptors all round the ring, of unit L2 norm, and how firm the touch is."""
    turn = np.arctan2(q[:, 3:].sum(axis=1), q[:, :3].sum(axis=1))
    centres = np.linspace(-np.pi, np.pi, 24, endpoint=False)
    near = np.maximum(np.cos(turn[:, None] - centres) - 0.9, 0.0)
    return near / np.linalg.norm(near, axis=1, keepdims=True), SKIN - radius(q), turn


def met(q, firmness=None):
    """What is known from touches at q, in this order, and what was felt at its rows."""
    sensation, pressed, turn = felt(q)
    firmness = pressed if firmness is None else firmness
    kernel = ((turn + np.pi) / (2 * np.pi) * NUM_KERNELS).astype(int).clip(0, NUM_KERNELS - 1)
    order = np.argsort(kernel, kind="stable")
    q, sensation, kernel = q[order], sensation[order], kernel[order]
    ring = [sorted((k, (k + 1) % NUM_KERNELS)) for k in range(NUM_KERNELS)]
    sizes = np.bincount(kernel, minlength=NUM_KERNELS)
    means = np.array([sensation[kernel == k].mean(axis=0) for k in range(NUM_KERNELS)])
    representation = laid_by_hand(
        np.split(q, np.cumsum(sizes)[:-1]),
        sorted(ring),
        target_sensations=means / np.linalg.norm(means, axis=1, keepdims=True),
        kernel_row=order,
        kernel_strength=firmness[order],
        joint_scale=np.full(6, 4.0),
    )
    return representation, csr_array(sensation.astype(np.float32))


@pytest.fixture(scope="module", autouse=True)
def _small_networks():
    """A ring in six joints is told by half the hidden units."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(touch_model, "_HIDDEN", (64, 64, 64))
        yield


@pytest.fixture(scope="module")
def known():
    q = np.random.default_rng(0).uniform(-1.5, 1.5, (200_000, 6))
    return met(q[(radius(q) > CORE) & (radius(q) < SKIN)][:3600])


@pytest.fixture(scope="module")
def model(known):
    representation, sensation = known
    return TouchModel.learn(representation, lambda: sensation)


def in_skin(planner):
    """The share of three plans' paths on which the skin is touched, and not its core."""
    shares = []
    for start, goal in ((0, 3), (6, 2), (1, 5)):
        q = planner.representation.kernel_q[planner.representation.members(start)][7]
        plan = planner.plan(q, [start, goal])
        there = radius(plan.path(np.linspace(0.0, plan.waypoint_s[-1], 400)))
        shares.append(np.mean((there > CORE) & (there < SKIN)))
        assert not plan.imagined[[0, -1]].any()
    return np.mean(shares)


def test_long_steps_are_bent_into_the_skin(known, model):
    straight, bent = (in_skin(Planner(known[0], touch_model=touch)) for touch in (None, model))
    assert straight < 0.9
    assert bent > 0.97


def test_it_says_what_is_felt_between_touches(known, model):
    q = known[0].kernel_q[::50]
    expected = model.of_mode[0].sensation(known[0].scaled(q))
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    assert np.mean(1.0 - np.sum(expected * felt(q)[0], axis=1)) < 0.02


def test_short_steps_stay_straight(known):
    representation, _ = known
    near = dataclasses.replace(representation, joint_scale=np.full(6, 1.0))
    unread = TouchModel.learn(near, lambda: pytest.fail("what was felt is not needed"))
    assert unread.of_mode == (None,)


def test_modes_share_the_steps_that_show_the_need_and_no_others(known, monkeypatch):
    representation, sensation = known
    two_modes = dataclasses.replace(
        representation,
        kernel_mode=(np.arange(representation.num_rows) % 3 == 2).astype(int),
        mode_joints=np.ones((2, 6), dtype=bool),
    )
    trained = []
    monkeypatch.setattr(touch_model, "train", lambda *given: trained.append(given[-1]))
    monkeypatch.setattr(touch_model, "_sees_need", lambda *given: True)
    monkeypatch.setattr(touch_model, "_MOST_STEPS", 360)
    TouchModel.learn(two_modes, lambda: sensation)
    assert trained == [240, 360, 360, 360, 120, 360, 360, 360]


def test_a_way_known_by_heart_is_not_taken_for_the_skin(monkeypatch):
    """Touches on a slow way, whose firmness has nothing to do with where they are."""
    monkeypatch.setattr(touch_model, "_OFF", 0.0)  # correlation alone decides
    monkeypatch.setattr(touch_model, "_LEAST_CORRELATION", 0.6)
    monkeypatch.setattr(touch_model, "_NUM_NETWORKS", 1)
    noise = np.random.default_rng(0).standard_normal((7, 4799))
    *way, firmness = (np.convolve(row, np.full(300, 0.06), "valid") for row in noise)
    representation, sensation = met(np.stack(way, axis=1), np.exp(firmness))
    assert TouchModel.learn(representation, lambda: sensation).of_mode == (None,)


def test_it_is_saved_whole(known, model):
    again = TouchModel.from_arrays(model.to_arrays() | {"stamp": np.array("x")})
    x = known[0].scaled(known[0].kernel_q[:5])
    np.testing.assert_array_equal(again.of_mode[0](x)[0], model.of_mode[0](x)[0])
    assert again.of_mode[0].firmest == model.of_mode[0].firmest
    assert TouchModel.from_arrays(TouchModel((None, None)).to_arrays()).of_mode == (None, None)


def test_a_known_slide_replaces_a_bent_step(known, model):
    planner = Planner(known[0], touch_model=model)
    q = known[0].kernel_q[known[0].members(0)][7]
    plan = planner.plan(q, [0, 3])
    touches = known[0].scaled(plan.waypoints_q[~plan.imagined])
    slides = Slides.none(6).and_also(touches[0], touches[1], touches[:1] + 0.01, np.array([0]))
    memory = dataclasses.replace(RehearsalMemory.blank(known[0]), slides=slides)
    slid = planner.plan(q, [0, 3], memory=memory)
    first = np.flatnonzero(~slid.imagined)[1]
    assert first == 1
    np.testing.assert_allclose(known[0].scaled(slid.waypoints_q[1]), touches[0] + 0.01)
