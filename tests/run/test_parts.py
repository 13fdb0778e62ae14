"""A robot with three skins: what is learned, planned and scored part by part."""

import dataclasses
import json

import numpy as np
import pytest

from selftouch_drake.evaluation.motion import random_pairs
from selftouch_drake.evaluation.parts import TruePart
from selftouch_drake.evaluation.shape import KernelTruth
from selftouch_drake.experience.store import Contacts, Shard, write_shard
from selftouch_drake.experiment import load_experiment
from selftouch_drake.files import load_arrays
from selftouch_drake.robot import World
from selftouch_drake.run import scores, stages
from selftouch_drake.run.artifacts import load_body, load_representation
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.metrics import METRICS, metric_texts, tiles

PER_SKIN = (1500, 600, 600)
SKINS = ("body", "left_forearm", "right_forearm")


@pytest.fixture(scope="module")
def world():
    skins = {name: {"num_receptors": 30} for name in SKINS}
    experiment = load_experiment(
        "two_arms",
        {
            "skins": skins,
            "babbling": {"num_samples": sum(PER_SKIN), "walk_size": 10_000},
            "representation": {"num_targets": 110, "metric": "sensorimotor", "body_model": "off"},
            "evaluation": {"num_pairs": 40, "shape_metrics": []},
        },
    )
    return World(experiment)


@pytest.fixture(scope="module")
def run(world, tmp_path_factory):
    """A run with a touch at each place of each skin; no robot moved."""
    rng = np.random.default_rng(0)
    run = RunDirectory.create(tmp_path_factory.mktemp("parts") / "run", world.experiment)
    sensation = np.zeros((sum(PER_SKIN), 90))
    q = rng.uniform(-0.05, 0.05, (sum(PER_SKIN), 12))
    places, first = [], 0
    for number, (skin, count) in enumerate(zip(world.skins, PER_SKIN, strict=True)):
        place = skin.fields.vertices[rng.integers(len(skin.fields.vertices), size=count)]
        apart = np.linalg.norm(place[:, None] - skin.fields.p_LS, axis=2)
        width = np.sort(apart, axis=1)[:, 3].mean()
        felt = np.clip(1.5 - np.square(apart / width), 0, None)
        felt[np.arange(count), apart.argmin(axis=1)] += 1e-3
        rows = slice(first, first + count)
        sensation[rows, 30 * number : 30 * number + 30] = felt
        q[rows, 3 * number : 3 * number + 3] = 4 * place
        places.append(place)
        first += count
    shard = Shard(
        walk=0,
        num_steps=10_000,
        num_impossible=0,
        step=np.arange(first),
        q=q,
        sensation=sensation,
        contacts=Contacts(
            offsets=np.arange(first + 1),
            skin=np.repeat(np.arange(3, dtype=np.int8), PER_SKIN),
            toucher=np.zeros(first, np.int8),
            p_LC=np.concatenate(places).astype(np.float32),
        ),
    )
    write_shard(run.path, shard, fingerprint=run.fingerprint())
    run.add_metrics({"babbling_num_samples": first})
    stages.learn(run)
    return run


def test_each_part_is_found_and_reported(run):
    figures = run.metrics()
    assert figures["parts_found"] == 3
    # The forearms have too few kernels for their void to be seen.
    assert figures["topology_betti_by_part"] == [[1, 0, 1], [1, 0, 0], [1, 0, 0]]
    assert len(figures["intrinsic_dimension_by_part"]) == 3
    assert "topology_betti" not in figures
    assert "intrinsic_dimension" not in figures
    shown = {tile.name: tile.value for tile in tiles(figures)}
    assert shown["parts"] == "3"
    assert shown["components, loops, voids by part"] == "1, 0, 1; 1, 0, 0; 1, 0, 0"


def test_the_files_name_each_part(run):
    arrays = load_arrays(run.topology)
    part = load_representation(run).part
    assert arrays["num_parts"] == 3
    for number, prefix in enumerate(("", "part_1_", "part_2_")):
        np.testing.assert_array_equal(arrays[f"{prefix}kernels"], np.flatnonzero(part == number))
        for dimension in range(3):
            assert arrays[f"{prefix}diagram_{dimension}"].shape[1] == 2
    distances = load_arrays(run.body_distances)["distances"]
    assert np.isinf(distances[part[:, None] != part]).all()
    assert np.isfinite(distances[part[:, None] == part]).all()


def test_each_skin_is_scored(run, world):
    representation = load_representation(run)
    figures = scores.score_body(run, world, representation, load_body(run, representation))
    assert figures["parts_true"] == 3
    assert figures["topology_betti_true_by_part"] == [[1, 0, 1]] * 3
    by_skin = figures["shape_rms_fraction_by_skin"]
    assert list(by_skin) == list(SKINS)
    assert max(by_skin.values()) < 0.2
    assert min(by_skin.values()) <= figures["shape_rms_fraction"] <= max(by_skin.values())
    assert set(figures) <= {metric.key for metric in METRICS}
    # As a file holds them.
    json.dumps(figures, allow_nan=False)
    assert metric_texts(figures)


def test_true_parts_stand_beside_the_parts_that_show_them(run):
    body = load_body(run, load_representation(run))
    true = [
        TruePart(skins=(number,), kernels=part.kernels, betti=(1, number, 0))
        for number, part in enumerate(body.parts)
    ]
    # The truth may come in another order, lack a part, or not know its holes.
    found = scores.part_metrics(body, [true[2], true[0]], several=True)
    assert found == {
        "parts_true": 2,
        "topology_betti_true_by_part": [[1, 0, 0], None, [1, 2, 0]],
    }


def test_a_skin_that_was_touched_and_not_recovered_is_named(run):
    representation = load_representation(run)
    body = load_body(run, representation)
    skin = representation.part.copy()
    truth = KernelTruth(skin=skin, positions=np.zeros((110, 3)), spread=skin, share_single=1.0)
    touches = {"body": 1500, "left_forearm": 600, "right_forearm": 3}
    assert scores.not_recovered(body, truth, touches) == {}
    without = dataclasses.replace(body, parts=body.parts[:2])
    found = scores.not_recovered(without, truth, touches)
    assert found == {"skins_not_recovered": {"right_forearm": 3}}
    assert [(t.name, t.value) for t in tiles(found)] == [
        ("skins touched, not recovered", "right_forearm 3")
    ]


def test_pairs_are_of_one_part(run):
    part = load_representation(run).part
    pairs = random_pairs(run.experiment, load_representation(run))
    assert len(set(pairs)) == 40
    assert all(part[start] == part[goal] and start != goal for start, goal in pairs)
    assert {int(part[start]) for start, _ in pairs} == {0, 1, 2}
