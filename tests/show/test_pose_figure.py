import numpy as np
import pytest
import trimesh

from selftouch_drake.show.page.motion_figures import learning_curve
from selftouch_drake.show.page.pose_figure import depth_below_surface, plan_poses

BOX = trimesh.creation.box(extents=(0.4, 0.4, 0.4))


def test_depth_is_measured_from_the_nearest_face():
    p = np.array([[0.0, 0.0, 0.0], [0.19, 0.0, 0.0], [0.0, -0.23, 0.0], [0.18, 0.17, 0.0]])
    depth = depth_below_surface(np.array(BOX.vertices), np.array(BOX.faces), p)
    assert depth == pytest.approx([0.2, 0.01, -0.03, 0.02], abs=1e-3)


@pytest.mark.parametrize("num_fingers", [1, 2])
def test_figure_four_shows_every_finger(num_fingers):
    along = np.linspace(-0.15, 0.15, 40)
    finger = np.stack([along, np.full(40, 0.02), np.full(40, 0.19)], axis=1)
    path = np.stack([finger, finger - [0.0, 0.04, 0.0]][:num_fingers], axis=1)
    kernels = finger[::4] + 0.01
    figure = plan_poses(
        np.array(BOX.vertices),
        np.array(BOX.faces),
        0.03,
        path,
        path[::8],
        embedding=kernels,
        edges=np.stack([np.arange(9), np.arange(1, 10)], axis=1),
        nodes=np.array([-1, 0, 3, 6, 9]),
    )
    depth = figure.axes[2].get_lines()
    assert len(depth) == num_fingers
    for line in depth:
        assert line.get_ydata() == pytest.approx(np.ones(40), abs=0.1)  # cm
    assert "cavity" in [text.get_text() for text in figure.axes[2].texts]


def test_the_learning_curve_adds_up_what_was_lost():
    naive, remembering = np.array([1.0, 0.9, 0.8]), np.array([1.0, 0.9, 1.0])
    figure = learning_curve(naive, remembering, np.array([1, 2, 2]))
    lines = figure.axes[0].get_lines()
    assert lines[0].get_ydata() == pytest.approx([0.0, 0.1, 0.3])
    assert lines[1].get_ydata() == pytest.approx([0.0, 0.1, 0.1])
    assert [bar.get_height() for bar in figure.axes[1].patches] == [1, 2]
