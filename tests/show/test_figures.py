import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from laid_out import execution_of
from matplotlib.image import imread

from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.show.outputs import write_figures
from selftouch_drake.show.page import motion_figures, robot_pictures
from selftouch_drake.show.page.figures import FIGURES
from selftouch_drake.show.page.scene import visible
from selftouch_drake.show.page.shape_figures import persistence, quotient_graph
from selftouch_drake.show.robot_shape import RobotShape
from selftouch_drake.show.run_data import RunData
from selftouch_drake.show.skins import SkinPath, SkinSurface
from selftouch_drake.show.style import View


@pytest.fixture(scope="module", params=["reported", "two_skins"])
def images(request):
    run = request.getfixturevalue(request.param)
    return {path.stem: imread(path) for path in run.figures.iterdir()}


def test_every_figure_shows_something_in_shades_or_colours(images):
    def ink(image) -> float:
        return (image[..., :3].min(axis=2) < 0.9).mean()

    def num_colors(image) -> int:
        return len(np.unique((image[..., :3] * 15).round() @ [1, 16, 256]))

    assert set(images) == set(FIGURES)
    assert [name for name, image in images.items() if ink(image) <= 0.01] == []
    few = {name for name, image in images.items() if num_colors(image) <= 15}
    assert few <= {"persistence"}


def test_the_same_run_gives_the_same_bytes(reported, tmp_path, monkeypatch):
    run = RunDirectory.open(shutil.copytree(reported.path, tmp_path / "run"))
    some = {name: FIGURES[name] for name in ("quotient_graph", "body_shape")}
    monkeypatch.setattr("selftouch_drake.show.page.figures.FIGURES", some)
    before = (run.figures / "body_shape.png").read_bytes()
    written = write_figures(run)
    assert list(written) == ["quotient_graph", "body_shape"]
    assert written["body_shape"].read_bytes() == before


def test_a_vector_file_keeps_letters_and_is_small(make_run, monkeypatch):
    run = make_run("planned")
    some = {"plan_path": FIGURES["plan_path"]}
    monkeypatch.setattr("selftouch_drake.show.page.figures.FIGURES", some)
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
        ("learned", [*list(FIGURES)[:7], "life", "growth"]),
        ("planned", [*list(FIGURES)[:8], "life", "growth"]),
    ],
)
def test_what_is_missing_is_skipped_with_a_reason(make_run, unrendered, stage, drawn):
    written = write_figures(make_run(stage))
    assert list(written) == list(FIGURES)
    assert [name for name, it in written.items() if isinstance(it, Path)] == drawn
    skipped = [reason for name, reason in written.items() if name not in drawn]
    assert all("run `selftouch " in reason for reason in skipped)


def test_a_figure_that_is_no_longer_true_is_removed(make_run, unrendered):
    run = make_run("babbled")
    run.figures.mkdir()
    stale = run.figures / "body_shape.png"
    stale.write_bytes(b"of an earlier representation")
    write_figures(run)
    assert not stale.exists()


def test_the_agents_figures_do_without_the_truth(make_run, unrendered):
    run = make_run("learned")
    for path in run.truth.iterdir():
        path.unlink()
    skipped = {name for name, it in write_figures(run).items() if isinstance(it, str)}
    assert skipped - set(list(FIGURES)[6:]) == {"coverage", "body_shape"}


def test_damage_is_an_error_that_names_the_file(make_run, unrendered):
    run = make_run("learned")
    run.topology.write_bytes(b"PK\x03\x04 damaged")
    with pytest.raises(ValueError, match=r"topology\.npz is damaged"):
        write_figures(run)


def test_a_skin_that_moves_is_drawn_where_its_link_is(two_skins):
    data = RunData(two_skins)
    body, forearm = data.home
    assert body == pytest.approx(np.eye(3, 4))
    # The elbow of an arm that is stretched forward, 0.15 m to the left and 0.35 m above the body.
    assert forearm[:, 3] == pytest.approx([0.4, 0.15, 0.35])


def test_the_agent_is_drawn_by_its_model(two_skins):
    data = RunData(two_skins)
    drawn = RobotShape(data.world).at(np.zeros(12))
    assert len(drawn.rods) == 0
    assert not any(drawn.touches), "balls touch, and no link"
    assert drawn.radii.tolist() == [0.01, 0.01]
    # Stretched forward: shoulder, two links of 0.4 m and a finger of 0.12 m.
    assert drawn.balls == pytest.approx(np.array([[0.92, 0.15, 0.35], [0.92, -0.15, 0.35]]))
    low, high = (
        f(np.concatenate([vertices for vertices, _ in drawn.links]), axis=0)
        for f in (np.min, np.max)
    )
    assert low[0] < 0.0 < 0.9 < high[0]


