"""`selftouch score`: what any other method makes of a recording, judged."""

import json

import numpy as np
import pytest
from commands import refused, selftouch
from scipy.spatial.distance import cdist

from selftouch_drake.files import load_arrays
from selftouch_drake.resources import RECORDINGS
from selftouch_drake.run.metrics import METRICS

TURN = 3.0 * np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@pytest.fixture
def score(tmp_path):
    """Hands in arrays for a shipped recording; returns the metrics."""

    def score(recording, **arrays):
        np.savez(tmp_path / "mine.npz", **arrays)
        done = selftouch("score", tmp_path / "mine.npz", "--recording", recording, "--json")
        assert done.status == 0, done.stderr
        return json.loads(done.stdout)

    return score


def truth(name):
    return load_arrays(RECORDINGS / f"{name}.truth.npz")


def known_rows(name):
    """Rows that touch one place, which it is and on which skin."""
    true = truth(name)
    rows = np.flatnonzero(true["cell"] >= 0)
    skin = true["cell_skin"][true["cell"][rows]].astype(int)
    return rows, true["touch_places"][rows].astype(float), skin


def test_true_places_in_any_pose_and_unit_have_no_error(score):
    rows, places, _ = known_rows("torus_1")
    found = score("torus_1", rows=rows, touch_places=places @ TURN + 7.0)
    assert found["surface_rms_fraction"] < 1e-6
    assert found["neighbour_agreement"] == found["judged_share"] == 1.0
    assert found["topology_betti_by_part"] == found["topology_betti_true_by_part"] == [[1, 2, 1]]
    assert found["topology_margin"] > 2
    assert found["parts_found"] == 1
    assert set(found) <= {metric.key for metric in METRICS}


def test_a_bent_shape_has_the_error_that_was_made(score):
    rows, places, _ = known_rows("torus_1")
    extent = np.linalg.norm(np.ptp(places, axis=0)[:2]) / np.sqrt(2)
    away = places + [0.0, 0.0, 0.05] * np.sign(places[:, :1])
    found = score("torus_1", rows=rows, touch_places=away)
    # One half is 5 cm up, the other 5 cm down; a turn takes most of it back.
    assert 0.2 * 0.05 < extent * found["surface_rms_fraction"] < 0.05
    flat = score("torus_1", rows=rows, touch_places=places[:, :2])
    assert flat["topology_betti_by_part"] == [None]
    anywhere = np.random.default_rng(0).normal(size=(len(rows), 3))
    lost = score("torus_1", rows=rows, touch_places=anywhere)
    assert lost["surface_rms_fraction"] > 0.2
    assert lost["neighbour_agreement"] < 0.2


def test_receptors_that_lie_right_have_no_error(score):
    true = truth("two_arms_1")
    part = true["receptor_skin"].astype(int)
    places = true["receptor_places"] @ TURN
    found = score("two_arms_1", receptor_places=places, parts=part)
    assert max(found["surface_rms_fraction_by_skin"].values()) < 1e-6
    assert list(found["surface_rms_fraction_by_skin"]) == ["body", "left_forearm", "right_forearm"]
    assert found["parts_found"] == found["parts_true"] == 3
    swapped = places.copy()
    swapped[part == 1] = np.random.default_rng(0).permutation(swapped[part == 1])
    worse = score("two_arms_1", receptor_places=swapped, parts=part)["surface_rms_fraction_by_skin"]
    assert worse["left_forearm"] > 0.1
    assert worse["body"] < 1e-6


def test_straight_distances_are_laid_out(score):
    rows, places, _ = known_rows("cube_1")
    some = np.random.default_rng(0).permutation(len(rows))[:500]
    apart = cdist(places[some], places[some])
    found = score("cube_1", rows=rows[some], distances=apart)
    assert found["surface_rms_fraction"] < 1e-3
    assert 0.5 < found["judged_share"] < 1.0


def test_parts_are_counted_and_what_is_left_out_is_told(score):
    rows, places, skin = known_rows("two_arms_1")
    assert score("two_arms_1", rows=rows, touch_places=places, parts=skin)["parts_found"] == 3
    one = score("two_arms_1", rows=rows, touch_places=places, parts=np.zeros_like(skin))
    assert one["parts_found"] == 1
    left_out = np.where(skin == 0, 5, -1)
    some = score("two_arms_1", rows=rows, touch_places=places, parts=left_out)
    assert some["parts_found"] == 1
    assert 0.2 < some["judged_share"] < 0.9
    assert list(some["surface_rms_fraction_by_skin"]) == ["body"]


