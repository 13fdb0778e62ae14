"""Independent streams of randomness, all from one seed."""

import numpy as np

# Purposes of randomness; add a new one at the end, so that the streams of the others do not change.
STREAMS = ("walk", "pairs", "start", "skin", "joints", "explorer", "changes")


def random_stream(seed: int, purpose: str, *index: int) -> np.random.SeedSequence:
    """An independent stream for one of `STREAMS`, numbered by `index`."""
    return np.random.SeedSequence(seed, spawn_key=(STREAMS.index(purpose), *index))
