"""Self-touch as Gymnasium environments; importing this registers them.

`gymnasium.make("selftouch_drake.envs:SelfTouch/Torus-v0")` imports it as well.
"""

from typing import Any

import gymnasium

from selftouch_drake.envs.environment import SelfTouchEnv, Truth
from selftouch_drake.envs.goals import ReachEnv, SlideEnv, likeness
from selftouch_drake.envs.vector import ReachVectorEnv, SelfTouchVectorEnv, SlideVectorEnv

__all__ = [
    "ReachEnv",
    "ReachVectorEnv",
    "SelfTouchEnv",
    "SelfTouchVectorEnv",
    "SlideEnv",
    "SlideVectorEnv",
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
    "": ("environment:SelfTouchEnv", "vector:SelfTouchVectorEnv", 1000),
    "Reach": ("goals:ReachEnv", "vector:ReachVectorEnv", 200),
    "Slide": ("goals:SlideEnv", "vector:SlideVectorEnv", 200),
}


def environments() -> list[str]:
    """The names of all environments, of one robot under dynamics or of many without."""
    return [f"SelfTouch/{robot}{task}-v0" for robot in _ROBOTS for task in _TASKS]


def register() -> None:
    """Registers the environments with Gymnasium; known ones stay as they are."""
    folder = "selftouch_drake.envs"
    for robot, kwargs in _ROBOTS.items():
        for task, (one, many, max_episode_steps) in _TASKS.items():
            name = f"SelfTouch/{robot}{task}-v0"
            if name not in gymnasium.registry:
                gymnasium.register(
                    name,
                    f"{folder}.{one}",
                    vector_entry_point=f"{folder}.{many}",
                    max_episode_steps=max_episode_steps,
                    kwargs=dict(kwargs),
                )
            # The name that many robots had alone, before both shared one.
            name = f"SelfTouch/{robot}{task}Kinematic-v0"
            if name not in gymnasium.registry:
                gymnasium.register(
                    name,
                    vector_entry_point=f"{folder}.vector:SelfTouchVectorEnv",
                    max_episode_steps=max_episode_steps,
                    kwargs={"task": task, **kwargs},
                )


register()
