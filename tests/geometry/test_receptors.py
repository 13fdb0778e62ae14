import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import dijkstra

from selftouch_drake.geometry import geodesics, hollow, receptors, surfaces

STANDARD_BODIES = {
    "sphere": surfaces.sphere(0.25),
    "cube": surfaces.cube(0.44),
    "torus": surfaces.torus(0.22, 0.09),
    "ellipsoid": surfaces.ellipsoid((0.30, 0.24, 0.20)),
    "cylinder": surfaces.cylinder(0.2, 0.4),
}


def _points_in_wall(surface, num_points, rng):
    """Points spread at random in the outer half of a skin 3 cm thick."""
    skin = hollow.hollow_skin(surface, 0.03)
    outer_half = skin.tetrahedra.reshape(-1, 2, 3, 4)[:, 0].reshape(-1, 4)
    tets = outer_half[rng.integers(len(outer_half), size=num_points)]
    return np.einsum("nk,nki->ni", rng.dirichlet(np.ones(4), num_points), skin.tet_vertices[tets])


@settings(max_examples=6, deadline=None)
@given(
    name=st.sampled_from(list(STANDARD_BODIES)),
    num_receptors=st.integers(20, 200),
    seed=st.integers(0, 2**32 - 1),
)
def test_fields_overlap_and_share_out_everything(name, num_receptors, seed):
    surface = STANDARD_BODIES[name]
    p_LS = receptors.place_receptors(surface, num_receptors, seed)
    fields = receptors.receptive_fields(surface, p_LS)
    np.testing.assert_array_equal(fields.p_LS, p_LS)
    p_LQ = _points_in_wall(surface, 300, np.random.default_rng(seed))
    for weights in (fields.vertex_weights, fields.weights_at(p_LQ)):
        assert weights.shape[1] == num_receptors
        assert weights.min() >= 0
        np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-12)
        assert (weights > 0).sum(axis=1).min() >= 3
    assert (fields.vertex_weights.sum(axis=0) > 0).all()


def test_fields_fall_with_the_fourth_power_towards_their_rim():
    surface = STANDARD_BODIES["sphere"]
    fields = receptors.receptive_fields(surface, receptors.place_receptors(surface, 60, seed=0))
    weights = fields.vertex_weights.toarray()
    # On the sphere, distances along the surface are arcs, up to its triangles.
    cosine = fields.vertices @ fields.p_LS.T / 0.25**2
    arc = 0.25 * np.arccos(cosine.clip(-1, 1))
    # All fields share a vertex in proportion to (1 - (d / r)^2)^2.
    bump = np.square(np.maximum(1 - np.square(arc / fields.radius), 0))
    expected = bump / bump.sum(axis=1, keepdims=True)
    assert np.abs(weights - expected).mean() < 0.03 * expected.mean()
    correlation = np.corrcoef(weights.ravel(), expected.ravel())[0, 1]
    assert correlation > 0.999


@pytest.mark.parametrize("name", STANDARD_BODIES)
def test_receptors_are_spread_evenly(name):
    surface = STANDARD_BODIES[name]
    p_LS = receptors.place_receptors(surface, 100, seed=0)
    distance = np.linalg.norm(p_LS[:, None] - p_LS, axis=2)
    nearest = np.sort(distance, axis=1)[:, 1]
    # A hexagonal pattern on the same area would be 1.07 square roots of the area of each apart.
    spacing = np.sqrt(surface.area / 100)
    assert nearest.min() > 0.55 * spacing
    assert nearest.max() < 1.35 * spacing


def test_an_uneven_layout_is_sparse_on_one_side_only():
    surface = STANDARD_BODIES["sphere"]
    even, uneven = (
        receptors.place_receptors(surface, 200, seed=0, unevenness=unevenness)
        for unevenness in (0.0, 0.6)
    )
    spacing = []
    for p_LS in (even, uneven):
        distance = np.linalg.norm(p_LS[:, None] - p_LS, axis=2)
        spacing.append(np.sort(distance, axis=1)[:, 1])
    assert spacing[0].max() / spacing[0].min() < 2
    few, many = np.quantile(spacing[1], [0.98, 0.02])
    assert 2 < few / many < 3.5
    # Few on one side: their mean lies off the centre.
    assert np.linalg.norm(uneven.mean(axis=0)) > 5 * np.linalg.norm(even.mean(axis=0))


def test_wide_fields_reach_as_much_farther():
    surface = STANDARD_BODIES["torus"]
    p_LS = receptors.place_receptors(surface, 50, seed=0)
    one, two = (receptors.receptive_fields(surface, p_LS, width=width) for width in (1.0, 2.0))
    assert two.radius == pytest.approx(2 * one.radius)
    np.testing.assert_allclose(two.vertex_weights.sum(axis=1), 1, atol=1e-12)
    assert 3 < two.vertex_weights.nnz / one.vertex_weights.nnz < 4.5


def test_the_seed_alone_chooses_the_receptors():
    surface = STANDARD_BODIES["torus"]
    first, again, other = (receptors.place_receptors(surface, 30, seed) for seed in (1, 1, 2))
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != other.tobytes()


@pytest.mark.parametrize("num_receptors", [4, 1000])
def test_few_and_many_receptors_share_out_everything(num_receptors):
    surface = surfaces.capsule(0.04, 0.2)
    p_LS = receptors.place_receptors(surface, num_receptors, seed=0)
    assert len(np.unique(p_LS, axis=0)) == num_receptors
    fields = receptors.receptive_fields(surface, p_LS)
    np.testing.assert_allclose(fields.vertex_weights.sum(axis=1), 1, atol=1e-12)
    assert (fields.vertex_weights > 0).sum(axis=1).min() >= 3
    distance = np.linalg.norm(p_LS[:, None] - p_LS, axis=2)
    nearest = np.sort(distance, axis=1)[:, 1]
    assert nearest.min() > 0.5 * np.sqrt(surface.area / num_receptors)


