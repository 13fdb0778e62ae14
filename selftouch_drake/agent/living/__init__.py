"""What the agent knows while it lives: it learns from touches as they come, notices and mends."""

from selftouch_drake.agent.living.learner import LivingLearner
from selftouch_drake.agent.living.life import Life, Noticed
from selftouch_drake.agent.living.mending import Mending, understand
from selftouch_drake.agent.living.surprise import Alarm, Expectation

__all__ = [
    "Alarm",
    "Expectation",
    "Life",
    "LivingLearner",
    "Mending",
    "Noticed",
    "understand",
]
