"""A policy learns to reach sensations with 64 robots at once, beside the plans of the agent.

    pip install 'selftouch-drake[gym]' stable-baselines3
    python examples/learn_to_reach.py 600

PPO of Stable-Baselines3 acts and learns for so many seconds on the torus without dynamics; its
reward is the likeness of the felt and the wanted sensation. The agent babbles 20,000 touches,
learns, plans, and practises its plans. Both get the same tasks: from a random posture to the
sensation of a random firm touch. The policy has 10 s for it; the agent takes its time, since its
plans keep to limits of acceleration, and slide once they have landed.
"""

# ruff: noqa: D102 - methods as Stable-Baselines3 has them

import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.practice import NoWayError
from selftouch_drake.bodies.drake import DrakeBodies
from selftouch_drake.bodies.embodiment import pilot_in
from selftouch_drake.envs.goals import REACHED, likeness, unit_goal
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.experiment import load_experiment
from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory

NAME = "selftouch_drake.envs:SelfTouch/TorusReachKinematic-v0"
TOUCHES = {"babbling": {"num_samples": 20_000}}
# What the policy sees; the strength of a touch does not count.
SEEN = ["observation", "achieved_goal", "desired_goal"]


class Robots(VecEnv):
    """Many robots of Gymnasium, as Stable-Baselines3 wants them."""

    def __init__(self, num_envs):
        self.robots = gymnasium.make_vec(NAME, num_envs=num_envs)
        space = self.robots.single_observation_space
        seen = gymnasium.spaces.Dict({name: space[name] for name in SEEN})
        super().__init__(num_envs, seen, self.robots.single_action_space)

    def reset(self):
        observation, _ = self.robots.reset(seed=self._seeds[0])
        self._reset_seeds()
        return self.see(observation)

    def see(self, observation):
        return {name: observation[name] for name in SEEN}

    def step_async(self, actions):
        self.actions = actions

    def step_wait(self):
        """Robots whose episode ended start the next one at once."""
        observation, reward, terminated, truncated, info = self.robots.step(self.actions)
        self.touches = observation["achieved_goal"].any(axis=1)
        self.reached = info["is_success"]
        infos = [{"TimeLimit.truncated": bool(late)} for late in truncated]
        if (ended := terminated | truncated).any():
            for row in np.flatnonzero(ended):
                last = {name: observation[name][row] for name in SEEN}
                infos[row]["terminal_observation"] = last
            observation, _ = self.robots.reset(options={"reset_mask": ended})
        return self.see(observation), reward.astype(np.float32), ended, infos

    def close(self):
        self.robots.close()

    def get_attr(self, name, indices=None):
        return [getattr(self.robots, name)] * self.num_envs

    def set_attr(self, name, value, indices=None):
        raise NotImplementedError

    def env_method(self, name, *arguments, indices=None, **options):
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False] * self.num_envs


class Until(BaseCallback):
    """Ends training after some seconds, and says how it goes.

    Attributes:
        curve: seconds, steps, shares of the robots that touch, and that feel what they want.
    """

    def __init__(self, seconds):
        super().__init__()
        self.seconds, self.curve, self.since = seconds, [], []

    def _on_training_start(self):
        self.began = time.monotonic()

    def _on_step(self):
        robots, now = self.training_env, time.monotonic() - self.began
        self.since.append((robots.touches.mean(), robots.reached.mean()))
        if now >= (self.curve[-1][0] if self.curve else 0.0) + self.seconds / 20:
            touching, reached = np.mean(self.since, axis=0)
            self.curve.append((now, self.num_timesteps, touching, reached))
            said = f"{touching:.0%} touch, {reached:.0%} feel what they want"
            print(f"{now:4.0f} s, {self.num_timesteps:9,} steps: {said}", flush=True)
            self.since = []
        return now < self.seconds


def train_policy(seconds):
    """A policy, and how its training went, as in `Until`."""
    policy = PPO(
        "MultiInputPolicy",
        Robots(64),
        n_steps=128,
        batch_size=2048,
        n_epochs=5,
        gamma=0.98,
        policy_kwargs={"net_arch": [256, 256]},
        seed=0,
        device="cpu",
    )
    until = Until(seconds)
    policy.learn(10**9, callback=until)
    return policy, until.curve


def score_policy(policy, num_tasks, num_steps=200):
    """Shares of tasks that a policy has reached in the end, and has reached at all."""
    robots = Robots(num_tasks)
    robots.seed(1)
    observation, ever = robots.reset(), np.zeros(num_tasks, dtype=bool)
    for _ in range(num_steps):
        action, _ = policy.predict(observation, deterministic=True)
        observation, *_ = robots.step(action)
        ever |= robots.reached
    return robots.reached.mean(), ever.mean()


def score_agent(num_tasks):
    """The share of the same tasks that plans reach, their median s, and the s of learning."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1) as executor:
        run = RunDirectory.create(Path(folder) / "torus", load_experiment("torus", TOUCHES))
        stages.babble(run, executor)
        touches = ExperienceReader(run.experience)
        agent = Agent.learn(touches.read("q"), touches.read("sensation"), num_targets=1000)
    learned_s = time.monotonic() - began
    robots = gymnasium.make_vec(NAME, num_envs=num_tasks)
    observation, _ = robots.reset(seed=1)
    world, reached, takes = robots.world, [], []
    pilot = pilot_in(DrakeBodies(world), agent, run.experiment)
    for q, goal in zip(robots.truth().q, observation["desired_goal"], strict=True):
        try:
            motion = pilot.plan_from(q, agent.target_felt(goal)).motion
        except NoWayError:
            reached.append(False)
            continue
        felt = unit_goal(world.probe.sensations(motion.q[-1:])[0])
        reached.append(likeness(felt, goal) >= REACHED)
        takes.append(motion.time_s[-1])
    return np.mean(reached), np.median(takes), learned_s


def main(seconds=600.0, num_tasks=200):
    """Trains the policy, scores both, and returns their shares of tasks."""
    policy, _ = train_policy(seconds)
    in_the_end, ever = score_policy(policy, num_tasks)
    planned, takes_s, learned_s = score_agent(num_tasks)
    print(f"policy: {in_the_end:.0%} of {num_tasks} tasks reached in the end, {ever:.0%} at all")
    print(f"agent: {planned:.0%}, in {takes_s:.0f} s, after {learned_s:.0f} s of learning")
    return in_the_end, ever, planned


if __name__ == "__main__":
    main(*map(float, sys.argv[1:2]))
