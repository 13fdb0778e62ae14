"""Many robots at once fulfil Gymnasium's contract, and feel what Drake feels."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from selftouch_drake import envs
from selftouch_drake.envs import ReachEnv, SelfTouchEnv, SelfTouchVectorEnv, SlideEnv
from selftouch_drake.envs.postures import FirmTouches

N = 8
# A robot whose skins take no time to make: these tests are not about them.
FEW = {
    "skins": {
        name: {"surface": {"shape": "collision", "resolution": 0.04}} for name in ("torso", "head")
    }
}


def made(name: str = "SphereReach", num_envs: int = N, **kwargs) -> gymnasium.vector.VectorEnv:
    return gymnasium.make_vec(
        f"selftouch_drake.envs:SelfTouch/{name}-v0",
        num_envs=num_envs,
        vectorization_mode="vector_entry_point",
        **kwargs,
    )


def rollout(env, seed: int | None, num_steps: int = 12) -> bytes:
    """Everything that some steps return."""
    observation, info = env.reset(seed=seed)
    random, seen = np.random.default_rng(0), [*observation.values(), info["steps"]]
    for _ in range(num_steps):
        action = random.uniform(-1, 1, env.action_space.shape).astype(np.float32)
        observation, *rest, info = env.step(action)
        seen += [*observation.values(), *rest, *info["touches"].values()]
    return b"".join(each.tobytes() for each in seen)


@pytest.mark.parametrize(
    ("task", "single"), [("", SelfTouchEnv), ("Reach", ReachEnv), ("Slide", SlideEnv)]
)
def test_spaces_are_those_of_one_environment_and_steps_stay_in_them(task, single):
    env, one = made(f"Sphere{task}"), single("sphere")
    assert isinstance(env.unwrapped, SelfTouchVectorEnv)
    assert env.single_observation_space == one.observation_space
    assert env.single_action_space == one.action_space
    assert env.observation_space == batch_space(one.observation_space, N)
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    observation, info = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    env.action_space.seed(0)
    for _ in range(5):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation)
        assert [each.shape for each in (reward, terminated, truncated)] == 3 * [(N,)]
        assert (reward.dtype, terminated.dtype, truncated.dtype) == (float, bool, bool)
    _, known = one.reset(seed=0)
    assert {*info} == {*known, *(f"_{key}" for key in known)}
    assert {*info["touches"]} == {"body", "_body"}


@pytest.mark.parametrize("name", ["sphere", pytest.param("two_arms", marks=pytest.mark.slow)])
def test_forces_are_those_of_drake(name):
    one, env = SelfTouchEnv(name), SelfTouchVectorEnv(4, experiment=name)
    postures, random = FirmTouches(one.world), np.random.default_rng(3)
    for k in range(env.num_envs):
        q, _ = postures.next(random)
        mask = np.arange(env.num_envs) == k
        observation, _ = env.reset(options={"q": q, "reset_mask": mask})
        one.reset(options={"q": q})
        drakes = one._simulation.felt
        assert drakes.sum() > 0.1
        assert np.allclose(env.truth().touches.sensation[k], drakes, rtol=0, atol=1e-9)
        assert np.array_equal(observation["touch"][k], drakes.astype(np.float32))


def test_a_motion_through_the_air_is_that_of_the_robot_under_dynamics():
    one, env = SelfTouchEnv("sphere"), made("Sphere", num_envs=2)
    q = np.array([0.3, 0.4, -0.5, 0.2, 0.1, 0.0])
    one.reset(options={"q": q})
    env.reset(options={"q": q})
    action = np.array([1.0, -1.0, 0.5, 0.0, 0.0, 0.0], dtype=np.float32)
    for _ in range(10):
        under_dynamics, *_ = one.step(action)
        observation, *_ = env.step(np.stack([action, -action]))
    assert np.allclose(observation["observation"][0], under_dynamics["observation"], atol=0.02)
    assert np.allclose(observation["observation"][1, :6] - q, -0.5 * action, atol=1e-6)
    _, upper = one.world.robot.babbled_range
    env.reset(options={"q": upper})
    observation, *_ = env.step(np.stack([np.ones(6), -np.ones(6)]).astype(np.float32))
    assert np.allclose(observation["observation"][0], [*upper, *np.zeros(6)])
    assert np.all(observation["observation"][1, :6] < upper)


def test_robots_stop_where_their_rigid_parts_meet():
    env = SelfTouchVectorEnv(4, experiment="infant", overrides=FEW)
    env.reset(seed=0)
    random = np.random.default_rng(0)
    # The same way for each robot, until something is in it.
    way = random.choice([-1.0, 1.0], env.action_space.shape).astype(np.float32)
    stopped = np.zeros(4, dtype=bool)
    lower, upper = env.world.robot.babbled_range
    for _ in range(60):
        observation, *_ = env.step(way)
        q = env.truth().q
        inside = ((q > lower) & (q < upper)).any(axis=1)
        stopped |= inside & (np.abs(observation["observation"][:, 14:]).max(axis=1) < 1e-6)
        assert not env.world.probe.impossible(q).any()
    assert stopped.any()


def test_the_same_seed_gives_the_same_bytes():
    env = made(max_episode_steps=5)
    first = rollout(env, 7)
    assert rollout(env, 7) == first
    assert rollout(env, None) != first
    assert rollout(made(max_episode_steps=5), 7) == first


def test_an_episode_ends_and_the_next_step_begins_another_one():
    env = made(max_episode_steps=3)
    env.reset(seed=0)
    still = np.zeros(env.action_space.shape, dtype=np.float32)
    for step in range(1, 4):
        last, _, terminated, truncated, info = env.step(still + 0.5)
        assert (info["steps"] == step).all()
        assert (truncated == (step == 3)).all()
        assert not terminated.any()
    first, reward, _, truncated, info = env.step(still + 0.5)
    assert not truncated.any()
    assert not reward.any()
    assert not info["steps"].any()
    assert not first["observation"][:, 6:].any()
    assert not np.isclose(first["observation"][:, :6], last["observation"][:, :6]).all(axis=1).any()
    assert not np.isclose(first["desired_goal"], last["desired_goal"]).all(axis=1).any()
    env.step(still)
    mask = np.arange(N) < 2
    begun, info = env.reset(options={"reset_mask": mask})
    assert (info["steps"] == ~mask).all()
    unchanged = (begun["desired_goal"] == first["desired_goal"]).all(axis=1)
    assert np.array_equal(unchanged, ~mask)


def test_gymnasiums_statistics_count_the_episodes():
    env = RecordEpisodeStatistics(made(max_episode_steps=4))
    env.reset(seed=0)
    rewards = np.zeros(N)
    for _ in range(4):
        _, reward, _, _, info = env.step(np.full(env.action_space.shape, 0.1, dtype=np.float32))
        rewards += reward
    assert np.array_equal(info["episode"]["l"], np.full(N, 4))
    assert np.allclose(info["episode"]["r"], rewards)


def test_reaching_is_rewarded_and_sliding_ends_where_touch_is_lost():
    reach, slide = made(), made("SphereSlide")
    postures, random = FirmTouches(reach.unwrapped.world), np.random.default_rng(0)
    q, touches = postures.next(random)
    reach.reset(options={"q": q, "goal": touches.sensation[0]})
    still = np.zeros(reach.action_space.shape, dtype=np.float32)
    observation, reward, _, _, info = reach.step(still)
    assert np.allclose(reward, 1.0)
    assert info["is_success"].all()
    assert np.array_equal(info["touches"]["body"], np.ones(N))
    assert np.allclose(np.linalg.norm(observation["achieved_goal"], axis=1), 1.0)
    observation, _ = slide.reset(seed=0)
    assert observation["touch"].any(axis=1).all()
    _, _, terminated, _, _ = slide.step(still)
    assert not terminated.any()
    lost = np.zeros(N, dtype=bool)
    away = np.random.default_rng(0).uniform(-1, 1, still.shape).astype(np.float32)
    for _ in range(10):
        observation, _, terminated, _, info = slide.step(away)
        assert np.array_equal(terminated, ~observation["touch"].any(axis=1))
        lost |= terminated
    assert lost.any()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"speed": 1}, r"^options has 'speed': known are goal, q$"),
        ({"q": [0.0]}, r"^options\['q'\] is \[0.0\]: give 6 finite numbers$"),
        ({"reset_mask": [True]}, r"^options\['reset_mask'\] is \[True\]: give \(8,\) booleans, "),
        ({"reset_mask": N * [False]}, r"at least one of them True$"),
    ],
)
def test_an_impossible_option_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        made().reset(options=options)


def test_a_mistake_is_one_line():
    env = made()
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"^action is .*: give \(8, 6\) numbers, -1 to 1$"):
        env.step(np.zeros((N, 5)))
    with pytest.raises(ValueError, match=r"^num_envs is 0: give 1 or more$"):
        made(num_envs=0)


def test_every_robot_and_task_is_registered():
    for name in envs.environments():
        many = gymnasium.spec(name.replace("-v0", "Kinematic-v0"))
        assert many.max_episode_steps == gymnasium.spec(name).max_episode_steps
        assert name.endswith(f"{many.kwargs['task']}-v0")


@pytest.mark.parametrize("task", ["", "Reach", "Slide"])
def test_one_name_is_many_robots_both_ways(task):
    name = f"selftouch_drake.envs:SelfTouch/Sphere{task}-v0"
    many = gymnasium.make_vec(name, num_envs=2)
    copies = gymnasium.make_vec(name, num_envs=2, vectorization_mode="sync")
    assert isinstance(many.unwrapped, SelfTouchVectorEnv)
    assert isinstance(copies, gymnasium.vector.SyncVectorEnv)
    assert many.observation_space == copies.observation_space
    assert many.action_space == copies.action_space
    # Dynamics take time to follow an action; robots without dynamics follow it at once.
    ahead = np.full(many.action_space.shape, 0.5, dtype=np.float32)
    moved = []
    for env in (many, copies):
        before, _ = env.reset(seed=0)
        after, *_ = env.step(ahead)
        moved.append(np.abs(after["observation"] - before["observation"])[:, :6].max())
        env.close()
    assert moved[0] > moved[1] > 0
