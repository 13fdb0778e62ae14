"""Random walks in motor space, and the experience they give, on disk."""

from selftouch_drake.experience.collect import (
    NeverTouchesError,
    collect,
    collect_walk,
    require_complete,
    walk_sizes,
)
from selftouch_drake.experience.store import (
    ExperienceReader,
    Shard,
    StoreError,
    read_num_steps,
    shard_name,
    write_shard,
)
from selftouch_drake.experience.walk import RandomWalk

__all__ = [
    "ExperienceReader",
    "NeverTouchesError",
    "RandomWalk",
    "Shard",
    "StoreError",
    "collect",
    "collect_walk",
    "read_num_steps",
    "require_complete",
    "shard_name",
    "walk_sizes",
    "write_shard",
]
