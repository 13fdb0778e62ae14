"""Experiments of exports: how far receptors feel, and how thick a skin fits."""

import numpy as np
import pytest
import trimesh
from made_up import sphere_points
from scipy.sparse import csr_array
from scipy.spatial.distance import cdist

from selftouch_drake.export import experiment_text as text_of_experiments
from selftouch_drake.export.experiment_text import Worn, experiment_text, fitting_thickness
from selftouch_drake.export.field_reach import field_reach


def test_fields_reach_as_far_as_touches_are_felt():
    touches, receptors = sphere_points(3000)[0], sphere_points(30)[0]
    felt = csr_array(np.maximum(0.4 - cdist(touches, receptors), 0.0))
    touches[5] = np.nan
    receptors[3] = np.nan
    assert field_reach(receptors, touches, felt) == pytest.approx(0.4, rel=0.05)
    assert np.isnan(field_reach(receptors, touches[:9], felt[:9]))


def test_the_experiment_has_fields_of_that_width():
    receptors = sphere_points(100, 0.2)[0]
    worn = {"mesh": "part_0.obj", "extents": np.full(3, 0.4), "thickness": 0.02}
    texts = [
        experiment_text(
            "d", "r.csv", {"part_0": Worn(receptors=receptors, reach=reach, **worn)}, {}
        )
        for reach in (np.nan, 0.06, 0.12, 9.0)
    ]
    widths = [float(text.partition("field_width: ")[2].split()[0]) for text in texts[1:]]
    assert "field_width" not in texts[0]
    assert widths[1] == pytest.approx(2 * widths[0], rel=0.01)
    assert widths[2] == 3.0


def test_a_skin_is_as_thick_as_fits(tmp_path, monkeypatch):
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    ball.export(tmp_path / "ball.obj")
    assert fitting_thickness(tmp_path / "ball.obj", ball.extents) == pytest.approx(0.016)
    two = trimesh.util.concatenate([ball, ball.copy().apply_translation([0.5, 0, 0])])
    two.export(tmp_path / "two.obj")
    assert np.isnan(fitting_thickness(tmp_path / "two.obj", two.extents))
    # Thicker than the ball is deep.
    monkeypatch.setattr(text_of_experiments, "_THICKNESS", 0.13)
    monkeypatch.setattr(text_of_experiments, "_THICKNESS_SHARE", 1.0)
    assert 0.03 < fitting_thickness(tmp_path / "ball.obj", ball.extents) < 0.1
