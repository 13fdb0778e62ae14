"""Files after learning, finished or interrupted."""

import dataclasses
import shutil
import warnings

import numpy as np
import pytest
from scipy.spatial import procrustes
from scipy.spatial.distance import pdist

from selftouch_drake.agent.representation.estimator import QuotientLearner
from selftouch_drake.agent.shape.recovery import recover
from selftouch_drake.evaluation.shape import kernel_truth
from selftouch_drake.experience.store import (
    Contacts,
    ExperienceReader,
    Shard,
    StoreError,
    write_shard,
)
from selftouch_drake.experiment import load_experiment
from selftouch_drake.files import load_arrays, save_arrays
from selftouch_drake.quotient.graph import DisconnectedWarning
from selftouch_drake.robot import World
from selftouch_drake.run import artifacts, scores, stages
from selftouch_drake.run.artifacts import load_body, load_representation
from selftouch_drake.run.directory import RunDirectory, RunError
from selftouch_drake.run.metrics import METRICS

NUM_ROWS, WALK_SIZE = 1500, 500


@pytest.fixture(scope="module")
def babbled(tmp_path_factory):
    """A run that felt a sphere with 20 receptors: no world was built."""
    experiment = load_experiment(
        "sphere",
        {
            "skins": {"body": {"num_receptors": 20}},
            "babbling": {"num_samples": NUM_ROWS, "walk_size": WALK_SIZE},
            "representation": {
                "num_targets": 50,
                "metric": "sensorimotor",
                "body_model": "off",  # tests/run/test_modelling.py
            },
        },
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
            num_impossible=0,
            step=np.arange(WALK_SIZE),
            q=q[rows],
            sensation=sensation[rows],
            contacts=Contacts(
                offsets=np.arange(WALK_SIZE + 1),
                skin=np.zeros(WALK_SIZE, np.int8),
                toucher=np.zeros(WALK_SIZE, np.int8),
                p_LC=0.25 * touched[rows].astype(np.float32),
            ),
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


def test_what_was_learned_and_what_it_came_from_are_reported(learned):
    figures = learned.metrics()
    assert figures["representation_num_targets"] == 50
    assert figures["graph_component_sizes"] == [50]
    assert "graph_bridges" not in figures
    distances = load_arrays(learned.body_distances)["distances"]
    assert distances.shape == (50, 50)
    assert np.isfinite(distances).all()
    assert figures["parts_found"] == 1
    assert figures["representation_num_set_aside"] == 0
    assert len(figures["topology_betti"]) == 3
    assert "topology_betti_by_part" not in figures
    # Every figure is in the table, so that the next learning drops it.
    assert set(figures) <= {metric.key for metric in METRICS}


def test_what_was_recovered_is_read_back_as_it_was(learned):
    representation = load_representation(learned)
    found = load_body(learned, representation)
    made = recover(representation, "sensorimotor", seed=learned.experiment.seed)
    assert (found.metric, found.num_kernels) == (made.metric, made.num_kernels)
    np.testing.assert_array_equal(found.positions, made.positions)
    np.testing.assert_allclose(found.distances, made.distances, rtol=1e-6)
    for there, here in zip(found.parts, made.parts, strict=True):
        np.testing.assert_array_equal(there.kernels, here.kernels)
        np.testing.assert_array_equal(there.places, here.places)
        assert there.dimension == here.dimension
        assert there.embedding.stress == here.embedding.stress
        assert there.embedding.fourth_eigenvalue == here.embedding.fourth_eigenvalue
        assert there.topology.betti == here.topology.betti
        assert there.topology.scale == here.topology.scale
        for bars, same in zip(there.topology.diagram, here.topology.diagram, strict=True):
            np.testing.assert_array_equal(bars, same)


def test_one_part_keeps_the_names_that_topology_had(learned):
    arrays = load_arrays(learned.topology, ["diagram_0", "diagram_1", "diagram_2", "pieces"])
    assert not any(name.startswith("part_") for name in arrays)


def test_learning_again_drops_what_was_made_from_the_old(run):
    before = run.representation.read_bytes()
    stages.learn(run)
    assert run.representation.read_bytes() == before
    assert not run.plan(1, 2).exists()
    figures = run.metrics()
    assert "shape_rms_fraction" not in figures
    assert "execution_num_pairs" not in figures
    assert "coverage_evenness" not in figures
    assert figures["babbling_num_samples"] == NUM_ROWS
    assert stages.has_learned(run)


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ValueError("cannot be learned from")])
@pytest.mark.parametrize("moment", ["target sensations", "quotient graph", "shape and holes"])
def test_interrupted_learning_changes_nothing(run, error, moment):
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

    monkeypatch.setattr(artifacts, "save_arrays", full_disk)
    with pytest.raises(OSError, match="No space"):
        stages.learn(run)
    assert content(run) == before


