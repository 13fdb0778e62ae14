"""Steps per second of Gymnasium environments, one copy and several. Run it as a script.

Beside them is MuJoCo's humanoid, if `gymnasium[mujoco]` is installed. A step of the humanoid is
0.015 s of its time, one of ours 0.05 s: the last column compares them. Of robots without dynamics
(`...Kinematic-v0`) each copy is a process with 64 of them.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor

import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv, VectorEnv

from selftouch_drake import envs

HUMANOID = "Humanoid-v5"
KINEMATIC = "Kinematic-v0"
#: Robots in one process.
TOGETHER = 64
# What a step costs is the robot's; only `Slide` looks more often, and one of it shows that.
MEASURED = [
    *(f"SelfTouch/{robot}-v0" for robot in ("Torus", "Cube", "Sphere", "TwoArms", "Infant")),
    "SelfTouch/CubeSlide-v0",
    *(f"SelfTouch/{robot}{KINEMATIC}" for robot in ("Torus", "TorusReach", "Infant")),
]


def actions(space: gymnasium.spaces.Box, num_steps: int) -> np.ndarray:
    """`(num_steps, J)` a slow random walk between the ends of the space."""
    random = np.random.default_rng(0)
    walk = np.sin(np.cumsum(random.normal(0.0, 0.2, (num_steps, *space.shape)), axis=0))
    return (space.low + (space.high - space.low) * (walk + 1) / 2).astype(np.float32)


def steps_a_second(name: str, num_copies: int, num_steps: int) -> float:
    """Steps per second of all copies together, without building and resetting them."""
    if name.endswith(KINEMATIC):
        with ProcessPoolExecutor(num_copies, multiprocessing.get_context("spawn")) as executor:
            rates = executor.map(kinematic_rate, [name] * num_copies, [num_steps] * num_copies)
            return sum(rates)
    copies = AsyncVectorEnv([lambda: gymnasium.make(name)] * num_copies)
    try:
        chosen = actions(copies.single_action_space, num_steps)
        return rate(copies, np.repeat(chosen[:, None], num_copies, axis=1))
    finally:
        copies.close()


def kinematic_rate(name: str, num_steps: int) -> float:
    """Steps per second of robots without dynamics in this process."""
    robots = gymnasium.make_vec(name, num_envs=TOGETHER)
    return rate(robots, actions(robots.action_space, num_steps))


def rate(robots: VectorEnv, chosen: np.ndarray) -> float:
    """Steps per second of robots that take actions `(steps, robots, joints)`."""
    robots.reset(seed=0)
    robots.step(chosen[0])
    began = time.perf_counter()
    for action in chosen:
        robots.step(action)
    return robots.num_envs * len(chosen) / (time.perf_counter() - began)


def step_s(name: str) -> float:
    """s of simulated time per step of an environment."""
    name = name.replace(KINEMATIC, "-v0")
    env = gymnasium.make(name)
    found = env.unwrapped.period_s if name in envs.environments() else env.unwrapped.dt
    env.close()
    return float(found)


def has_mujoco() -> bool:
    """Whether MuJoCo's humanoid is installed."""
    try:
        gymnasium.make(HUMANOID).close()
    except (ImportError, gymnasium.error.DependencyNotInstalled):
        return False
    return True


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=500, help="of each copy")
    parser.add_argument("--copies", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--environments", nargs="+", default=MEASURED)
    arguments = parser.parse_args()
    names = list(arguments.environments)
    if has_mujoco():
        names.append(HUMANOID)
    else:
        print("no humanoid: install gymnasium[mujoco] to compare with it\n")
    head = " | ".join(f"{n} {'copy' if n == 1 else 'copies'}" for n in arguments.copies)
    print(f"| environment | {head} | times real time, {max(arguments.copies)} copies |")
    print("|---" * (len(arguments.copies) + 2) + "|")
    for name in names:
        rates = [steps_a_second(name, n, arguments.steps) for n in arguments.copies]
        row = " | ".join(f"{rate:,.0f}" for rate in rates)
        print(f"| `{name}` | {row} | {rates[-1] * step_s(name):.1f} |", flush=True)


if __name__ == "__main__":
    main()
