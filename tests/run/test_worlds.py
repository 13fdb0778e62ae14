from types import SimpleNamespace

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.experience.store import ExperienceReader, shards_of
from selftouch_drake.run import worlds


def test_touches_that_a_body_met_replace_no_others(tmp_path):
    run = SimpleNamespace(
        path=tmp_path, met=tmp_path / "met", added=tmp_path / "added", fingerprint=lambda: "this"
    )

    def keep(number):
        touch = np.full((1, 2), number, np.float32)
        worlds._keep_met(run, touch, csr_array(touch))

    for number in (1, 2, 3):
        keep(number)
    shards_of(run.met)[1].unlink()
    run.added.mkdir()
    last = shards_of(run.met)[-1]
    last.rename(run.added / last.name)
    for number in (4, 5):
        keep(number)
    assert ExperienceReader(run.met).read("q")[:, 0].tolist() == [1, 4, 5]
    assert ExperienceReader(run.added).read("q")[:, 0].tolist() == [3]
