"""The table of metrics, and how it is read."""

import re

import pytest

from selftouch_drake.run.metrics import (
    BY_KEY,
    METRICS,
    MOTION_COLUMNS,
    keys_of,
    metric_texts,
    misses_target,
    motions,
    tiles,
)


def test_every_metric_is_described_once():
    keys = [metric.key for metric in METRICS]
    assert len(set(keys)) == len(keys)
    for metric in METRICS:
        assert re.fullmatch(r"[a-z]\w+", metric.key)
        assert metric.section
        assert metric.meaning
        assert metric.unit in ("", "%", "percent", "N", "m", "ms", "rad", "s", "×")
        assert metric.stage in ("babble", "learn", "evaluate")


def test_a_unit_in_a_key_is_that_of_the_table():
    for metric in METRICS:
        ending = metric.key.rsplit("_", 1)[-1]
        if ending in ("N", "s", "m", "rad"):
            assert metric.unit == ending


def test_stages_share_out_all_metrics():
    stages = [keys_of(stage) for stage in ("babble", "learn", "evaluate")]
    assert sum(map(len, stages)) == len(METRICS)
    assert keys_of("learn", "evaluate") == stages[1] | stages[2]
    assert "topology_betti" in keys_of("learn")
    assert "coverage_evenness" in keys_of("evaluate")


def test_numbers_are_read_with_their_units():
    metrics = {
        "unheard_of": "é",
        "babbling_num_samples": 400_000,
        "babbling_touches_by_skin": {"torso": 1200, "head": 0},
        "shape_rms_fraction": 0.0234,
        "shape_rms_fraction_by_skin": {"torso": 0.02, "head": 0.5},
        "topology_betti_by_part": [[1, 0, 1], None, [1, 1, 0]],
        "planning_jerk_reduction": 12345.6,
        "execution_tracking_rms_rad": 0.0031,
    }
    found = metric_texts(metrics)
    value = {reading.name: reading.value for section in found.values() for reading in section}
    assert value == {
        "babbling_num_samples": "400,000",
        "babbling_touches_by_skin": "torso 1,200, head 0",
        "topology_betti_by_part": "1, 0, 1; unknown; 1, 1, 0",
        "shape_rms_fraction": "2.3 %",
        "shape_rms_fraction_by_skin": "torso 2.0 %, head 50.0 %",
        "planning_jerk_reduction": "12,346 ×",
        "execution_tracking_rms_rad": "0.0031 rad",
        "unheard_of": "é",
    }
    assert list(found)[-1] == "Others"
    assert metric_texts({}) == {}


@pytest.mark.parametrize(
    ("key", "met", "missed"),
    [
        ("planning_contact_mean", 0.991, 0.99),
        ("surface_rms_fraction", 0.049, 0.05),
        ("surface_rms_fraction_by_skin", {"a": 0.01, "b": 0.02}, {"a": 0.01, "b": 0.07}),
        ("execution_reach_rate", 1.0, 0.99),
        ("topology_margin", 4.0, 3.9),
        ("shape_trusted", True, False),
        ("planning_impossible_postures", 0, 1),
        ("execution_torque_of_limit", 1.0, 1.01),
        ("skins_not_recovered", {}, {"hand": 3}),
        ("execution_force_max_N", 29.0, 31.0),
    ],
)
def test_a_missed_target_is_marked(key, met, missed):
    assert not misses_target(BY_KEY[key], {key: met})
    assert misses_target(BY_KEY[key], {key: missed})


def test_parts_are_compared_with_the_true_ones_where_these_are_known():
    metric = BY_KEY["parts_found"]
    assert not misses_target(metric, {"parts_found": 2})
    assert not misses_target(metric, {"parts_found": 2, "parts_true": 2})
    assert misses_target(metric, {"parts_found": 2, "parts_true": 1})


def test_of_one_part_nothing_is_by_part_and_doubts_are_in_the_headline():
    doubt = "part 0 counts as one, but its places fall into 2 pieces"
    metrics = {
        "parts_found": 1,
        "parts_doubt": [doubt],
        "topology_betti_by_part": [[2, 0, 1]],
    }
    assert [(t.name, t.value) for t in tiles(metrics)] == [
        ("parts", "1"),
        ("number of parts not sure", doubt),
        ("components, loops, voids", "2, 0, 1"),
    ]


def test_the_headline_shows_what_there_is():
    assert tiles({}) == motions({}) == []
    metrics = {
        "parts_found": 2,
        "surface_rms_fraction": 0.0123,
        "shape_rms_fraction": 0.5,
        "unpractised_contact_mean": 0.8,
        "unpractised_prediction_error_mean": 0.03,
        "planning_contact_mean": 0.987,
        "planning_reach_rate": 1.0,
        "planning_path_over_shortest_median": 1.204,
    }
    found = [(t.name, t.value) for t in tiles(metrics)]
    assert found == [("shape error", "1.2 %"), ("parts", "2")]
    rows = motions(metrics)
    assert [(row.name, row.cells) for row in rows] == [
        ("before practice", ["80.0 %", "", "", "0.03", ""]),
        ("practised", ["98.7 %", "", "100.0 %", "", "1.2 ×"]),
    ]
    assert len(MOTION_COLUMNS) == 1 + len(rows[0].cells)


def test_motions_stand_side_by_side_before_and_after_practice():
    kinds = ("unpractised", "planning", "execution", "unpractised_execution")
    names = [row.name for row in motions({f"{kind}_contact_mean": 0.5 for kind in kinds})]
    assert names == ["before practice", "practised", "executed", "executed before practice"]
