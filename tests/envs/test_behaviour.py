"""Observations, rewards and ends of the environments."""

import numpy as np
import pytest

from selftouch_drake.envs import ReachEnv, SelfTouchEnv, SlideEnv, likeness
from selftouch_drake.envs.postures import FirmTouches, possible_posture, touching_pairs


@pytest.fixture(scope="module")
def env():
    return SelfTouchEnv("sphere")


@pytest.fixture(scope="module")
def reach():
    return ReachEnv("sphere")


@pytest.fixture(scope="module")
def slide():
    return SlideEnv("sphere")


@pytest.fixture
def posture(env):
    return FirmTouches(env.world).next(np.random.default_rng(0))


def still(env) -> np.ndarray:
    return np.zeros(env.action_space.shape, dtype=np.float32)


def test_an_action_is_a_share_of_the_greatest_velocity(env):
    q = np.array([0.3, 0.4, -0.5, 0.2, 0.1, 0.0])
    before, _ = env.reset(options={"q": q})
    assert np.allclose(before["observation"], [*q, *np.zeros(6)], atol=1e-6)
    action = np.array([1.0, -1.0, 0.5, 0.0, 0.0, 0.0], dtype=np.float32)
    for _ in range(10):
        after, *_ = env.step(action)
    moved = after["observation"][:6] - q
    # 1 rad/s at most, for 0.5 s.
    assert np.allclose(moved, 0.5 * action, atol=0.01)


def test_a_motion_can_be_followed(env):
    q = np.array([0.3, 0.4, -0.5, 0.2, 0.1, 0.0])
    time_s = np.linspace(0.0, 1.02, 103)
    motion = q + 0.4 * np.sin(time_s)[:, None] * np.array([1.0, -1.0, 0.5, 0.2, 0.0, 1.0])
    actions = env.actions_along(time_s, motion)
    assert actions.shape == (21, 6)
    env.reset(options={"q": motion[0]})
    for action in actions:
        observation, *_ = env.step(action)
    assert np.allclose(observation["observation"][:6], motion[-1], atol=0.01)


def test_commands_stay_within_the_limits_of_the_joints(env):
    lower, upper = env.world.robot.babbled_range
    env.reset(options={"q": upper})
    for _ in range(5):
        observation, *_ = env.step(np.ones(6, dtype=np.float32))
    assert np.all(observation["observation"][:6] <= upper + 0.01)
    assert np.all(env.observation_space["observation"].low[:6] < lower)


def test_nothing_is_rewarded_and_info_counts_touches(env, posture):
    _, info = env.reset(options={"q": posture[0]})
    assert info == {"steps": 0, "touches": {"body": 0}}
    for _ in range(3):
        observation, reward, terminated, truncated, info = env.step(still(env))
        assert (reward, terminated, truncated) == (0.0, False, False)
    assert observation["touch"].any()
    assert info == {"steps": 3, "touches": {"body": 3}}


def test_truth_is_there_for_who_scores_and_changes_nothing(env, posture):
    env.reset(options={"q": posture[0]})
    first, *_ = env.step(still(env))
    truth = env.truth()
    assert np.allclose(truth.q, first["observation"][:6], atol=1e-6)
    assert np.linalg.norm(truth.touches.p_LC[0]) == pytest.approx(0.25, abs=0.06)
    assert np.allclose(truth.touches.sensation[0], first["touch"], atol=1e-4)
    second, *_ = env.step(still(env))
    env.reset(options={"q": posture[0]})
    env.step(still(env))
    again, *_ = env.step(still(env))
    assert all(np.array_equal(again[key], second[key]) for key in again)


def test_postures_are_possible_and_firm():
    env = SelfTouchEnv("two_arms")
    random = np.random.default_rng(1)
    q = np.stack([possible_posture(env.world, random) for _ in range(5)])
    assert not env.world.probe.impossible(q).any()
    postures = FirmTouches(env.world)
    there, touches = postures.next(random)
    assert np.array_equal(env.world.probe.sensations(there[None]), touches.sensation)
    pairs = touching_pairs(touches)
    alike, touches = postures.next(random, pairs)
    assert touching_pairs(touches) == pairs
    assert not np.array_equal(alike, there)


def test_reaching_is_rewarded_by_likeness(reach, posture):
    there = {"q": posture[0], "goal": posture[1].sensation[0]}
    observation, info = reach.reset(options=there)
    assert np.linalg.norm(observation["desired_goal"]) == pytest.approx(1.0)
    assert info["is_success"]
    assert info["likeness"] > 0.98
    _, reward, terminated, _, info = reach.step(still(reach))
    assert reward == pytest.approx(info["likeness"], abs=1e-6)
    assert not terminated
    opposite = np.where(posture[1].sensation[0] > 0, 0.0, 1.0)
    reach.reset(options={"q": posture[0], "goal": opposite})
    _, reward, _, _, info = reach.step(still(reach))
    assert (reward, info["is_success"]) == (0.0, False)


def test_rewards_of_many_steps_are_those_of_each(reach):
    reach.reset(seed=2)
    seen = [reach.step(reach.action_space.sample()) for _ in range(5)]
    achieved, desired = (
        np.stack([each[0][key] for each in seen]) for key in ("achieved_goal", "desired_goal")
    )
    rewards = reach.compute_reward(achieved, desired, {})
    assert rewards.shape == (5,)
    assert np.array_equal(rewards, [each[1] for each in seen])
    assert reach.compute_reward(desired[0], desired[0], {}) == pytest.approx(1.0)
    assert likeness(np.zeros(3), np.ones(3)) == 0.0


def test_sliding_ends_where_contact_is_lost(slide, posture):
    observation, _ = slide.reset(seed=0)
    assert observation["touch"].any()
    _, _, terminated, _, _ = slide.step(still(slide))
    assert not terminated
    # The finger lifts off within a second, whatever joint raises it.
    slide.reset(options={"q": posture[0]})
    ended = []
    for joint in np.repeat(np.eye(6, dtype=np.float32), 2, axis=0) * np.tile([1, -1], 6)[:, None]:
        slide.reset(options={"q": posture[0]})
        ended.append(any(slide.step(joint.astype(np.float32))[2] for _ in range(10)))
    assert any(ended)
    with pytest.raises(ValueError, match=r"where nothing touches: give a touching start$"):
        slide.reset(options={"q": np.zeros(6)})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"speed": 1}, r"^options has 'speed': known are goal, q$"),
        ({"q": [0.0]}, r"^options\['q'\] is \[0.0\]: give 6 finite numbers$"),
        ({"q": [9.0, 0, 0, 0, 0, 0]}, r"^options\['q'\] is \[9.0, .*: keep between "),
        ({"goal": np.zeros(100)}, r"give a sensation in N, without negative readings, not all 0$"),
    ],
)
def test_an_impossible_option_is_refused(reach, options, message):
    with pytest.raises(ValueError, match=message):
        reach.reset(options=options)


def test_an_invalid_action_is_refused(env):
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"^action is \[nan.*: give \(6,\) numbers, -1 to 1$"):
        env.step(np.full(6, np.nan))


def test_pictures_show_what_is_felt():
    env = SelfTouchEnv("sphere", render_mode="rgb_array")
    posture = FirmTouches(env.world).next(np.random.default_rng(0))
    env.reset(options={"q": posture[0]})
    picture = env.render()
    assert picture.shape == (480, 480, 3)
    assert picture.dtype == np.uint8
    assert 0.02 < np.mean(picture.min(axis=2) < 250) < 0.9
    env.reset(options={"q": np.zeros(6)})
    assert not np.array_equal(env.render(), picture)
