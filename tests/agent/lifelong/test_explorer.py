"""The explorer stays in touch, and goes where it knows least."""

import dataclasses
from itertools import islice

import numpy as np
import pytest

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.lifelong import (
    JointRanges,
    OnlineLearner,
    PostureSampler,
    Walker,
)
from selftouch_drake.agent.lifelong import explorer as module
from selftouch_drake.agent.lifelong.explorer import kernel_of, recalled
from selftouch_drake.agent.representation.quotient import NO_MODE

pytestmark = pytest.mark.filterwarnings("ignore:the quotient graph fell")

JOINTS = JointRanges(
    lower=np.full(3, -1.3), upper=np.full(3, 1.3), stride=np.full(3, 0.15), pace=0.2
)
#: A searcher makes moves of some strides at once.
NARROW = JointRanges(lower=JOINTS.lower, upper=JOINTS.upper, stride=np.full(3, 0.05))
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
    monkeypatch.setattr(module, "_DWELL", 300)


def explored(agent, num_steps, *, seed=0, start=(1.0, 0.0, 0.0), explores=Walker, joints=JOINTS):
    start = np.array(start)
    explorer = explores(
        agent, joints, start, ball_feels(start[None])[0], np.random.default_rng(seed)
    )
    moves = explorer.moves()
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


def test_it_goes_where_its_predictions_failed():
    """It was surprised on one cap of a ball that it knows equally well all round."""
    points = np.random.default_rng(0).normal(size=(4000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    agent = who_knows(points, ball_feels(points))
    cap = agent.representation.kernel_q[:, 2] > 0.7
    nowhere = np.zeros(3)

    def goals(surprise):
        rng = np.random.default_rng(0)
        explorer = Walker(agent, JOINTS, nowhere, nowhere, rng, surprise)
        rows, kernels = zip(
            *(explorer._goal(agent.representation) for _ in range(1000)), strict=True
        )
        offsets = agent.representation.kernel_offsets
        assert (offsets[list(kernels)] <= rows).all()
        assert (rows < offsets[np.add(kernels, 1)]).all()
        return cap[list(rows)].mean()

    unsurprised = goals(None)
    assert goals(np.zeros(len(cap))) == pytest.approx(unsurprised, abs=0.05)
    assert goals(1.0 * cap) > unsurprised + 0.12


def test_it_recalls_the_most_similar_touch_in_the_joints_that_matter():
    points = np.random.default_rng(0).normal(size=(2000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    felt = ball_feels(points)
    agent = who_knows(points, felt)
    known, kept = agent.representation, agent.kernel_sensation
    np.testing.assert_allclose(
        recalled(known, kept, known.kernel_q[::7]), kept[::7].toarray(), atol=1e-6
    )
    # A fourth joint that turns freely matters in no mode.
    free = dataclasses.replace(
        known,
        kernel_q=np.hstack(
            [known.kernel_q, np.random.default_rng(1).normal(size=(known.num_rows, 1))]
        ),
        joint_scale=np.append(known.joint_scale, 1.0),
        mode_joints=np.hstack([known.mode_joints, np.zeros((len(known.mode_joints), 1), bool)]),
    )
    turned = np.hstack([known.kernel_q[::7], np.full((len(known.kernel_q[::7]), 1), 5.0)])
    np.testing.assert_allclose(recalled(free, kept, turned), kept[::7].toarray(), atol=1e-6)
    # Touches of unknown mode do not count beside others.
    unknown = np.zeros(known.num_rows, dtype=bool)
    unknown[::7] = True
    partly = dataclasses.replace(known, kernel_mode=np.where(unknown, NO_MODE, known.kernel_mode))
    found = recalled(partly, kept, known.kernel_q[::7])
    assert not np.allclose(found, kept[::7].toarray(), atol=1e-3)
    assert np.median(np.einsum("ns,ns->n", found, kept[::7].toarray())) > 0.9
    nothing = dataclasses.replace(known, kernel_mode=np.full(known.num_rows, NO_MODE))
    found = recalled(nothing, kept, known.kernel_q[::7])
    np.testing.assert_allclose(found, kept[::7].toarray(), atol=1e-6)


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
    searcher = PostureSampler(agent, NARROW, nowhere, nowhere, np.random.default_rng(0))
    tried = [next(searcher._look_between(agent))[0] for _ in range(200)]
    # Neighbouring targets are half a radius apart, a target and a random one 1.4.
    apart = np.linalg.norm(np.array(tried)[:, None] - points, axis=2).min(axis=1)
    assert np.quantile(apart, 0.9) < 0.2


def test_half_of_the_gaps_begin_where_its_predictions_failed():
    points = np.random.default_rng(0).normal(size=(1000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    agent, nowhere = who_knows(points, ball_feels(points)), np.zeros(3)
    known = agent.representation
    failed = known.kernel_q[:, 2] > 0.8

    def share(surprise):
        rng = np.random.default_rng(0)
        searcher = PostureSampler(agent, NARROW, nowhere, nowhere, rng, surprise)
        gaps = [searcher._gap(known) for _ in range(400)]
        linked = {tuple(edge) for edge in known.edges.tolist()}
        assert all(tuple(sorted((kernel_of(known, row), end))) in linked for row, end in gaps)
        return failed[[row for row, _ in gaps]].mean()

    assert share(None) < 0.2
    assert share(1.0 * failed) > 0.5


def test_it_starts_from_touches_of_receptors_that_seldom_felt_anything():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(1000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    # Below, only few places are known; there all receptors were felt, though seldom.
    points = np.concatenate([points[points[:, 2] > -0.2], points[points[:, 2] <= -0.2][:20]])
    agent, nowhere = who_knows(points, ball_feels(points)), np.zeros(3)
    searcher = PostureSampler(agent, NARROW, nowhere, nowhere, np.random.default_rng(0))
    starts = np.array(list(islice(searcher._seldom_felt(agent), 300)))
    assert (np.linalg.norm(starts[:, None] - points, axis=2).min(axis=1) < 1e-6).all()
    assert (points[:, 2] <= -0.2).mean() < 0.05
    assert (starts[:, 2] <= -0.2).mean() > 0.5


def test_moves_stay_within_the_limits_of_the_joints():
    q, _ = explored(None, 2000)
    assert (q >= JOINTS.lower).all()
    assert (q <= JOINTS.upper).all()


def test_the_same_seed_gives_the_same_moves():
    first, _ = explored(None, 500, seed=3)
    again, _ = explored(None, 500, seed=3)
    other, _ = explored(None, 500, seed=4)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first[:400], other[:400])
