import numpy as np
import pytest
import trimesh

from selftouch_drake.experience import RandomWalk
from selftouch_drake.geometry import FINGERTIP_RADIUS
from selftouch_drake.robot.probe import TouchScreen


class NoScreen:
    """Lets Drake be asked about every configuration."""

    def may_touch(self, p_BF):
        return np.ones(len(p_BF), dtype=bool)


@pytest.fixture(scope="module")
def screen(world):
    return TouchScreen(world.skin)


def _configurations(agent):
    """Some all over the place, and some of a walk, which stays where it touches for a while."""
    anywhere = np.random.default_rng(1).uniform(agent.lower, agent.upper, (2000, 6))
    walk = RandomWalk(
        lower=agent.lower,
        upper=agent.upper,
        step_size=0.15,
        persistence=0.9,
        seed=np.random.SeedSequence(1),
    )
    return np.concatenate([anywhere, walk.steps(4000)])


def test_the_screen_changes_no_sensation(world, monkeypatch):
    q = _configurations(world.probe.agent)
    screened = world.probe.sensations(q)
    monkeypatch.setattr(world.probe, "_screen", NoScreen())
    np.testing.assert_array_equal(screened, world.probe.sensations(q))
    assert screened.any(axis=1).sum() > 100


def test_the_screen_passes_every_fingertip_that_meets_the_skin(world, screen):
    rng = np.random.default_rng(2)
    corners = world.skin.tet_vertices[world.skin.tetrahedra]
    tets = corners[rng.integers(len(corners), size=20_000)]
    inside = np.einsum("nk,nki->ni", rng.dirichlet(np.ones(4), 20_000), tets)
    away = rng.standard_normal((20_000, 3))
    away *= FINGERTIP_RADIUS / np.linalg.norm(away, axis=1, keepdims=True)
    assert screen.may_touch(inside[:, None]).all()
    assert screen.may_touch((inside + away)[:, None]).all()


def test_the_screen_passes_every_fingertip_that_just_touches(world, screen):
    rng = np.random.default_rng(2)
    for side, vertices in ((1, world.skin.vertices), (-1, world.skin.inner_vertices)):
        surface = trimesh.Trimesh(vertices, world.skin.faces, process=False)
        face = rng.integers(len(surface.faces), size=200_000)
        on_surface = np.einsum(
            "nk,nki->ni", rng.dirichlet(np.ones(3), len(face)), surface.triangles[face]
        )
        p_BF = on_surface + side * FINGERTIP_RADIUS * surface.face_normals[face]
        assert screen.may_touch(p_BF[:, None]).all()


def test_the_screen_saves_work(world, screen):
    q = _configurations(world.probe.agent)[:2000]
    may_touch = screen.may_touch(world.probe.kinematics.positions(q))
    assert 0 < may_touch.mean() < 0.25


@pytest.mark.parametrize("p_BF", [[0.0, 0, 0.05], [9.0, 0, 0], [0, -9.0, 0], [0, 0, 1e6]])
def test_the_screen_rejects_what_is_far_away(screen, p_BF):
    assert not screen.may_touch(np.array([[p_BF]]))[0]


def test_one_finger_in_touch_is_enough(world, screen):
    far, near = np.array([9.0, 0, 0]), world.skin.vertices[0]
    np.testing.assert_array_equal(
        screen.may_touch(np.array([[far, far], [far, near], [near, far]])), [False, True, True]
    )


def test_sensations_do_not_depend_on_what_was_asked_before(world):
    q = _configurations(world.probe.agent)
    touching = q[world.probe.sensations(q).any(axis=1)][:20]
    together = world.probe.sensations(touching)
    alone = np.concatenate([world.probe.sensations(row[None]) for row in touching[::-1]])
    np.testing.assert_array_equal(together, alone[::-1])
