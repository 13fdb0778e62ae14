"""Where a fist's centre is, with which exports are compared."""

from types import SimpleNamespace

import numpy as np
import trimesh

from benchmarks.accuracy import take_home
from selftouch_drake.agent.body_model.support import bulge


def test_a_fist_has_its_centre_radius_and_shape(monkeypatch):
    semi_axes, centre = np.array([0.024, 0.020, 0.028]), np.array([0.0, 0.001, -0.038])
    ball = trimesh.creation.icosphere(subdivisions=4)
    vertices = ball.vertices * semi_axes + centre
    monkeypatch.setattr(take_home, "triangles_in_frame", lambda *_: (vertices, ball.faces))
    shapes = SimpleNamespace(GetShape=lambda number: "a mesh")
    robot = SimpleNamespace(
        touchers=[SimpleNamespace(geometry_ids=[0])],
        scene_graph=SimpleNamespace(model_inspector=lambda: shapes),
    )
    form = take_home.form_of(robot, 0)
    np.testing.assert_allclose(form.centre, centre, atol=1e-4)
    u = ball.vertices[::40]
    touched = form.centre + form.radius * u + bulge(form.shape, u)
    true = centre + semi_axes**2 * u / np.linalg.norm(semi_axes * u, axis=1, keepdims=True)
    np.testing.assert_allclose(touched, true, atol=1e-3)
    assert np.abs(form.centre + form.radius * u - true).max() > 3e-3
