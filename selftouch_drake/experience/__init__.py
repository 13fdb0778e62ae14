"""The on-disk store of touching motor configurations and their sensations."""

from selftouch_drake.experience.store import (
    ExperienceReader,
    Shard,
    StoreError,
    read_num_steps,
    shard_name,
    write_shard,
)

__all__ = [
    "ExperienceReader",
    "Shard",
    "StoreError",
    "read_num_steps",
    "shard_name",
    "write_shard",
]
