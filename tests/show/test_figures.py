import numpy as np
import pytest
import trimesh
from matplotlib.image import imread

from selftouch_drake.evaluation import touch_density
from selftouch_drake.show import FIGURES, write_figures
from selftouch_drake.show.graph_figures import spectral_order
from selftouch_drake.show.material import Material
from selftouch_drake.show.motion_figures import evenly_spaced
from selftouch_drake.show.scene import View, visible
from selftouch_drake.show.sensation_figures import far_apart


@pytest.fixture(scope="module")
def images(reported):
    return {path.stem: imread(path) for path in reported.figures.iterdir()}


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_shows_something(images, name):
    ink = (images[name][..., :3].min(axis=2) < 0.9).mean()
    assert ink > 0.01


@pytest.mark.parametrize("name", sorted(set(FIGURES) - {"persistence", "kernels"}))
def test_figures_have_shades_or_colours(images, name):
    colors = (images[name][..., :3] * 15).round() @ [1, 16, 256]
    assert len(np.unique(colors)) > 15


def test_the_same_run_gives_the_same_bytes(reported, monkeypatch):
    some = {name: FIGURES[name] for name in ("quotient_graph", "body_shape")}
    monkeypatch.setattr("selftouch_drake.show.figures.FIGURES", some)
    before = (reported.figures / "body_shape.png").read_bytes()
    written = write_figures(reported)
    assert [path.stem for path in written] == ["quotient_graph", "body_shape"]
    assert written[1].read_bytes() == before


def test_a_vector_file_keeps_letters_and_is_small(make_run, monkeypatch):
    run = make_run("planned")
    monkeypatch.setattr("selftouch_drake.show.figures.FIGURES", {"plan_path": FIGURES["plan_path"]})
    write_figures(run, vector=True)
    pdf = run.figures / "plan_path.pdf"
    first = pdf.read_bytes()
    assert first.startswith(b"%PDF")
    assert b"/TrueType" in first or b"/CIDFontType2" in first
    assert b"/Image" in first
    assert len(first) < 1e6
    write_figures(run, vector=True)
    assert pdf.read_bytes() == first, "the same run gives the same bytes"
    write_figures(run)
    assert not pdf.exists(), "not asked for"


@pytest.mark.parametrize(
    ("stage", "drawn"),
    [
        ("nothing", []),
        ("babbled", ["coverage"]),
        ("learned", list(FIGURES)[:8]),
        ("planned", list(FIGURES)[:9]),
    ],
)
def test_what_is_missing_is_skipped_with_a_reason(make_run, unrendered, stage, drawn):
    run, skipped = make_run(stage), {}
    written = write_figures(run, skipped=skipped.__setitem__)
    assert [path.stem for path in written] == drawn
    assert list(skipped) == [name for name in FIGURES if name not in drawn]
    assert all("run `selftouch " in reason for reason in skipped.values())


def test_a_figure_that_is_no_longer_true_is_removed(make_run, unrendered):
    run = make_run("babbled")
    run.figures.mkdir()
    stale = run.figures / "body_shape.png"
    stale.write_bytes(b"of an earlier representation")
    write_figures(run)
    assert not stale.exists()


def test_the_agents_figures_do_without_the_truth(make_run, unrendered):
    run, skipped = make_run("learned"), {}
    for path in run.truth.iterdir():
        path.unlink()
    write_figures(run, skipped=skipped.__setitem__)
    assert set(skipped) - set(list(FIGURES)[8:]) == {"coverage", "body_shape"}


def test_damage_is_an_error_that_names_the_file(make_run, unrendered):
    run = make_run("learned")
    run.topology.write_bytes(b"PK\x03\x04 damaged")
    with pytest.raises(ValueError, match=r"topology\.npz is damaged"):
        write_figures(run)


def test_the_mirrored_recovered_body_is_drawn_the_right_way_out(reported):
    points, faces = Material(reported).recovered
    assert trimesh.Trimesh(points, faces, process=False).volume > 0


def test_the_longest_executed_plan_is_shown(reported):
    assert Material(reported).shown_pair == (0, 40)


def test_a_point_is_visible_from_its_own_side_only():
    ball = trimesh.creation.icosphere(subdivisions=3)
    view = View(elevation=0.0, azimuth=0.0)
    points = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0.9, 0, 0], [0.7, 0.7, 0]])
    seen = visible(points, np.array(ball.vertices), np.array(ball.faces), view)
    assert seen.tolist() == [True, False, True, True]


def test_a_point_in_a_hollow_is_hidden_by_the_rim():
    ring = trimesh.creation.torus(major_radius=1.0, minor_radius=0.4)
    inner = np.array([[-0.6, 0.0, 0.0], [1.4, 0.0, 0.0]])
    seen = visible(inner, np.array(ring.vertices), np.array(ring.faces), View(0.0, 0.0))
    assert seen.tolist() == [False, True]


def test_projection_keeps_lengths_across_the_view():
    view = View(elevation=0.0, azimuth=0.0)
    assert view.project(np.array([0.0, 2.0, 3.0])) == pytest.approx([2.0, 3.0, 0.0])
    assert view.axes @ view.axes.T == pytest.approx(np.eye(3), abs=1e-12)


def test_touch_density_sums_to_the_touches():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.2)
    random = np.random.default_rng(0)
    p_WF = random.normal(size=(20_000, 3))
    p_WF *= 0.19 / np.linalg.norm(p_WF, axis=1, keepdims=True)
    density = touch_density(np.array(ball.vertices), np.array(ball.faces), [p_WF])
    assert density.mean() * ball.area * 1e4 == pytest.approx(20_000, rel=0.03)


def test_spectral_order_finds_a_line_again():
    place = np.random.default_rng(0).permutation(50)
    order = spectral_order(np.abs(place[:, None] - place).astype(float))
    found = place[order]
    assert (np.diff(found) == 1).all() or (np.diff(found) == -1).all()


def test_dots_are_evenly_spaced_whatever_the_samples():
    path = np.array([[0.0, 0, 0], [0.01, 0, 0], [1.0, 0, 0]])
    steps = np.linalg.norm(np.diff(evenly_spaced(path, 0.1), axis=0), axis=1)
    assert steps == pytest.approx(steps[0])
    assert steps[0] <= 0.1


def test_far_apart_rows_are_all_different():
    rows = np.repeat(np.eye(4), 3, axis=0)
    assert np.unique(rows[far_apart(rows, 4)], axis=0).shape == (4, 4)
