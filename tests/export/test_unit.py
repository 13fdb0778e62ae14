"""Metres from one known length, with its standard error, and what is refused."""

import dataclasses

import numpy as np
import pytest
from made_up import made_up_model, twist

from selftouch_drake.agent.body_model.model import independent
from selftouch_drake.export.unit import (
    Unit,
    better_joints,
    unit_from_joints,
    unit_from_receptors,
)

NAMES = ["skin[0]", "skin[1]", "skin[2]", "skin[3]", "skin[4]"]


def with_axes(first, second, sigma=0.001):
    """The made-up model with other axes of `neck` and `left_shoulder`."""
    model = made_up_model()
    twists = model.twists.copy()
    twists[0], twists[4] = first, second
    errors = independent(np.full((6, 6), sigma), len(model.toucher_place))
    return dataclasses.replace(model, twists=twists, covariance=errors)


@pytest.mark.parametrize(
    ("second", "apart"),
    [
        (twist([0, 0, 1], (3, 4, 7)), 5.0),
        (twist([0, 0, -1], (3, 4, 7), 0.01), 5.0),  # reversed, and read in other units
        (twist([0, 1, 0], (2, 9, 9)), 2.0),  # skew: the shortest distance
        (twist([1, 0, 1], (0, 3, 0)), 3.0),
    ],
)
def test_a_length_is_the_distance_of_two_axes(second, apart):
    model = with_axes(twist([0, 0, 1], (0, 0, 2), 3.0), second)
    unit = unit_from_joints(model, "neck", "left_shoulder", 0.4)
    assert unit.known
    assert unit.metres == pytest.approx(0.4 / apart)


def test_axes_that_are_nearly_parallel_are_measured_across_their_mean_direction():
    tilt = np.radians(6.0)
    model = with_axes(twist([0, 0, 1]), twist([0, np.sin(tilt), np.cos(tilt)], (2, 0, 0)))
    assert unit_from_joints(model, "neck", "left_shoulder", 1.0).metres == pytest.approx(0.5)
    # The shortest distance between these two is nothing: they are 2 apart beside each other only.
    model = with_axes(twist([0, 0, 1]), twist([np.sin(tilt), 0, np.cos(tilt)], (2, 0, 0)))
    apart = 2 * np.cos(tilt) * np.cos(tilt / 2)  # their feet from the origin, across the mean
    found = unit_from_joints(model, "neck", "left_shoulder", 1.0).metres
    assert found == pytest.approx(1 / apart, rel=0.01)


def test_the_standard_error_of_the_scale_is_that_of_draws():
    sigma = 0.01
    right = with_axes(twist([0, 0, 1], (0, 0, 1)), twist([0, 0, 1], (1.0, 0.5, 0)), sigma)
    unit = unit_from_joints(right, "neck", "left_shoulder", 0.4)
    rng, drawn = np.random.default_rng(0), []
    for _ in range(400):
        noise = rng.normal(scale=sigma, size=(2, 6))
        first, second = right.twists[0] + noise[0], right.twists[4] + noise[1]
        drawn.append(
            unit_from_joints(with_axes(first, second), "neck", "left_shoulder", 0.4).metres
        )
    # Covariances of fits are too sure by this factor.
    assert unit.sigma == pytest.approx(1.4 * np.std(drawn), rel=0.15)


def test_a_distance_is_that_of_two_receptors():
    model = made_up_model()
    apart = np.linalg.norm(model.receptor_place[0] - model.receptor_place[1])
    named = unit_from_receptors(model, NAMES, "skin[0]", "skin[1]", 0.05)
    assert named.metres == pytest.approx(0.05 / apart)
    error = np.hypot(0.01, 0.02) / np.sqrt(3)
    assert named.sigma == pytest.approx(named.metres * error / apart)
    by_number = unit_from_receptors(model, NAMES, "0", "1", 0.05)
    assert by_number.metres == named.metres


def refusal(function, *arguments):
    with pytest.raises(ValueError, match=r"--|known length") as caught:
        function(*arguments)
    return str(caught.value)


def test_lengths_that_tell_nothing_are_refused():
    meeting = with_axes(twist([0, 0, 1], (1, 1, 0)), twist([0, 1, 0], (1, 5, 0)))
    nearly = with_axes(twist([0, 0, 1], (1, 1, 0)), twist([0, 1, 0], (1.02, 5, 0)), 0.05)
    model = made_up_model()
    for given, expected in [
        ((meeting, "neck", "left_shoulder", 1.0), "meet"),
        ((nearly, "neck", "left_shoulder", 1.0), "meet"),
        ((model, "neck", "rail", 1.0), "joint rail slides"),
        ((model, "neck", "spare", 1.0), "joint spare is of no use"),
        ((model, "nekc", "rail", 1.0), "did you mean neck?"),
        ((model, "neck", "neck", 1.0), "joint neck twice"),
        ((model, "neck", "left_shoulder", -1.0), "-1 m; give a positive number"),
        ((model, "neck", "left_shoulder", np.nan), "nan m; give a positive number"),
    ]:
        assert expected in refusal(unit_from_joints, *given)
    for given, expected in [
        (("skin[0]", "skin[2]"), "are on different links"),
        (("skin[0]", "skin[4]"), "receptor skin[4] was never met"),
        (("skin[0]", "skni[1]"), "did you mean"),
        (("skin[0]", "0"), "twice"),
        (("0", "17"), "'17', which is not there"),
    ]:
        assert expected in refusal(unit_from_receptors, model, NAMES, *given, 1.0)
    vague = dataclasses.replace(model, receptor_sigma=np.full(5, 10.0))
    assert "too near" in refusal(unit_from_receptors, vague, NAMES, "0", "1", 1.0)


def test_an_unknown_unit_is_said_to_be_arbitrary():
    assert "arbitrary unit" in Unit().text()
    known = Unit(metres=0.5, sigma=0.005, known=True, source="two axes are 1 m apart")
    assert known.text().endswith("relative standard error of the scale: 0.01")


def test_a_length_that_tells_the_scale_badly_names_joints_that_tell_it_better():
    model = with_axes(twist([0, 0, 1]), twist([0, 0, 1], (0.1, 0, 0)), sigma=0.002)
    bad = unit_from_joints(model, "neck", "left_shoulder", 0.1)
    assert bad.sigma / bad.metres > 0.03
    said = better_joints(model, bad)
    named = said.split("axes of ")[1].split(" would")[0].split(" and ")
    good = unit_from_joints(model, *named, 1.0)
    assert good.sigma / good.metres < bad.sigma / bad.metres / 1.5
    assert said.endswith(f"error of {good.sigma / good.metres:.2g}")
    # Nothing tells it better than they do, and nothing is said without a length.
    assert better_joints(model, good) == ""
    assert better_joints(model, Unit()) == ""
