"""The explorer stays in touch, and goes where it knows least."""

from itertools import islice

import numpy as np
import pytest
from hand_made_chains import ArmOnBall
from scipy.spatial import cKDTree

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body_model.known_chain import ChainLearner
from selftouch_drake.agent.lifelong.explorer import ContactExplorer, ModelExplorer
from selftouch_drake.agent.lifelong.learner import OnlineLearner

pytestmark = pytest.mark.filterwarnings("ignore:the quotient graph fell")

JOINTS = {
    "lower": np.full(3, -1.3),
    "upper": np.full(3, 1.3),
    "stride": np.full(3, 0.15),
    "pace": 0.2,
}
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


def explored(agent, num_steps, *, seed=0, start=(1.0, 0.0, 0.0)):
    start = np.array(start)
    felt, rng = ball_feels(start[None])[0], np.random.default_rng(seed)
    moves = ContactExplorer(agent, start, felt, rng, **JOINTS, dwell=300).moves()
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


ARM = {"lower": np.full(4, -1.5), "upper": np.full(4, 1.5), "stride": np.full(4, 0.15)}


def touched(arm, explorer, num_touches):
    """`(n, 4)` touches that an explorer finds, and the number of postures that it tried."""
    moves, met, tried = explorer.moves(), [], 0
    path = next(moves)
    while sum(map(len, met)) < num_touches:
        felt = arm.feel(path)
        tried += len(path)
        met.append(path[felt.any(axis=1)])
        path = moves.send((path, felt))
    return np.concatenate(met), tried


@pytest.fixture(scope="module")
def chain():
    """What an agent knows after 150 touches of the arm at random."""
    learner = ChainLearner()
    learner.take(*ArmOnBall().touches(150))
    assert learner.known is not None
    return learner.known


def seeking(chain, seed=0):
    rng = np.random.default_rng(seed)
    return ModelExplorer(None, np.zeros(4), np.zeros(40), rng, **ARM, chain=chain)


def test_before_it_knows_a_chain_it_walks_at_random():
    explorer = seeking(None)
    moves = explorer.moves()
    path, walked = next(moves), [np.zeros((1, 4))]
    for _ in range(40):
        walked.append(path)
        path = moves.send((path, np.zeros((len(path), 40))))
    steps = np.diff(np.concatenate(walked), axis=0) / 0.15
    assert len(steps) >= 100
    assert np.sqrt(np.mean(steps**2)) == pytest.approx(1.0, abs=0.3)
    assert np.corrcoef(steps[:-1, 0], steps[1:, 0])[0, 1] > 0.6


def test_on_a_body_of_several_parts_it_starts_from_touches_of_receptors_that_seldom_felt_anything():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(1000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    # Below, only few places are known; there all receptors were felt, though seldom.
    points = np.concatenate([points[points[:, 2] > -0.2], points[points[:, 2] <= -0.2][:20]])
    agent, nowhere = who_knows(points, ball_feels(points)), np.zeros(3)
    searcher = ModelExplorer(agent, nowhere, nowhere, np.random.default_rng(0), **JOINTS)
    starts = np.array(list(islice(searcher._seldom_felt(agent), 300)))
    assert (np.linalg.norm(starts[:, None] - points, axis=2).min(axis=1) < 1e-6).all()
    assert (points[:, 2] <= -0.2).mean() < 0.05
    assert (starts[:, 2] <= -0.2).mean() > 0.5


def test_a_chain_leads_to_touches_all_over_the_skin(chain):
    arm = ArmOnBall()
    q, tried = touched(arm, seeking(chain), 100)
    at_random = np.random.default_rng(2).uniform(-1.5, 1.5, (20_000, 4))
    assert len(q) / tried > 2 * arm.feel(at_random).any(axis=1).mean()
    assert (np.abs(q) <= 1.5).all()
    # No place on the skin is far from a touch; those at random leave larger gaps.
    anywhere, _ = arm.touches(3000, seed=1)
    skin = arm.places(anywhere[1000:])
    gaps = [
        np.quantile(cKDTree(arm.places(some)).query(skin)[0], 0.95)
        for some in (np.concatenate([chain.q, q]), np.concatenate([chain.q, anywhere[:100]]))
    ]
    assert gaps[0] < gaps[1]


def test_it_goes_to_the_nearest_posture_first_and_looks_deeper_where_nothing_is_felt(chain):
    explorer = seeking(chain)
    moves = explorer.moves()
    first = next(moves)
    second = moves.send((first, np.zeros((1, 40))))
    third = moves.send((second, np.ones((1, 40))))
    place = [chain.places(q)[0] for q in (first, second, third)]
    middle = chain.places(chain.q).mean(axis=0)
    assert np.linalg.norm(place[1] - middle) < np.linalg.norm(place[0] - middle)
    assert np.linalg.norm(place[2] - place[0]) > np.linalg.norm(place[1] - place[0])
    assert np.linalg.norm(first) < 2.0


def test_the_same_seed_gives_the_same_choices(chain):
    one, again, other = (touched(ArmOnBall(), seeking(chain, n), 20)[0] for n in (3, 3, 4))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one[:20], other[:20])


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
