import tracemalloc

import numpy as np
import pytest
import trimesh

from selftouch_drake.evaluation.coverage import coverage, touch_density

BALL = trimesh.creation.icosphere(subdivisions=4, radius=0.25)
SMALL = trimesh.creation.icosphere(subdivisions=3, radius=0.125)


def touches(ball, number, seed=0, *, half=False):
    """`(V,)` how often each vertex of a ball was touched."""
    directions = np.random.default_rng(seed).standard_normal((number, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    if half:
        directions = directions[directions[:, 2] > 0]
    _, nearest = ball.kdtree.query(directions * np.linalg.norm(ball.vertices[0]))
    return np.bincount(nearest, minlength=len(ball.vertices))


def skin(ball, counts):
    """A skin, as `coverage` takes it."""
    vertices, faces = np.array(ball.vertices), np.array(ball.faces)
    return vertices, faces, counts


def test_density_is_touches_over_area():
    density = touch_density(BALL.vertices, BALL.faces, touches(BALL, 100_000))
    assert density.mean() == pytest.approx(100_000 / (1e4 * BALL.area), rel=0.01)
    assert density.std() < 0.1 * density.mean()


def test_density_of_one_wall_is_not_that_of_the_other():
    # A plate of 1 cm: 3 cm are farther than it is thick.
    plate = trimesh.creation.box((0.3, 0.3, 0.01)).subdivide_to_size(0.01)
    top = plate.vertices[:, 2] > 0
    rim = np.abs(plate.vertices[:, :2]).max(axis=1) > 0.1
    density = touch_density(plate.vertices, plate.faces, 100 * top.astype(int))
    assert density[top & ~rim].min() > 10 * density[~top & ~rim].max()
    assert density[~top & ~rim].max() == 0.0


def test_even_touches_cover_everything_evenly():
    # 7854 cm² of skin, 3.14 cm² a print: 40 touches a print on average.
    figures = coverage([skin(BALL, touches(BALL, 100_000))])
    assert figures["coverage_share_10_touches"] == pytest.approx(1.0)
    assert figures["coverage_share_100_touches"] == 0.0
    assert figures["coverage_evenness"] > 0.99


def test_half_a_skin_touched_is_half_covered():
    half = coverage([skin(BALL, touches(BALL, 100_000, half=True))])
    assert 0.5 <= half["coverage_share_10_touches"] < 0.56
    whole = coverage([skin(BALL, touches(BALL, 100_000))])
    assert half["coverage_evenness"] < whole["coverage_evenness"] - 0.05


def test_many_touches_of_one_spot_cover_that_spot():
    spot = np.zeros(len(BALL.vertices), dtype=int)
    spot[7] = 5_000
    figures = coverage([skin(BALL, spot)])
    assert 0 < figures["coverage_share_100_touches"] <= figures["coverage_share_10_touches"] < 0.01


def test_skins_count_by_their_area():
    # The small ball has a quarter of the large one's area: a fifth of all.
    large, small = touches(BALL, 100_000), touches(SMALL, 25_000)
    both = coverage([skin(BALL, large), skin(SMALL, small)])
    assert both["coverage_share_10_touches"] == pytest.approx(1.0)
    assert both["coverage_evenness"] > 0.99
    for figures, share in (
        (coverage([skin(BALL, large), skin(SMALL, 0 * small)]), 0.8),
        (coverage([skin(BALL, 0 * large), skin(SMALL, small)]), 0.2),
    ):
        assert figures["coverage_share_10_touches"] == pytest.approx(share, abs=0.01)
        assert figures["coverage_evenness"] < both["coverage_evenness"] - 0.01
    # As many touches on the small skin as on the large one are uneven.
    crowded = coverage([skin(BALL, large), skin(SMALL, touches(SMALL, 100_000))])
    assert crowded["coverage_evenness"] < both["coverage_evenness"] - 0.005


def test_the_order_of_skins_does_not_matter():
    one, other = skin(BALL, touches(BALL, 1000, half=True)), skin(SMALL, touches(SMALL, 1000))
    assert coverage([one, other]) == pytest.approx(coverage([other, one]))


def test_a_fine_surface_does_not_fill_the_memory():
    # All pairs of vertices within three centimetres: four million.
    fine = trimesh.creation.icosphere(subdivisions=5, radius=0.1)
    counts = touches(fine, 100_000)
    tracemalloc.start()
    density = touch_density(np.array(fine.vertices), np.array(fine.faces), counts)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 100e6
    assert density.mean() == pytest.approx(100_000 / (1e4 * fine.area), rel=0.01)
