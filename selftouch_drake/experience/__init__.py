"""Random walks in motor space, and the experience that they collect, on disk."""

from selftouch_drake.experience.collect import (
    collect,
    collect_walk,
    how_to_collect,
    random_walk,
    require_complete,
    walk_sizes,
)
from selftouch_drake.experience.store import (
    Contacts,
    ExperienceReader,
    Shard,
    StoreError,
    write_shard,
)
from selftouch_drake.experience.walk import RandomWalk

__all__ = [
    "Contacts",
    "ExperienceReader",
    "RandomWalk",
    "Shard",
    "StoreError",
    "collect",
    "collect_walk",
    "how_to_collect",
    "random_walk",
    "require_complete",
    "walk_sizes",
    "write_shard",
]
