import numpy as np
import pytest
import trimesh

from selftouch_drake.evaluation import coverage, touch_density

BALL = trimesh.creation.icosphere(subdivisions=4, radius=0.25)
VERTICES, FACES = np.array(BALL.vertices), np.array(BALL.faces)


def directions(number, seed=0):
    found = np.random.default_rng(seed).standard_normal((number, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def skin(p_LC):
    """The ball, touched at points `(N, 3)`."""
    _, nearest = BALL.kdtree.query(p_LC)
    counts = np.bincount(nearest, minlength=len(VERTICES))
    return VERTICES, FACES, touch_density(VERTICES, FACES, counts)


def test_even_touches_cover_everything_evenly():
    # 7854 cm² of skin, 3.14 cm² per print: 40 touches per print on average.
    figures = coverage([skin(0.24 * directions(100_000))])
    assert figures["coverage_share_10_touches"] == 1.0
    assert figures["coverage_share_100_touches"] == 0.0
    assert figures["coverage_evenness"] > 0.99


def test_half_a_skin_touched_is_half_covered():
    p_LC = 0.24 * directions(100_000)
    half = coverage([skin(p_LC[p_LC[:, 2] > 0])])
    assert 0.5 <= half["coverage_share_10_touches"] < 0.56
    whole = coverage([skin(p_LC)])
    assert half["coverage_evenness"] < whole["coverage_evenness"] - 0.05


def test_two_skins_count_by_their_area():
    p_LC = 0.24 * directions(100_000)
    untouched = VERTICES, FACES, np.zeros(len(VERTICES))
    both = coverage([skin(p_LC), untouched])
    assert both["coverage_share_10_touches"] == pytest.approx(0.5)


def test_many_touches_of_one_spot_cover_that_spot():
    figures = coverage([skin(np.tile([[0.0, 0.0, 0.24]], (5_000, 1)))])
    assert 0 < figures["coverage_share_100_touches"] <= figures["coverage_share_10_touches"] < 0.01
