"""Receptors lie in the middle of their fields, wherever touches are made."""

import numpy as np
import pytest
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model.receptor_places import middles_of_fields

#: Of a grid of receptors, with fields that reach so far.
SPACING, REACH = 1.0, 2.0


def skin(side=6):
    """`(side^2, 3)` places of receptors on a slightly curved sheet."""
    x, y = np.meshgrid(np.arange(side) * SPACING, np.arange(side) * SPACING)
    return on_the_sheet(np.stack([x.ravel(), y.ravel()], axis=1))


def on_the_sheet(p):
    return np.column_stack([p, -0.02 * np.square(p - 2.5).sum(axis=1)])


def felt_at(y, receptors):
    """What receptors read: bells with an end, of forces that differ from touch to touch."""
    far = np.linalg.norm(y[:, None] - receptors, axis=2)
    bells = np.maximum(1 - np.square(far / REACH), 0) ** 2
    force = np.random.default_rng(5).uniform(0.2, 3.0, (len(y), 1))
    return force * bells / bells.sum(axis=1, keepdims=True)


def means(y, felt):
    return (felt**2).T @ y / np.square(felt).sum(axis=0)[:, None]


def crowded(number=1500):
    """Touches that crowd towards one corner, and of which none is near two sides of the skin."""
    return on_the_sheet(0.3 + 4.2 * np.random.default_rng(3).beta(0.8, 1.6, (number, 2)))


def test_receptors_lie_in_the_middle_of_their_fields_wherever_touches_are_made():
    receptors, y = skin(), crowded()
    felt = felt_at(y, receptors)
    start = means(y, felt)
    found, sigma = middles_of_fields(y, csr_array(felt), start)
    off, before = (np.linalg.norm(each - receptors, axis=1) for each in (found, start))
    assert np.sqrt(np.mean(off**2)) < 0.2 * SPACING
    assert np.sqrt(np.mean(before**2)) > 2 * np.sqrt(np.mean(off**2))
    # Standard errors hold, and are no larger than they have to be.
    assert np.mean(off < 2 * sigma) > 0.9
    assert np.median(sigma) < 0.4 * SPACING


def test_a_unit_of_length_makes_no_difference():
    receptors, y = skin(), crowded()
    felt = felt_at(y, receptors)
    start = means(y, felt)
    (found, sigma), (small, small_sigma) = (
        middles_of_fields(size * y, csr_array(felt), size * start) for size in (1.0, 1e-3)
    )
    np.testing.assert_allclose(small, 1e-3 * found, atol=2e-5)
    np.testing.assert_allclose(small_sigma, 1e-3 * sigma, rtol=0.02)


@pytest.mark.parametrize(("touches", "receptors"), [(20, 36), (200, 3)])
def test_of_little_nothing_is_told(touches, receptors):
    places, y = skin()[:receptors], crowded()[:touches]
    start = places + 0.1
    found, sigma = middles_of_fields(y, csr_array(felt_at(y, skin())[:, :receptors]), start)
    np.testing.assert_array_equal(found, start)
    assert np.isnan(sigma).all()


def on_an_arc(x):
    return 8.0 * np.column_stack([np.sin(x / 8.0), np.cos(x / 8.0), np.zeros(len(x))])


def test_in_a_plane_receptors_stay_on_the_line_that_is_the_skin():
    receptors = on_an_arc(np.arange(24.0))
    y = on_an_arc(23.0 * np.random.default_rng(2).beta(0.8, 1.2, 900))
    felt = felt_at(y, receptors)
    found, _ = middles_of_fields(y, csr_array(felt), means(y, felt))
    off_the_line = np.linalg.norm(found, axis=1) - 8.0
    assert np.abs(off_the_line).max() < 0.15 * SPACING
