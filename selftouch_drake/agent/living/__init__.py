"""What the agent knows while it lives: it learns from touches as they come."""

from selftouch_drake.agent.living.learner import LivingLearner

__all__ = ["LivingLearner"]
