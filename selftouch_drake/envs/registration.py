"""The names of the environments for `gymnasium.make`."""

from __future__ import annotations

from typing import Any

import gymnasium

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
    """The names of all environments."""
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
