"""How the model of a body grows with touches, and since when each thing stands."""

import numpy as np
import pytest
from hand_made_chains import ArmOnBall

from selftouch_drake.agent.body_model.growth import GrowingModel, Growth

NAN = float("nan")


def laid_out(**changed):
    arrays = {
        "touches": [50, 100, 200, 400],
        "accepted": [0, 1, 0, 1],
        "parts": [1, 1, 1, 2],
        "parent": [[-1, 0], [-1, 0], [1, -1], [-1, 0]],
        "axis_sigma": [[1.0, NAN], [2.0, 4.0], [2.0, 2.0], [1.0, 2.0]],
        "receptors": [0.0, 0.5, 0.0, 0.9],
        "receptor_sigma": [NAN, 0.1, NAN, 0.05],
    } | changed
    return Growth(**{name: np.array(values) for name, values in arrays.items()})


def test_what_was_accepted_for_a_while_does_not_stand_yet():
    grown = laid_out()
    assert grown.axes_stand() == [400, 400]
    assert grown.tree_stands() == 400
    assert grown.skins_stand() == [400, None]


def test_each_thing_stands_from_where_it_stays_as_it_is():
    grown = laid_out(accepted=[0, 1, 1, 2])
    assert grown.axes_stand() == [100, 200]
    assert grown.tree_stands() == 400  # the order was another one in between
    assert grown.skins_stand() == [100, 400]
    assert grown.in_words(["hip", "knee"]) == [
        "axes stand: hip after 100, knee after 200",
        "tree stands: after 400",
        "skins stand: after 100, after 400",
    ]
    same = Growth.from_arrays(grown.to_arrays())
    np.testing.assert_array_equal(same.parent, grown.parent)


def test_nothing_stands_that_was_never_accepted():
    grown = laid_out(accepted=[0, 0, 0, 0], axis_sigma=[[NAN, NAN]] * 4)
    assert grown.in_words() == [
        "axes stand: none",
        "tree stands: not yet",
        "skins stand: not yet, not yet",
    ]


@pytest.fixture(scope="module")
def grown():
    growing, (q, felt) = GrowingModel(seed=0), ArmOnBall().touches(200)
    assert growing.growth is None
    assert growing.to_come == 50
    growing._due = 100  # one model less, which takes long
    while len(q):
        now = slice(growing.to_come)
        if growing.take(q[now], felt[now]):
            growing.ask(None)
        q, felt = q[now.stop :], felt[now.stop :]
    return growing


def test_a_model_grows_with_touches(grown):
    found = grown.growth
    assert found.touches.tolist() == [100, 200]
    assert found.accepted[-1] == 1
    # Of the standard errors those in the end are the smallest.
    assert np.nanmedian(found.axis_sigma[-1]) < np.nanmedian(found.axis_sigma[0])
    assert found.receptors[-1] > 0.7
    assert found.skins_stand() == [200]


def test_an_axis_is_as_unsure_as_directions_drawn_from_its_covariance(grown):
    _, model = grown.models[-1]
    joint = int(np.flatnonzero(model.used)[0])
    own = slice(6 * joint, 6 * joint + 3)
    w, random = model.twists[joint, :3], np.random.default_rng(0)
    drawn = random.multivariate_normal(w, model.covariance[own, own], 4000)
    cosine = drawn @ w / np.linalg.norm(drawn, axis=1) / np.linalg.norm(w)
    off = np.degrees(np.sqrt(np.mean(np.arccos(np.clip(cosine, -1, 1)) ** 2) / 2))
    assert model.axis_errors(joint)[0] == pytest.approx(off, rel=0.05)
    assert grown.growth.axis_sigma[-1, joint] == model.axis_errors(joint)[0]
