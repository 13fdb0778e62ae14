"""Recordings for `selftouch score`, as the benchmark makes them."""

import numpy as np
import pytest

from selftouch_drake.files import load_arrays
from selftouch_drake.resources import RECORDINGS


@pytest.mark.slow
def test_the_same_command_gives_the_same_bytes(tmp_path):
    from benchmarks.make import recordings

    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
        recordings.make("raw", 5, tmp_path / folder)
    for name in ("raw_5.npz", "raw_5.truth.npz"):
        assert (tmp_path / "first" / name).read_bytes() == (tmp_path / "second" / name).read_bytes()
    given = load_arrays(tmp_path / "first" / "raw_5.npz")
    true = load_arrays(tmp_path / "first" / "raw_5.truth.npz")
    assert given["sensation"].dtype == np.uint8
    # What is felt stands out only in rows with a touch.
    risen = given["sensation"].astype(float) - np.median(given["sensation"], axis=0)
    touching = np.isfinite(true["touch_places"]).all(axis=1)
    most = np.quantile(risen[~touching].max(axis=1), 0.99)
    assert most < 10 < np.median(risen[touching].max(axis=1))


@pytest.mark.parametrize("name", ["cube_1", "torus_1", "two_arms_1"])
def test_a_shipped_recording_is_whole_and_its_truth_is_apart(name):
    given = load_arrays(RECORDINGS / f"{name}.npz")
    true = load_arrays(RECORDINGS / f"{name}.truth.npz")
    assert set(given) == {"q", "sensation", "pairs"}
    assert len(given["q"]) == len(given["sensation"]) == len(true["cell"])
    assert given["sensation"].any(axis=1).all()
    cells = np.bincount(true["cell"][true["cell"] >= 0])
    assert len(cells) == len(true["cell_part"]) == len(true["cell_receptors"])
    assert cells.min() >= 5
    first, last = true["cell_part"][true["cell"][given["pairs"]]].T
    assert len(first) == 20
    assert (first == last).all()
    np.testing.assert_allclose(true["cell_receptors"].sum(axis=1), 1.0, rtol=1e-4)
