"""What learning leaves when it comes to its end, and when it does not."""

import shutil
import warnings

import numpy as np
import pytest

from selftouch_drake.agent.representation import DisconnectedWarning, QuotientRepresentation
from selftouch_drake.experience import ExperienceReader, Shard, StoreError, write_shard
from selftouch_drake.experiment import Babbling, Body, Experiment, Representation, Skin
from selftouch_drake.files import load_arrays, save_arrays
from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory, RunError

NUM_ROWS, WALK_SIZE = 1500, 500


@pytest.fixture(scope="module")
def babbled(tmp_path_factory):
    """A run that felt a sphere with 20 receptors: no world was built."""
    experiment = Experiment(
        body=Body(shape="sphere", radius=0.25),
        skin=Skin(num_receptors=20),
        babbling=Babbling(num_samples=NUM_ROWS, walk_size=WALK_SIZE),
        representation=Representation(num_targets=50, metric="sensorimotor"),
    )
    run = RunDirectory.create(tmp_path_factory.mktemp("stages") / "run", experiment)
    rng = np.random.default_rng(0)
    touched, receptors = (rng.normal(size=(n, 3)) for n in (NUM_ROWS, 20))
    touched /= np.linalg.norm(touched, axis=1, keepdims=True)
    receptors /= np.linalg.norm(receptors, axis=1, keepdims=True)
    sensation = 1e-6 + np.clip(touched @ receptors.T, 0.0, None) ** 3
    q = np.hstack([touched, rng.uniform(-0.3, 0.3, (NUM_ROWS, 3))])
    for walk, rows in enumerate(np.arange(NUM_ROWS).reshape(-1, WALK_SIZE)):
        shard = Shard(
            walk=walk,
            num_steps=WALK_SIZE,
            step=np.arange(WALK_SIZE),
            q=q[rows],
            sensation=sensation[rows],
            p_WF=0.25 * touched[rows],
        )
        write_shard(run.path, shard, fingerprint=run.fingerprint())
    run.add_metrics({"babbling_num_samples": NUM_ROWS})
    return run


@pytest.fixture(scope="module")
def learned(babbled, tmp_path_factory):
    path = tmp_path_factory.mktemp("stages") / "learned"
    shutil.copytree(babbled.path, path)
    run = RunDirectory.open(path)
    stages.learn(run)
    return run


@pytest.fixture
def run(learned, tmp_path):
    shutil.copytree(learned.path, tmp_path / "run")
    run = RunDirectory.open(tmp_path / "run")
    run.add_metrics({"shape_rms_fraction": 0.1, "execution_num_pairs": 3, "coverage_evenness": 1.0})
    save_arrays(run.plan(1, 2), {"q": np.zeros(3)})
    return run


def content(run):
    return {p.relative_to(run.path): p.read_bytes() for p in run.path.rglob("*") if p.is_file()}


def test_what_was_learned_and_what_it_came_from_are_told(learned):
    figures = learned.metrics()
    assert figures["representation_num_targets"] == 50
    assert figures["graph_component_sizes"] == [50]
    assert "graph_bridges" not in figures
    distances = load_arrays(learned.body_distances)["distances"]
    assert distances.shape == (50, 50)
    assert np.isfinite(distances).all()


def test_learning_again_drops_what_was_made_from_the_old(run):
    before = run.representation.read_bytes()
    stages.learn(run)
    assert run.representation.read_bytes() == before
    assert not run.plan(1, 2).exists()
    figures = run.metrics()
    assert "shape_rms_fraction" not in figures
    assert "execution_num_pairs" not in figures
    assert figures["coverage_evenness"] == 1.0
    assert stages.has_learned(run)


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ValueError("cannot be learned from")])
@pytest.mark.parametrize("moment", ["target sensations", "quotient graph", "shape", "holes"])
def test_learning_that_does_not_end_changes_nothing(run, error, moment):
    before = content(run)

    def stop(fraction, doing):
        if doing == moment:
            raise error

    with pytest.raises(type(error)):
        stages.learn(run, stop)
    assert content(run) == before


def test_a_full_disk_changes_nothing(run, monkeypatch):
    before = content(run)

    def full_disk(path, arrays):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(stages, "save_arrays", full_disk)
    with pytest.raises(OSError, match="No space"):
        stages.learn(run)
    assert content(run) == before


def test_shards_give_what_one_array_gives(learned):
    reader = ExperienceReader(learned.experience)
    learner = stages.QuotientLearner(num_targets=50, random_state=learned.experiment.seed)
    whole = learner.fit(reader.read("sensation"), reader.read("q")).representation_
    stored = QuotientRepresentation.load(learned.representation)
    assert whole.kernel_row.tolist() == stored.kernel_row.tolist()
    np.testing.assert_array_equal(whole.set_distance, stored.set_distance)


def test_evaluation_without_truth_or_in_part_names_what_is_missing(run):
    before = content(run)
    (run.truth / "part-00001.parquet").unlink()
    with pytest.raises(StoreError, match="is missing; collect it again with") as error:
        stages.evaluate(run, stages.World(run.experiment))
    assert str(error.value).startswith(str(run.truth / "part-00001.parquet"))
    before.pop((run.truth / "part-00001.parquet").relative_to(run.path))
    assert content(run) == before


def test_scores_against_the_truth(run, monkeypatch):
    some = {name: stages.METRICS[name] for name in ("motor", "sensorimotor", "revolute_reference")}
    monkeypatch.setattr(stages, "METRICS", some)
    world = stages.World(run.experiment)
    figures = stages._score_against_truth(run, world, stages.load_representation(run))
    assert 0.9 < figures["trustworthiness"] <= 1.0
    assert 0.9 < figures["continuity"] <= 1.0
    distortion = figures["distance_distortion_median_fraction_by_metric"]
    naive = {"motor", "sensorimotor"}
    assert set(distortion) == set(figures["shape_rms_fraction_by_metric"]) == naive
    assert 0.0 < figures["distance_distortion_median_fraction"] < 0.3
    run.body_distances.unlink()
    assert not stages.has_learned(run)
    with pytest.raises(RunError, match="is not there; run `selftouch learn"):
        stages._score_against_truth(run, world, stages.load_representation(run))


def test_a_graph_in_parts_is_told_in_the_figures(run, monkeypatch):
    def apart(near, num_mutual=12, num_kept=5):
        i, j = np.triu_indices(len(near), 1)
        return np.stack([i, j], axis=1)[(i < 10) == (j < 10)]

    monkeypatch.setattr("selftouch_drake.agent.representation.learner.neighbour_edges", apart)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        stages.learn(run)
    assert {warning.category for warning in told} == {DisconnectedWarning}
    assert run.metrics()["graph_component_sizes"] == [40, 10]
    ((i, j),) = run.metrics()["graph_bridges"]
    assert i < 10 <= j
