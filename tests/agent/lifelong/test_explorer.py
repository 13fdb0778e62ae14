"""The explorer stays in touch, and goes where it knows least."""

from itertools import islice

import numpy as np
import pytest

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.lifelong import explorer as module
from selftouch_drake.agent.lifelong.explorer import ContactExplorer, PostureSampler
from selftouch_drake.agent.lifelong.learner import OnlineLearner

pytestmark = pytest.mark.filterwarnings("ignore:the quotient graph fell")

JOINTS = {
    "lower": np.full(3, -1.3),
    "upper": np.full(3, 1.3),
    "stride": np.full(3, 0.15),
    "pace": 0.2,
}
#: A searcher makes moves of some strides at once.
NARROW = JOINTS | {"stride": np.full(3, 0.05), "pace": 1.0}
DEPTH = 0.15


def ball_feels(q, poles=None):
    """A skin round a ball: pressed by a fingertip that is at `(n, 3)` q, deeper is more."""
    far = np.linalg.norm(q, axis=1, keepdims=True)
    poles = SENSORS if poles is None else poles
    beside = np.clip(1.0 - np.linalg.norm(q / far - poles[:, None], axis=2).T / 0.75, 0.0, None)
    depth = np.clip(1.0 - np.abs(far - 1.0) / DEPTH, 0.0, None)
    return depth * beside


def sensors():
    i = np.arange(40) + 0.5
    z = 1 - 2 * i / 40
    turn, flat = i * np.pi * (1 + np.sqrt(5)), np.sqrt(1 - z**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


SENSORS = sensors()


@pytest.fixture(autouse=True)
def dwells_shortly(monkeypatch):
    monkeypatch.setattr(module.ContactExplorer, "dwell", 300)


def explored(
    agent, num_steps, *, seed=0, start=(1.0, 0.0, 0.0), explores=ContactExplorer, joints=JOINTS
):
    start = np.array(start)
    felt, rng = ball_feels(start[None])[0], np.random.default_rng(seed)
    moves = explores(agent, start, felt, rng, **joints).moves()
    path, met = next(moves), []
    while sum(map(len, met)) < num_steps:
        met.append(path)
        path = moves.send((path, ball_feels(path)))
    q = np.concatenate(met)
    return q, ball_feels(q)


def who_knows(q, sensation):
    learner = OnlineLearner(30)
    learner.take(q, sensation)
    return Agent.of(learner.representation, kernel_sensation=learner.kernel_sensation)


def test_it_stays_in_touch_before_it_knows_anything():
    _, felt = explored(None, 3000)
    # Of random configurations 16 % touch.
    assert np.mean(felt.any(axis=1)) > 0.6


def test_it_slides_to_every_place_on_the_skin():
    q, felt = explored(None, 6000)
    on_ball = q[felt.any(axis=1)]
    near = np.linalg.norm(SENSORS[:, None] - on_ball, axis=2).min(axis=1)
    assert (near < 0.3).all()


def test_it_goes_where_it_was_rarely():
    """It knows one half well; the other it has met a few times."""
    rng = np.random.default_rng(0)
    points = rng.normal(size=(4000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points = points[(points[:, 2] > 0) | (rng.random(4000) < 0.05)]
    agent = who_knows(points, ball_feels(points))
    q, felt = explored(agent, 3000)
    q = q[felt.any(axis=1)]
    assert len(q) > 0.6 * 3000
    assert np.mean(q[:, 2] < 0) > 0.5


def test_where_only_touches_count_it_looks_about_places_met_anywhere():
    q, felt = explored(None, 4000, explores=PostureSampler, joints=NARROW)
    q = q[felt.any(axis=1)]
    near = np.linalg.norm(np.diff(q, axis=0), axis=1) < 0.3
    assert np.mean(near) > 0.8
    # All of the ball is met.
    assert np.linalg.norm(q[:, None] - SENSORS, axis=2).min(axis=0).max() < 0.3


def test_it_looks_between_neighbours_on_the_skin():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(1000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    agent = who_knows(points, ball_feels(points))
    nowhere = np.zeros(3)
    searcher = PostureSampler(agent, nowhere, nowhere, np.random.default_rng(0), **NARROW)
    tried = [next(searcher._look_between(agent))[0] for _ in range(200)]
    # Neighbouring targets are half a radius apart, a target and a random one 1.4.
    apart = np.linalg.norm(np.array(tried)[:, None] - points, axis=2).min(axis=1)
    assert np.quantile(apart, 0.9) < 0.2


def test_it_starts_from_touches_of_receptors_that_seldom_felt_anything():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(1000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    # Below, only few places are known; there all receptors were felt, though seldom.
    points = np.concatenate([points[points[:, 2] > -0.2], points[points[:, 2] <= -0.2][:20]])
    agent, nowhere = who_knows(points, ball_feels(points)), np.zeros(3)
    searcher = PostureSampler(agent, nowhere, nowhere, np.random.default_rng(0), **NARROW)
    starts = np.array(list(islice(searcher._seldom_felt(agent), 300)))
    assert (np.linalg.norm(starts[:, None] - points, axis=2).min(axis=1) < 1e-6).all()
    assert (points[:, 2] <= -0.2).mean() < 0.05
    assert (starts[:, 2] <= -0.2).mean() > 0.5


def test_moves_stay_within_the_limits_of_the_joints():
    q, _ = explored(None, 2000)
    assert (q >= JOINTS["lower"]).all()
    assert (q <= JOINTS["upper"]).all()


def test_the_same_seed_gives_the_same_moves():
    first, _ = explored(None, 500, seed=3)
    again, _ = explored(None, 500, seed=3)
    other, _ = explored(None, 500, seed=4)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first[:400], other[:400])