def test_plans_are_followed_in_the_world_that_was_recorded(score):
    given = load_arrays(RECORDINGS / "cube_1.npz")
    start, goal = (given["q"][rows].astype(float) for rows in given["pairs"].T)
    # Half of them stay where they are, the others go straight, through body and air.
    stay = np.arange(len(start)) < 10
    ends = np.where(stay[:, None], start, goal)
    found = score("cube_1", plans=np.stack([start, ends], axis=1))
    assert 0.5 <= found["unpractised_reach_rate"] <= 0.6
    assert 0.5 < found["unpractised_contact_mean"] < 0.9
    assert found["unpractised_contact_worst"] < 0.8


def test_the_table_shows_metrics_with_their_targets(tmp_path):
    rows, places, _ = known_rows("cube_1")
    np.savez(tmp_path / "mine.npz", rows=rows, touch_places=places)
    done = selftouch("score", tmp_path / "mine.npz", "--recording", RECORDINGS / "cube_1.npz")
    line = next(one for one in done.stdout.splitlines() if "surface_rms_fraction " in one)
    assert "0.0 %" in line
    assert "below 5 %" in line


PLACES = np.zeros((10_000, 3))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"touch_places": PLACES[:7]}, "touch_places is float64 (7, 3), 0 to 0; give (10000, 2)"),
        ({"touch_places": PLACES[:, :1]}, "touch_places is float64 (10000, 1)"),
        ({"touch_places": PLACES[:2], "rows": [3, 3]}, "each once"),
        (
            {"touch_places": PLACES[:2], "rows": [3, 10_000]},
            "rows is int64 (2,), 3 to 10000; give whole numbers of 0 to 9999",
        ),
        ({"touch_places": PLACES[:2], "rows": [3.0, 4.0]}, "give whole numbers"),
        ({"touch_places": PLACES + np.nan}, "touch_places holds float64, or NaN or infinity"),
        ({"receptor_places": np.zeros((9, 3))}, "for 100 receptors"),
        ({"touch_place": PLACES}, "did you mean touch_places?"),
        ({"touch_places": PLACES, "receptor_places": np.zeros((100, 3))}, "give one of"),
        ({"rows": [1]}, "has no places; give one of"),
        ({"touch_places": np.full((10_000, 3), "a")}, "touch_places holds <U1"),
        (
            {"distances": np.zeros((5, 4)), "rows": np.arange(5)},
            "give (5, 5) of 5 touches, at most 2000",
        ),
        ({"distances": np.triu(np.ones((100, 100)), 1)}, "symmetric, 0 on the diagonal"),
        ({"touch_places": PLACES, "parts": np.zeros(9, dtype=int)}, "parts is int64 (9,)"),
        ({"touch_places": PLACES, "parts": np.full(10_000, -2)}, "from 0 on, or -1"),
        ({"plans": np.zeros((3, 4, 6))}, "plans is float64 (3, 4, 6), 0 to 0; give (20, T, 6)"),
        ({"plans": np.zeros((20, 4, 6)) + 9.0}, "each from the first touch of one of the pairs on"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(arrays, message, tmp_path):
    np.savez(tmp_path / "mine.npz", **arrays)
    assert message in refused("score", tmp_path / "mine.npz", "--recording", "torus_1")


def test_recordings_that_are_not_there_are_named(tmp_path):
    np.savez(tmp_path / "mine.npz", touch_places=PLACES)
    said = refused("score", tmp_path / "mine.npz", "--recording", "torus_9")
    assert said.startswith(
        "--recording is 'torus_9', neither a file nor shipped: did you mean torus"
    )
    np.savez(tmp_path / "new.npz", **load_arrays(RECORDINGS / "cube_1.npz"))
    said = refused("score", tmp_path / "mine.npz", "--recording", tmp_path / "new.npz")
    assert "new.truth.npz" in said
    said = refused("score", tmp_path / "none.npz", "--recording", "cube_1")
    assert "none.npz" in said
