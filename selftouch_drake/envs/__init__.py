"""Self-touch as Gymnasium environments; importing this registers them.

`gymnasium.make("selftouch_drake.envs:SelfTouch/Torus-v0")` imports it as well.
"""

from typing import Any

import gymnasium

from selftouch_drake.envs.environment import SelfTouchEnv, Truth
from selftouch_drake.envs.goals import ReachEnv, SlideEnv, likeness
from selftouch_drake.envs.vector import SelfTouchVectorEnv

__all__ = [
    "ReachEnv",
    "SelfTouchEnv",
    "SelfTouchVectorEnv",
    "SlideEnv",
    "Truth",
    "environments",
    "likeness",
    "register",
]

# Names of robots, and their experiments; for `Robot`, `gymnasium.make` takes the experiment.
_ROBOTS: dict[str, dict[str, Any]] = {
    "Torus": {"experiment": "torus"},
    "Cube": {"experiment": "cube"},
    "Sphere": {"experiment": "sphere"},
    "TwoArms": {"experiment": "two_arms"},
    "Infant": {"experiment": "infant"},
    "Robot": {},
}
# Tasks with their classes and steps per episode: 50 s, or 10 s to reach a sensation.
_TASKS = {
    "": ("selftouch_drake.envs.environment:SelfTouchEnv", 1000),
    "Reach": ("selftouch_drake.envs.goals:ReachEnv", 200),
    "Slide": ("selftouch_drake.envs.goals:SlideEnv", 200),
}


def environments() -> list[str]:
    """The names of all environments under dynamics; `...Kinematic-v0` are many robots at once."""
    return [f"SelfTouch/{robot}{task}-v0" for robot in _ROBOTS for task in _TASKS]


def register() -> None:
    """Registers the environments with Gymnasium; known ones stay as they are."""
    for robot, kwargs in _ROBOTS.items():
        for task, (entry_point, max_episode_steps) in _TASKS.items():
            name = f"SelfTouch/{robot}{task}-v0"
            if name not in gymnasium.registry:
                gymnasium.register(
                    name, entry_point, max_episode_steps=max_episode_steps, kwargs=dict(kwargs)
                )
            many = f"SelfTouch/{robot}{task}Kinematic-v0"
            if many not in gymnasium.registry:
                gymnasium.register(
                    many,
                    vector_entry_point="selftouch_drake.envs.vector:SelfTouchVectorEnv",
                    max_episode_steps=max_episode_steps,
                    kwargs={"task": task, **kwargs},
                )


register()
