"""Learning that never stops: the agent explores, learns, notices changes and adapts to them."""

from selftouch_drake.agent.living.explorer import Explorer, Joints, Manner
from selftouch_drake.agent.living.learner import LivingLearner
from selftouch_drake.agent.living.life import Life, Noticed
from selftouch_drake.agent.living.mending import Mending, understand
from selftouch_drake.agent.living.searcher import Searcher
from selftouch_drake.agent.living.surprise import Alarm, Expectation

__all__ = [
    "Alarm",
    "Expectation",
    "Explorer",
    "Joints",
    "Life",
    "LivingLearner",
    "Manner",
    "Mending",
    "Noticed",
    "Searcher",
    "understand",
]
