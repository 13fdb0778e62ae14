"""What the agent knows while it lives: it learns from touches as they come, and explores."""

from selftouch_drake.agent.living.explorer import Explorer, Joints, Manner
from selftouch_drake.agent.living.learner import LivingLearner

__all__ = ["Explorer", "Joints", "LivingLearner", "Manner"]