def test_the_legend_names_the_kinds_of_joints(two_skins):
    data = RunData(two_skins)
    drawn = RobotShape(data.world).at(np.zeros(12))
    figure = robot_pictures.agent(robot_pictures.Touching(data.skins, drawn))
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["joints that turn", "what touches", "receptors (32)"]


def ball_at(centre) -> SkinSurface:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    vertices = np.array(ball.vertices) + centre
    return SkinSurface(
        name="ball", vertices=vertices, faces=np.array(ball.faces), receptors=vertices[::40]
    )


def test_a_plan_over_several_skins_is_shown_skin_by_skin():
    skins = [ball_at(np.zeros(3)), ball_at(np.array([0.5, 0.0, 0.0]))]
    there = np.array([[0.5, 0.0, 0.1], [0.5, 0.05, 0.08]])
    here = np.array([[0.1, 0.0, 0.0], [0.08, 0.0, 0.06]])
    paths = [
        SkinPath(skin=0, points=here, rows=np.array([8, 9])),
        SkinPath(skin=1, points=there, rows=np.array([0, 1])),
    ]
    figure = motion_figures.plan_path(skins, paths, paths, 10)
    assert len(figure.axes) == 2
    one = motion_figures.plan_path(skins, paths[:1], paths[:1], 10)
    assert len(one.axes) == 2, "a single skin from two sides"


def test_time_in_the_air_is_no_lost_contact():
    execution = execution_of("two_skins")
    data = SimpleNamespace(shown_pair=(0, 1), execution=lambda *pair: execution)
    figure = motion_figures.felt_and_predicted(data)
    labels = [text.get_text() for text in figure.axes[2].get_legend().get_texts()]
    assert labels == ["in the air"]


def graph_of(embedding, edges, parts):
    """The data of a quotient graph, whose edges all cost the same."""
    known = SimpleNamespace(embedding=embedding, edges=edges, edge_cost=np.ones(len(edges)))
    kernels = [SimpleNamespace(kernels=part) for part in parts]
    return SimpleNamespace(representation=known, body=SimpleNamespace(parts=kernels))


def test_parts_are_shown_apart():
    embedding = np.random.default_rng(0).normal(size=(9, 3))
    embedding[8] = np.nan  # a fragment
    edges = np.array([[0, 1], [1, 2], [4, 5]])
    parts = [np.arange(4), np.arange(4, 8)]
    figure = quotient_graph(graph_of(embedding, edges, parts))
    titles = [ax.get_title(loc="left") for ax in figure.axes[:2]]
    assert titles == ["part 0: 4 kernels", "part 1: 4 kernels"]
    assert [len(ax.collections[0].get_segments()) for ax in figure.axes[:2]] == [2, 1]


def test_a_line_in_a_plane_is_shown_from_above_with_its_holes():
    angle = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(20)], axis=1)
    edges = np.stack([np.arange(20), np.roll(np.arange(20), -1)], axis=1)
    ax, _ = quotient_graph(graph_of(ring, edges, [np.arange(20)])).axes
    drawn = np.asarray(ax.collections[1].get_offsets())
    assert np.hypot(*drawn.T) == pytest.approx(np.ones(20)), "as a circle"
    diagram = [np.array([[0.0, 0.1]]), np.array([[0.2, 1.0]])]
    part = SimpleNamespace(topology=SimpleNamespace(diagram=diagram, betti=(1, 1)))
    (bars,) = persistence(SimpleNamespace(body=SimpleNamespace(parts=[part]))).axes
    assert bars.get_title(loc="left") == "components: 1, loops: 1"


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


def test_a_sheet_is_seen_from_both_sides_and_another_body_hides_it():
    vertices = np.array([[0.0, -1, -1], [0.0, 1, -1], [0.0, 1, 1], [0.0, -1, 1]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    for azimuth in (0.0, 180.0):
        view = View(0.0, azimuth)
        assert visible(vertices, vertices, faces, view, sheet=True).all()
    screen = vertices + np.array([0.5, 0.0, 0.0])
    assert not visible(
        0.9 * vertices, vertices, faces, View(0.0, 0.0), others=[(screen, faces)]
    ).any()


def test_projection_keeps_lengths_across_the_view():
    view = View(elevation=0.0, azimuth=0.0)
    assert view.project(np.array([0.0, 2.0, 3.0])) == pytest.approx([2.0, 3.0, 0.0])
    assert view.axes @ view.axes.T == pytest.approx(np.eye(3), abs=1e-12)