def test_shards_give_what_one_array_gives(learned):
    reader = ExperienceReader(learned.experience)
    learner = QuotientLearner(num_targets=50, random_state=learned.experiment.seed)
    whole = learner.fit(reader.read("sensation"), reader.read("q")).representation_
    stored = load_representation(learned)
    assert whole.kernel_row.tolist() == stored.kernel_row.tolist()
    np.testing.assert_array_equal(whole.set_distance, stored.set_distance)


def test_evaluation_without_truth_or_in_part_names_what_is_missing(run):
    before = content(run)
    (run.truth / "part-00001.parquet").unlink()
    with pytest.raises(StoreError, match="is missing; collect it again with") as error:
        stages.evaluate(run)
    assert str(error.value).startswith(str(run.truth / "part-00001.parquet"))
    before.pop((run.truth / "part-00001.parquet").relative_to(run.path))
    assert content(run) == before


def test_scores_against_the_truth(run):
    motor = dataclasses.replace(run.experiment.evaluation, shape_metrics=["motor"])
    run = dataclasses.replace(run, experiment=dataclasses.replace(run.experiment, evaluation=motor))
    representation = load_representation(run)
    body, world = load_body(run, representation), World(run.experiment)
    figures = scores.score_body(run, world, representation, body)
    contacts = ExperienceReader(run.truth).take_contacts(representation.kernel_row)
    truth = kernel_truth(representation, contacts, world.receptor_skin)
    on_surface = truth.on_surface([skin.fields for skin in world.skins])
    for key, true in (("surface", on_surface.positions), ("shape", truth.positions)):
        _, _, disparity = procrustes(true, body.positions)
        rms = np.sqrt(disparity * np.square(true - true.mean(axis=0)).sum() / len(true))
        assert figures[f"{key}_rms_fraction"] == pytest.approx(rms / pdist(true).max())
    assert 0.9 < figures["trustworthiness"] <= 1.0
    assert 0.9 < figures["continuity"] <= 1.0
    assert 0.0 < figures["shape_rms_fraction"] < 0.1
    distortion = figures["distance_distortion_median_fraction_by_metric"]
    assert set(distortion) == set(figures["shape_rms_fraction_by_metric"])
    assert set(distortion) == {"motor", "sensorimotor"}
    assert 0.0 < figures["distance_distortion_median_fraction"] < 0.3
    assert figures["parts_true"] == 1
    assert set(figures) <= {metric.key for metric in METRICS}
    # What means nothing for one skin is absent.
    assert not [key for key in figures if key.endswith("_by_skin")]
    assert "topology_betti_true_by_part" not in figures


def test_the_recovered_body_has_to_be_there(run):
    representation = load_representation(run)
    run.body_distances.unlink()
    assert not stages.has_learned(run)
    with pytest.raises(RunError, match="is missing; run `selftouch learn"):
        load_body(run, representation)


def test_touches_at_two_places_have_no_shape(run, babbled):
    """Every touch has two fingers: a kernel is a pose of the hand, not a place."""
    for walk, contacts in enumerate(ExperienceReader(babbled.truth).contacts()):
        felt = list(ExperienceReader(babbled.experience).touches())[walk]
        two = Contacts(
            offsets=2 * contacts.offsets,
            skin=np.repeat(contacts.skin, 2),
            toucher=np.tile(np.array([0, 1], np.int8), WALK_SIZE),
            p_LC=np.repeat(contacts.p_LC, 2, axis=0),
        )
        shard = Shard(
            walk=walk,
            num_steps=WALK_SIZE,
            num_impossible=0,
            step=np.arange(WALK_SIZE),
            q=felt[1],
            sensation=felt[0],
            contacts=two,
        )
        write_shard(run.path, shard, fingerprint=run.fingerprint())
    representation = load_representation(run)
    figures = scores.score_body(
        run, World(run.experiment), representation, load_body(run, representation)
    )
    assert set(figures) == {
        "coverage_share_10_touches",
        "coverage_share_100_touches",
        "coverage_evenness",
    }


def test_a_graph_in_parts_is_in_the_figures(run, monkeypatch):
    def apart(near, num_mutual=12, num_kept=5):
        i, j = np.triu_indices(len(near), 1)
        return np.stack([i, j], axis=1)[(i < 10) == (j < 10)]

    monkeypatch.setattr("selftouch_drake.quotient.graph.neighbour_edges", apart)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        stages.learn(run)
    assert {warning.category for warning in caught} == {DisconnectedWarning}
    assert run.metrics()["graph_component_sizes"] == [40, 10]
    ((i, j),) = run.metrics()["graph_bridges"]
    assert i < 10 <= j
