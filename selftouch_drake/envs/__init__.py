"""Self-touch as Gymnasium environments; importing this registers them.

`gymnasium.make("selftouch_drake.envs:SelfTouch/Torus-v0")` imports it as well.
"""

from selftouch_drake.envs.environment import SelfTouchEnv, Truth
from selftouch_drake.envs.goals import ReachEnv, SlideEnv, likeness
from selftouch_drake.envs.registration import environments, register

register()

__all__ = [
    "ReachEnv",
    "SelfTouchEnv",
    "SlideEnv",
    "Truth",
    "environments",
    "likeness",
    "register",
]
