"""The bodies of a run are those with which it felt."""

import numpy as np
import pytest

from selftouch_drake.bodies.embodiment import bodies_of
from selftouch_drake.files import load_arrays, save_arrays
from selftouch_drake.run.directory import RunError
from selftouch_drake.run.worlds import make_world, run_bodies


@pytest.fixture(autouse=True)
def _forgets_bodies(small_run):
    bodies_of.keep(None, small_run.experiment, "another run")  # as in a new process
    yield
    bodies_of.keep(None, small_run.experiment, "another run")


def test_a_run_opens_with_the_skin_with_which_it_felt(small_run):
    assert [skin.name for skin in make_world(small_run).skins] == ["body"]


@pytest.mark.parametrize("key", ["faces", "p_LS"])
def test_a_skin_that_is_made_otherwise_now_is_refused(small_run, key):
    """Its readings would mean other receptors, and nobody would say so."""
    arrays = load_arrays(small_run.skin)
    arrays[f"body_{key}"] = np.roll(arrays[f"body_{key}"], 1, axis=0)
    save_arrays(small_run.skin, arrays)
    with pytest.raises(RunError, match=r"felt with another skin 'body': an older version .* again"):
        run_bodies(small_run)
