"""Random walks in motor space, and the experience they give."""

from selftouch_drake.babbling.collect import (
    NeverTouchesError,
    collect,
    collect_walk,
    require_complete,
    walk_sizes,
)
from selftouch_drake.babbling.walk import RandomWalk

__all__ = [
    "NeverTouchesError",
    "RandomWalk",
    "collect",
    "collect_walk",
    "require_complete",
    "walk_sizes",
]
