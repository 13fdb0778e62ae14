import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from selftouch_drake.agent.planning import smooth_path
from selftouch_drake.robot.pieces import Pieces, averaged, clamped, follow, shares_along


@pytest.fixture
def path():
    rng = np.random.default_rng(0)
    return smooth_path(np.cumsum(0.4 * rng.normal(size=(7, 3)), axis=0))


@pytest.fixture
def progress(path):
    """Twice as long as the path: at its end the motion waits."""
    time_s = np.linspace(0.0, 2.0, 30)
    return CubicSpline(time_s, 2 * path.t[-1] * (time_s / 2) ** 2, bc_type="clamped")


def test_a_path_is_followed_and_not_left(path, progress):
    time_s = np.linspace(0.0, 2.0, 57)
    s, q, v = np.empty(57), *np.empty((2, 57, 3))
    follow(Pieces.of_path(path), Pieces.of_progress(progress), time_s, s, q, v)
    assert s == pytest.approx(progress(time_s).clip(0.0, path.t[-1]))
    assert q == pytest.approx(path(s), abs=1e-12)
    assert v == pytest.approx(path(s, 1) * progress(time_s, 1)[:, None], abs=1e-10)


def test_shares_are_those_of_samples_of_the_path(path, progress):
    limits = np.array([1.0, 2.0, 3.0]), np.array([3.0, 2.0, 1.0])
    found = shares_along(Pieces.of_path(path), Pieces.of_progress(progress), 4, *limits)
    time_s = np.linspace(progress.x[:-1], progress.x[1:], 4, endpoint=False, axis=1).ravel()
    time_s = np.append(time_s, progress.x[-1])
    s, speed, rise = (
        progress(time_s).clip(0.0, path.t[-1]),
        progress(time_s, 1),
        progress(time_s, 2),
    )
    v = path(s, 1) * speed[:, None]
    a = path(s, 2) * speed[:, None] ** 2 + path(s, 1) * rise[:, None]
    expected = (np.abs(v) / limits[0]).max(), (np.abs(a) / limits[1]).max()
    assert found == pytest.approx(expected)


def test_an_average_looks_back_and_stays_at_the_ends(progress):
    time_s, before = np.linspace(-0.5, 2.5, 40), np.array([0.0, 0.1, 0.3])
    mean = np.empty(40)
    averaged(Pieces.of_progress(progress), time_s, before, mean)
    expected = progress((time_s[:, None] - before).clip(0.0, 2.0)).mean(axis=1)
    assert mean == pytest.approx(expected)


@pytest.mark.parametrize("num", [1, 2, 12])
def test_the_clamped_spline_is_scipy_s(num):
    value, time_s = np.random.default_rng(num).random(num + 1), 0.2 * np.arange(num + 1)
    terms = np.empty((num, 1, 4))
    clamped(0.2, value, terms[:, 0])
    expected = CubicSpline(time_s, value, bc_type="clamped")
    assert Pieces(time_s, terms).as_progress().c == pytest.approx(expected.c)