@pytest.mark.parametrize("width", [1.0, 0.7])
def test_fields_of_many_blocks_are_those_of_one_table(width, monkeypatch):
    surface = surfaces.capsule(0.04, 0.2)
    p_LS = receptors.place_receptors(surface, 30, seed=0)
    fields = receptors.receptive_fields(surface, p_LS, width=width)
    paths = geodesics.surface_paths(receptors._refined(surface, np.sqrt(surface.area / 30)))
    centre = np.linalg.norm(fields.vertices - fields.p_LS[:, None], axis=2).argmin(axis=1)
    distance = dijkstra(paths, indices=centre)
    assert fields.radius == width * 1.15 * np.sort(distance, axis=0)[2].max()
    bump = np.square(np.maximum(1 - np.square(distance / fields.radius), 0))
    total = np.maximum(bump.sum(axis=0), 1.0 if width < 1 else 0.0)
    np.testing.assert_allclose(fields.vertex_weights.toarray(), (bump / total).T, atol=1e-15)
    monkeypatch.setattr(receptors, "_AT_ONCE", 7)
    again = receptors.receptive_fields(surface, p_LS, width=width)
    assert np.array_equal(again.vertex_weights.toarray(), fields.vertex_weights.toarray())


@pytest.mark.parametrize("num_receptors", [3, 10_001])
def test_too_few_or_too_many_receptors_are_refused(num_receptors):
    with pytest.raises(ValueError, match="num_receptors") as caught:
        receptors.place_receptors(STANDARD_BODIES["cube"], num_receptors, seed=0)
    assert str(caught.value) == f"num_receptors is {num_receptors}; give 4 to 10000"


def test_paths_on_a_sphere_are_great_circles():
    surface = surfaces.sphere(0.25, resolution=0.01)
    distance = dijkstra(geodesics.surface_paths(surface), indices=0)
    cosine = surface.vertices @ surface.vertices[0] / 0.25**2
    exact = 0.25 * np.arccos(np.clip(cosine, -1, 1))
    np.testing.assert_allclose(distance, exact, rtol=0.02, atol=1e-4)


def test_paths_on_a_cube_run_over_its_edges():
    surface = surfaces.cube(0.44, resolution=0.01)
    start = np.argmin(np.linalg.norm(surface.vertices - (0.18, 0, 0.22), axis=1))
    distance = dijkstra(geodesics.surface_paths(surface), indices=start)
    x, y, z = surface.vertices.T
    # Unfold the side x = 0.22 about its upper edge; far from the other edges that is the shortest.
    side = np.isclose(x, 0.22) & (np.abs(y) < 0.15) & (z > 0)
    exact = np.hypot(0.22 - 0.18 + 0.22 - z, y)[side]
    assert (distance[side] >= exact - 1e-12).all()
    assert (distance[side] <= 1.03 * exact).all()


def test_a_touch_is_felt_by_the_nearest_receptors_at_their_place():
    for surface in STANDARD_BODIES.values():
        fields = receptors.receptive_fields(surface, receptors.place_receptors(surface, 50, seed=3))
        at_receptors = fields.weights_at(fields.p_LS).toarray()
        np.testing.assert_array_equal(at_receptors.argmax(axis=1), np.arange(50))


def test_opposite_walls_do_not_talk():
    # A tube 0.18 m wide, 0.28 m half-way round: a field reaches round it no farther than its
    # radius.
    surface = STANDARD_BODIES["torus"]
    fields = receptors.receptive_fields(surface, receptors.place_receptors(surface, 200, seed=0))
    assert fields.radius < 0.12
    top, bottom = fields.weights_at(np.array([[0.22, 0, 0.08], [0.22, 0, -0.08]])).toarray()
    assert (top * bottom == 0).all()
    # A slab with walls 0.1 m apart, and fields of more than 0.12 m.
    slab = surfaces.cylinder(0.25, 0.1, resolution=0.03)
    fields = receptors.receptive_fields(slab, receptors.place_receptors(slab, 40, seed=0))
    assert fields.radius > 0.12
    top, bottom = fields.weights_at(np.array([[0, 0, 0.04], [0, 0, -0.04]])).toarray()
    assert (top * bottom == 0).all()


def test_weights_change_little_between_neighbouring_points():
    for name, surface in STANDARD_BODIES.items():
        fields = receptors.receptive_fields(
            surface, receptors.place_receptors(surface, 100, seed=0)
        )
        rng = np.random.default_rng(0)
        faces = rng.integers(len(surface.faces), size=2000)
        bary = rng.dirichlet(np.ones(3), 2000)
        p_LQ = np.einsum("nk,nki->ni", bary, surface.triangles[faces])
        step = 1e-3 * rng.standard_normal((2000, 3))
        change = fields.weights_at(p_LQ + step) - fields.weights_at(p_LQ)
        # All weights together turn over within a field, that is some 150 mm: 1 % a millimetre.
        total = np.abs(change).sum(axis=1)
        assert np.mean(total) < 0.06, name
        assert total.max() < 0.4, name


def test_a_point_in_the_wall_beside_an_edge_belongs_to_its_nearest_face():
    surface = STANDARD_BODIES["cube"]
    fields = receptors.receptive_fields(surface, receptors.place_receptors(surface, 100, seed=0))
    below_top = fields.weights_at(np.array([[0.19, 0.01, 0.21]]))
    on_top = fields.weights_at(np.array([[0.19, 0.01, 0.22]]))
    assert np.abs(below_top - on_top).sum() < 0.1
