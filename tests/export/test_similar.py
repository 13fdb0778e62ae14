"""A model in another unit, and its mirror image."""

import numpy as np
import pytest
from made_up import made_up_model, readings

from selftouch_drake.export.similar import similar_model

FLIP = np.diag([-1.0, 1.0, 1.0])


@pytest.mark.parametrize("mirrored", [False, True])
def test_places_are_those_of_the_similar_body(mirrored):
    model, q = made_up_model(), readings(40)
    similar = similar_model(model, metres=0.3, mirrored=mirrored)
    flip = FLIP if mirrored else np.eye(3)
    target = np.arange(40) * 3  # both parts, and touchers with and without a shape
    assert set(model.kernel_part[target]) == {0, 1}
    found, expected = similar.place(q, target), 0.3 * model.place(q, target) @ flip
    np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_allclose(similar.receptor_sigma, 0.3 * model.receptor_sigma)
    np.testing.assert_allclose(similar.receptor_normal, model.receptor_normal @ flip)
    poses, before = similar.link_poses(q), model.link_poses(q)
    np.testing.assert_allclose(poses[..., :3, :3], flip @ before[..., :3, :3] @ flip, atol=1e-12)


def test_a_mirror_image_is_no_turned_body():
    model = made_up_model()
    similar = similar_model(model, mirrored=True)
    before, after = (
        np.linalg.det(m.kernel_place[[0, 5, 9]] - m.kernel_place[20]) for m in (model, similar)
    )
    assert before == pytest.approx(-after)
    assert (similar_model(similar, mirrored=True).twists == model.twists).all()
