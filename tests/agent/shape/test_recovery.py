import numpy as np
import pytest
from bodies_by_hand import flat_torus, shape_error
from skins import touch

from selftouch_drake.agent.representation.estimator import QuotientLearner
from selftouch_drake.agent.shape.recovery import DistrustWarning, recover
from selftouch_drake.agent.shape.surface import fitted_surface

pytestmark = pytest.mark.usefixtures("module_without_networks")


@pytest.fixture(scope="module")
def three(module_without_networks):
    """A sphere, a bowl and a tube, and the true position of each kernel."""
    q, sensation, skin, place = touch(["sphere", "cap", "tube"], 30_000)
    representation = QuotientLearner(420, random_state=0).fit(sensation, q).representation_
    rows = [representation.kernel_row[representation.members(k)] for k in range(420)]
    of_kernel = np.array([np.bincount(skin[r]).argmax() for r in rows])
    true = np.array([np.median(place[r], axis=0) for r in rows])
    return representation, of_kernel, true


@pytest.mark.parametrize("metric", ["motor", "sensorimotor"])
def test_every_part_has_its_own_shape_holes_and_dimension(three, metric):
    representation, skin, true = three
    body = recover(representation, metric)
    assert representation.num_parts == len(body.parts) == 3
    found = {}
    for part in body.parts:
        (number,) = np.unique(skin[part.kernels])
        found[int(number)] = part.topology.betti
        assert shape_error(part.positions, true[part.kernels]) < 0.1
        assert 1.5 < part.dimension < 2.6
    assert found == {0: (1, 0, 1), 1: (1, 0, 0), 2: (1, 1, 0)}
    assert np.array_equal(body.positions[body.parts[1].kernels], body.parts[1].positions)
    embedded = body.embed(representation)
    assert np.isfinite(embedded.embedding).all()
    assert np.isfinite(body.distances).sum() == sum(len(p.kernels) ** 2 for p in body.parts)


def test_a_part_of_several_is_recovered_as_if_it_were_alone(three):
    representation, _, _ = three
    part = recover(representation, "motor", holes=False).parts[2]
    alone = recover(representation.restricted(part.kernels), "motor", holes=False)
    np.testing.assert_array_equal(alone.parts[0].distances, part.distances)
    np.testing.assert_array_equal(alone.parts[0].positions, part.positions)
    assert alone.parts[0].topology is alone.parts[0].dimension is None


def test_a_patch_has_a_surface_with_a_rim(three):
    representation, skin, _ = three
    for part in recover(representation, "sensorimotor").parts:
        faces = fitted_surface(part.places, part.topology)
        directed = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        _, met = np.unique(directed, axis=0, return_counts=True)
        closed = skin[part.kernels[0]] == 0
        assert (met >= 2).all() == closed
        assert len(np.unique(faces)) > 0.95 * len(part.places)
        if not closed:
            # A sheet: hardly any edge belongs to more than two triangles.
            assert np.mean(met <= 2) > 0.8


def test_a_fragment_is_kept_but_not_recovered():
    q, sensation, _, _ = touch(["sphere"], 8000)
    # A receptor elsewhere that is always touched alone.
    rng = np.random.default_rng(0)
    spot = np.zeros((400, sensation.shape[1] + 2), dtype=np.float32)
    spot[:, -2:] = rng.uniform(0.5, 1.0, (400, 2))
    sensation = np.vstack([np.pad(sensation, ((0, 0), (0, 2))), spot])
    q = np.vstack([q, rng.uniform(3.0, 3.2, (400, 5))])
    representation = QuotientLearner(150, random_state=0).fit(sensation, q).representation_
    sizes = np.bincount(representation.part)
    assert len(sizes) == 2
    assert 0 < sizes[1] < 12
    assert representation.num_parts == 1
    body = recover(representation, "motor")
    assert len(body.parts) == 1
    lost = np.isnan(body.positions).all(axis=1)
    np.testing.assert_array_equal(lost, representation.part == 1)


def lone_part(shape, metric):
    """A body of one part, and the true positions of its kernels."""
    q, sensation, _, place = touch([shape], 12_000, num_receptors=24, width=0.9)
    representation = QuotientLearner(100, random_state=0).fit(sensation, q).representation_
    rows = [representation.kernel_row[representation.members(k)] for k in range(100)]
    return recover(representation, metric), np.array([np.median(place[r], axis=0) for r in rows])


@pytest.mark.slow
def test_a_line_of_skin_is_laid_out_in_a_plane():
    body, true = lone_part("ring", "learned")
    (part,) = body.parts
    assert (part.skin_dimension, part.space_dimension) == (1, 2)
    assert part.positions.shape == (100, 2)
    assert part.topology.betti == (1, 1, 0)
    assert part.dimension == pytest.approx(1, abs=0.15)
    assert shape_error(body.positions, true) < 0.04
    assert len(np.unique(fitted_surface(part.places, part.topology, skin=1))) == len(part.places)
    assert body.expected_error is None


def test_a_flat_patch_is_laid_out_in_a_plane():
    body, true = lone_part("square", "sensorimotor")
    (part,) = body.parts
    assert (part.skin_dimension, part.space_dimension) == (2, 2)
    assert part.topology.betti == (1, 0, 0)
    assert np.all(body.positions[:, 2] == 0)
    assert shape_error(body.positions, true) < 0.03
    assert len(np.unique(fitted_surface(part.places, part.topology))) == len(part.places)


def test_a_body_without_a_place_in_space_is_said_to_need_a_fourth_dimension():
    u, v = np.random.default_rng(0).uniform(0, 2 * np.pi, (2, 8000))
    place, receptors = (
        np.stack([np.cos(u), np.sin(u), np.cos(v), np.sin(v)], axis=1),
        flat_torus(60),
    )
    apart = np.linalg.norm(place[:, None] - receptors, axis=2)
    sensation = np.clip(1.0 - apart / 1.2, 0.0, None)
    representation = QuotientLearner(200, random_state=0).fit(sensation, place).representation_
    body = recover(representation, "sensorimotor")
    (part,) = body.parts
    assert (part.skin_dimension, part.space_dimension) == (2, 4)
    assert part.positions.shape == (200, 3)
    with pytest.warns(DistrustWarning) as caught:
        body.warn_of_misfit()
    assert str(caught[0].message) == (
        "the recovered body does not fit in space: the fourth eigenvalue is "
        f"{part.embedding.fourth_eigenvalue:.0%} of the first, above 15%: it needs a fourth "
        "dimension, and is laid out in three"
    )
