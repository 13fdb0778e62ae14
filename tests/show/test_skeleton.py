import dataclasses

import numpy as np
import pytest
from laid_out import lay_out
from modelled import UNKNOWN

from selftouch_drake.agent.body_model.model import BASE, UNUSED
from selftouch_drake.evaluation.body_model import Axes
from selftouch_drake.run.artifacts import load_body_model, save_body_model
from selftouch_drake.run.directory import MissingError
from selftouch_drake.show.page.skeleton_figures import fitted_skeleton, shown_posture, skeleton
from selftouch_drake.show.run_data import RunData
from selftouch_drake.show.skeleton import _shortest, _skeleton, found_skeleton

X, Y, Z = np.eye(3)


@pytest.fixture(scope="module", params=["ball", "two_skins"])
def data(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("skeleton") / request.param
    return RunData(lay_out(path, kind=request.param, stage="learned"))


def test_a_perfect_model_has_the_skeleton_of_its_robot(data):
    fitted = fitted_skeleton(data)
    assert fitted.onto.mirrors
    assert fitted.onto.scale == pytest.approx(1 / UNKNOWN.scale, rel=1e-6)
    assert fitted.found.place == pytest.approx(fitted.true.place, abs=1e-5)
    assert fitted.found.touchers == pytest.approx(fitted.true.touchers, abs=1e-6)
    assert fitted.off == pytest.approx(0.0, abs=1e-4)
    assert len(fitted.found.bones) == len(fitted.true.bones)
    # Links begin and end where joints are, and what they carry.
    ends = fitted.true.bones.reshape(-1, 3)
    away = np.linalg.norm(fitted.true.touchers[:, None] - ends, axis=2)
    assert away.min(axis=1) == pytest.approx(0.0, abs=1e-12)


def test_the_posture_is_a_stored_touch(data):
    q = shown_posture(data)
    assert (data.representation.kernel_q.astype(float) == q).all(axis=1).any()


def test_joints_are_drawn_on_their_axes_where_links_are_shortest():
    # Two axes that meet at (0, 0, 1), one above the other's middle, and a tip at (2, 0, 1).
    axes = Axes(
        place=np.array([[0.0, 0, 0], [0, 7, 1]]), direction=np.array([Z, Y]), parent=[BASE, 0]
    )
    place = _shortest(axes, np.arange(2), {1: [np.array([2.0, 0, 1])]})
    assert place == pytest.approx(np.array([[0, 0, 1], [0, 0, 1]]), abs=1e-4)


def test_a_joint_that_slides_is_drawn_between_what_it_joins():
    axes = Axes(
        place=np.array([[0.0, 0, 0], [np.nan] * 3]),
        direction=np.array([Z, X]),
        parent=np.array([BASE, 0]),
    )
    fixed = {BASE: [np.zeros(3)], 1: [np.array([2.0, 0, 0])]}
    place = _shortest(axes, np.arange(2), fixed)
    assert place == pytest.approx(np.array([[0, 0, 0], [1, 0, 0]]), abs=1e-4)


def test_links_with_several_ends_are_stars_and_unused_joints_are_left_out():
    axes = Axes(
        place=np.array([[0.0, 0, 0], [np.nan] * 3, [1, 0, 0], [-1, 0, 0]]),
        direction=np.array([Z, [np.nan] * 3, Z, Z]),
        parent=np.array([BASE, UNUSED, 0, 0]),
    )
    touchers = np.array([[1.0, 1, 0], [-1, 1, 0]])
    found = _skeleton(axes, touchers, np.array([2, 3]), [], [])
    assert found.joints.tolist() == [0, 2, 3]
    # Of the first link three joints; of each of the others a joint and a toucher.
    assert len(found.bones) == 3 + 2
    assert not found.slides.any()


def test_without_a_robot_the_skeleton_is_alone(data, monkeypatch):
    def unknown(self):
        raise MissingError("nobody knows it")

    monkeypatch.setattr(RunData, "world", property(unknown))
    alone = RunData(data.run)
    figure = skeleton(alone)
    assert len(figure.axes) == 2
    assert "in a unit of its own" in figure.get_suptitle()
    with pytest.raises(MissingError, match="nobody knows it"):
        fitted_skeleton(alone)


def test_a_rejected_model_has_no_skeleton(tmp_path):
    run = lay_out(tmp_path / "run", stage="learned")
    model = load_body_model(run)
    rejected = np.zeros_like(model.accepted_by_part)
    save_body_model(
        run, dataclasses.replace(model, accepted_by_part=rejected, reason="rejected: it is wet.")
    )
    with pytest.raises(MissingError, match="has no model of its body: rejected: it is wet"):
        skeleton(RunData(run))


def test_parts_that_were_not_accepted_are_not_drawn(tmp_path):
    run = lay_out(tmp_path / "run", kind="two_skins", stage="learned")
    model = load_body_model(run)
    half = dataclasses.replace(model, accepted_by_part=np.array([True, False]))
    q = np.zeros(12)
    assert len(found_skeleton(model, q).skins) == 2
    (only,) = found_skeleton(half, q).skins
    assert len(only) == np.sum(model.kernel_part == 0)
