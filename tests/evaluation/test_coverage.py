import numpy as np
import trimesh

from selftouch_drake.evaluation import coverage

BALL = trimesh.creation.icosphere(subdivisions=4, radius=0.25)
VERTICES, FACES = np.array(BALL.vertices), np.array(BALL.faces)


def touches(number, seed=0):
    directions = np.random.default_rng(seed).standard_normal((number, 3))
    return 0.24 * directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_even_touches_cover_everything_evenly():
    # 7854 cm² of skin, 3.14 cm² a print: 40 touches a print on average.
    figures = coverage(VERTICES, FACES, [touches(100_000)])
    assert figures["coverage_share_10_touches"] == 1.0
    assert figures["coverage_share_100_touches"] == 0.0
    assert figures["coverage_evenness"] > 0.99


def test_half_a_skin_touched_is_half_covered():
    p_WF = touches(100_000)
    half = coverage(VERTICES, FACES, [p_WF[p_WF[:, 2] > 0]])
    assert 0.5 <= half["coverage_share_10_touches"] < 0.56
    whole = coverage(VERTICES, FACES, np.array_split(p_WF, 7))
    assert whole == coverage(VERTICES, FACES, [p_WF])
    assert half["coverage_evenness"] < whole["coverage_evenness"] - 0.05


def test_many_touches_of_one_spot_cover_that_spot():
    spot = np.tile([[0.0, 0.0, 0.24]], (5_000, 1))
    figures = coverage(VERTICES, FACES, [spot])
    assert 0 < figures["coverage_share_100_touches"] <= figures["coverage_share_10_touches"] < 0.01
