"""The environments fulfil Gymnasium's contract and are deterministic."""

import tomllib
import warnings
from importlib import import_module
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv

from selftouch_drake import envs
from selftouch_drake.experiment import ExperimentError

ROOT = Path(__file__).parents[2]
NUM_STEPS = 300


def made(name: str, **kwargs) -> gymnasium.Env:
    if name.startswith("SelfTouch/Robot"):
        kwargs["experiment"] = str(ROOT / "experiments" / "gantry.yaml")
    return gymnasium.make(name, **kwargs)


def actions(space, num_steps: int, seed: int = 0) -> np.ndarray:
    """A slow random walk, so that the robot gets somewhere."""
    random = np.random.default_rng(seed)
    walk = np.cumsum(random.normal(0.0, 0.2, (num_steps, *space.shape)), axis=0)
    return np.sin(walk).astype(np.float32)


def as_bytes(observation, *more) -> bytes:
    parts = [observation[key].tobytes() for key in sorted(observation)]
    return b"".join([*parts, *(np.asarray(each).tobytes() for each in more)])


def rollout(env, seed: int, num_steps: int) -> bytes:
    observation, _ = env.reset(seed=seed)
    seen = [as_bytes(observation)]
    for action in actions(env.action_space, num_steps):
        observation, reward, terminated, _, info = env.step(action)
        seen.append(as_bytes(observation, reward, terminated, *info["touches"].values()))
    return b"".join(seen)


@pytest.fixture(scope="module")
def env():
    return made("SelfTouch/SphereReach-v0", max_episode_steps=NUM_STEPS + 1)


@pytest.fixture(scope="module")
def first(env):
    """The results of some hundred steps, as bytes."""
    return rollout(env, 7, NUM_STEPS)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if "Sphere" in name else [pytest.mark.slow])
        for name in envs.environments()
    ],
)
def test_gymnasiums_checker_finds_nothing(name):
    env = made(name)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        brief = name != "SelfTouch/SphereReach-v0"
        check_env(env.unwrapped, skip_render_check=brief, skip_close_check=brief)
    env.close()


def test_the_same_seed_gives_the_same_bytes_also_after_a_reset(env, first):
    assert rollout(env, 7, NUM_STEPS) == first
    assert not first.startswith(rollout(env, 8, 1))


@pytest.mark.slow
def test_several_copies_at_once_give_the_same_bytes(env, first):
    copies = AsyncVectorEnv([lambda: gymnasium.make(env.spec)] * 2)
    try:
        observations, _ = copies.reset(seed=[6, 7])
        seen = [as_bytes({key: of[1] for key, of in observations.items()})]
        for action in actions(env.action_space, NUM_STEPS):
            both = np.stack([-action, action])
            observations, rewards, terminated, _, info = copies.step(both)
            mine = {key: of[1] for key, of in observations.items()}
            touches = [of[1] for name, of in info["touches"].items() if name[0] != "_"]
            seen.append(as_bytes(mine, rewards[1], terminated[1], *touches))
        assert b"".join(seen) == first
    finally:
        copies.close()


def test_the_entry_point_registers_and_registering_twice_says_nothing():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    module, _, name = project["entry-points"]["gymnasium.envs"]["__root__"].partition(":")
    saved = {each: gymnasium.registry.pop(each) for each in envs.environments()}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for _ in range(2):
                getattr(import_module(module), name)()
        assert {*saved} <= {*gymnasium.registry}
        assert gymnasium.spec("SelfTouch/Infant-v0").kwargs == {"experiment": "infant"}
    finally:
        gymnasium.registry.update(saved)


def test_a_robot_of_ones_own_is_made_from_its_file(tmp_path):
    text = (ROOT / "experiments" / "cube.yaml").read_text()
    (tmp_path / "my_robot.yaml").write_text(text)
    overrides = {"skins": {"body": {"num_receptors": 20}}}
    env = gymnasium.make(
        "SelfTouch/Robot-v0", experiment=tmp_path / "my_robot.yaml", overrides=overrides
    )
    assert env.observation_space["touch"].shape == (20,)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        (
            {"experiment": "toros"},
            "^experiment 'toros' is neither shipped nor a file; did you mean",
        ),
        ({"experiment": "cube", "period_s": 0.001}, r"^period_s is 0.001: give 0.005 s or more$"),
        (
            {"experiment": "cube", "render_mode": "ansi"},
            r"^render_mode is 'ansi': give human, rgb_array or None$",
        ),
        (
            {"experiment": "cube", "overrides": {"robot": {"directives": "no.yaml"}}},
            r"no\.yaml",
        ),
    ],
)
def test_a_mistake_is_one_line(kwargs, message):
    with pytest.raises((ExperimentError, ValueError), match=message) as error:
        envs.SelfTouchEnv(**kwargs)
    assert "\n" not in str(error.value)
