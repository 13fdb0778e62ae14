"""Learning that never stops: the agent explores, learns, notices changes and adapts to them."""

from selftouch_drake.agent.lifelong.body_change import BodyChange, explain_change
from selftouch_drake.agent.lifelong.explorer import ExplorationSettings, Explorer, JointRanges
from selftouch_drake.agent.lifelong.learner import OnlineLearner
from selftouch_drake.agent.lifelong.life import Life, Noticed
from selftouch_drake.agent.lifelong.posture_sampler import PostureSampler
from selftouch_drake.agent.lifelong.surprise import Alarm, Expectation

__all__ = [
    "Alarm",
    "BodyChange",
    "Expectation",
    "ExplorationSettings",
    "Explorer",
    "JointRanges",
    "Life",
    "Noticed",
    "OnlineLearner",
    "PostureSampler",
    "explain_change",
]
