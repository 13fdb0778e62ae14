import numpy as np
import pytest
import trimesh
from laid_out import places_of

from selftouch_drake.run.directory import MissingError
from selftouch_drake.show.page.figures import FIGURES
from selftouch_drake.show.page.report import report_page
from selftouch_drake.show.run_data import RunData
from selftouch_drake.show.skins import all_moved


def test_the_mirrored_recovered_body_is_drawn_the_right_way_out(reported):
    (part,) = RunData(reported).recovered
    assert part.closed
    assert trimesh.Trimesh(part.places, part.faces, process=False).volume > 0


def test_each_part_lies_on_the_skin_that_it_stands_for(two_skins):
    data = RunData(two_skins)
    assert [part.skins for part in data.recovered] == [(0,), (1,)]
    assert [part.closed for part in data.recovered] == [True, False]
    skin, places = places_of("two_skins")
    pose = data.home[skin]
    true = np.einsum("nij,nj->ni", pose[:, :, :3], places) + pose[:, :, 3]
    assert data.kernel_places == pytest.approx(true, abs=1e-6)


def test_a_part_with_a_rim_is_turned_outward(two_skins):
    data = RunData(two_skins)
    part = data.recovered[1]
    mesh = trimesh.Trimesh(part.places, part.faces, process=False)
    assert not mesh.is_watertight
    forearm = all_moved(data.skins, data.home)[1]
    outward = mesh.triangles_center - forearm.vertices.mean(axis=0)
    outward[:, 0] = 0.0  # the forearm lies along x
    assert (np.einsum("fi,fi->f", mesh.face_normals, outward) > 0).all()


def test_touches_are_counted_on_their_own_skin(two_skins):
    data = RunData(two_skins)
    for skin, density, count in zip(data.skins, data.touch_density, (250, 150), strict=True):
        area = trimesh.Trimesh(skin.vertices, skin.faces, process=False).area
        weights = np.bincount(
            skin.faces.ravel(),
            np.repeat(trimesh.Trimesh(skin.vertices, skin.faces, process=False).area_faces, 3),
        )
        mean = (density * weights).sum() / weights.sum()
        assert mean * area * 1e4 == pytest.approx(count, rel=0.1)


def test_several_touches_at_once_are_no_surface(reported, monkeypatch):
    data = RunData(reported)
    truth = data.kernel_truth
    vars(data)["kernel_truth"] = type(truth)(
        skin=truth.skin, positions=truth.positions, spread=truth.spread, share_single=0.7
    )
    with pytest.raises(MissingError, match="30% of the touches are at several places at once"):
        _ = data.recovered
    page = report_page(data, dict.fromkeys(FIGURES, "-"), "-")
    assert "No picture of the recovered body:</strong> 30% of the touches" in page
    assert "<strong>The body, the recovered body" not in page


def test_the_longest_executed_plan_is_shown(reported):
    assert RunData(reported).shown_pair == (0, 40)
