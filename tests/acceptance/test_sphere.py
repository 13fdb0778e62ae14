"""One finger on a sphere: shape and holes, also from a recording of the same touches."""

import numpy as np
import pytest
from acceptance_runs import made, metrics_of, selftouch
from made_once import made_once

from selftouch_drake.experience.store import ExperienceReader

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    sizes = {"touches": 25_000, "targets": 150, "pairs": 0}
    return made_once(tmp_path_factory, "sphere", lambda path: made(path, "sphere", **sizes))


def test_the_sphere_is_recovered(run):
    metrics = metrics_of(run)
    assert metrics["topology_betti"] == [1, 0, 1]
    # 1.4 to 1.5 % with three seeds.
    assert metrics["surface_rms_fraction"] < 0.022
    assert metrics["shape_trusted"] is True


def test_the_agent_knows_how_exact_its_sphere_is(run):
    metrics = metrics_of(run)
    ratio = metrics["shape_expected_error"] / metrics["surface_rms_fraction"]
    # 0.89 to 1.11 with three seeds.
    assert 0.65 < ratio < 1.7


def test_a_recording_of_the_sphere_is_recovered(run, tmp_path):
    touches = [(q, sensation) for sensation, q in ExperienceReader(run / "experience").touches()]
    q, sensation = (np.concatenate(part) for part in zip(*touches, strict=True))
    rng = np.random.default_rng(0)
    # Eight bits above offsets, and a fifth of the rows without touch.
    nothing = np.zeros((len(q) // 4, sensation.shape[1]))
    force = np.vstack([sensation, nothing])
    order = rng.permutation(len(force))
    counts = np.rint(rng.uniform(20, 60, force.shape[1]) + 30.0 * force).clip(0, 255)
    joints = np.vstack([q, rng.uniform(q.min(axis=0), q.max(axis=0), (len(nothing), q.shape[1]))])
    useless = rng.uniform(-1.0, 1.0, (len(joints), 1))
    np.savez(
        tmp_path / "recording.npz",
        q=np.hstack([joints, useless])[order].astype(np.float32),
        sensation=counts[order].astype(np.uint8),
    )
    imported = tmp_path / "run"
    fewer = "{representation: {num_targets: 150, body_model: off}}"
    assert selftouch("import", tmp_path / "recording.npz", "--out", imported, "--set", fewer) == 0
    assert selftouch("learn", imported) == 0
    assert metrics_of(imported)["topology_betti"] == [1, 0, 1]
    assert metrics_of(imported)["shape_trusted"] is True
