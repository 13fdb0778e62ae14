"""Random walks in motor space, and the experience that they collect, on disk."""

from selftouch_drake.experience.collect import (
    NeverTouchesError,
    collect,
    collect_walk,
    how_to_collect,
    random_walk,
    require_complete,
    walk_sizes,
)
from selftouch_drake.experience.recording import Recording, RecordingError, read_recording
from selftouch_drake.experience.store import (
    Contacts,
    ExperienceReader,
    Shard,
    StoreError,
    WalkCounts,
    read_counts,
    shard_name,
    write_shard,
)
from selftouch_drake.experience.walk import RandomWalk

__all__ = [
    "Contacts",
    "ExperienceReader",
    "NeverTouchesError",
    "RandomWalk",
    "Recording",
    "RecordingError",
    "Shard",
    "StoreError",
    "WalkCounts",
    "collect",
    "collect_walk",
    "how_to_collect",
    "random_walk",
    "read_counts",
    "read_recording",
    "require_complete",
    "shard_name",
    "walk_sizes",
    "write_shard",
]
