"""The screen rejects much, and nothing that touches."""

import functools

import numpy as np
import pytest
import robots
import trimesh

from selftouch_drake.robot.broadphase import BroadPhase

SURFACES = {
    "sphere": {"shape": "sphere", "radius": 0.1},
    "cube": {"shape": "cube", "side": 0.2},
    "torus": {"shape": "torus", "major_radius": 0.12, "minor_radius": 0.06},
}
RADIUS = 0.01
# A pyramid, to be had as a file.
CORNERS = [(0.05, 0, -0.02), (-0.03, 0.05, -0.02), (-0.03, -0.05, -0.02), (0, 0, 0.06)]
FACES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
TOUCHERS = {
    "box": [robots.shape("box", "0.02 0.01 0 0.3 0.5 0.7", size="0.12 0.03 0.02")],
    "ellipsoid": [robots.shape("ellipsoid", "0 0 0.03 0 0.5 0", radii="0.06 0.02 0.01")],
    "capsule": [robots.shape("capsule", "0 0.05 0 1 0 0", radius=0.015, length=0.1)],
    "cylinder": [robots.shape("cylinder", radius=0.03, length=0.02)],
    "mesh": [robots.shape("mesh", "0.01 0 0 0.2 0 0", uri="pyramid.obj", scale="1 2 1")],
    "two_shapes": [
        robots.shape("sphere", "0.1 0 0 0 0 0", radius=0.02),
        robots.shape("box", "-0.1 0 0 0 0 0", size="0.03 0.03 0.03"),
    ],
    "skin": [],
}


@functools.cache
def screen_of(world):
    """The screen of a world's robot."""
    return BroadPhase(world.robot)


def may_touch(world, q):
    """`(N,)` bool, whether the screen passes any pair."""
    return screen_of(world).near(q).any(axis=1)


def on_rails(folder, surface):
    """A ball on three rails near a fixed skin: q is the position of the ball."""
    return robots.build(
        folder,
        robots.link("base"),
        robots.link("x", mass=0.1),
        robots.link("y", mass=0.1),
        robots.link("ball"),
        robots.joint("rail_x", "prismatic", "base", "x", "1 0 0", (-1e4, 1e4)),
        robots.joint("rail_y", "prismatic", "x", "y", "0 1 0", (-1e4, 1e4)),
        robots.joint("rail_z", "prismatic", "y", "ball", "0 0 1", (-1e4, 1e4)),
        skins={"body": {"link": "base", "surface": surface}},
        touching={"ball": {"frame": "ball", "radius": RADIUS}},
    )


@pytest.fixture(scope="module", params=SURFACES)
def ball(request, tmp_path_factory):
    """The ball near each of the skins."""
    return on_rails(tmp_path_factory.mktemp("ball"), SURFACES[request.param])


@pytest.fixture(scope="module")
def world_of_hands(tmp_path_factory):
    """All touchers, each movable anywhere, near a skin that moves as well."""
    folder = tmp_path_factory.mktemp("hands")
    trimesh.Trimesh(CORNERS, FACES).export(folder / "pyramid.obj")
    small = {"shape": "capsule", "radius": 0.04, "length": 0.05, "translation": [0, 0.01, 0]}
    hand = {"link": "skin", "surface": small, "thickness": 0.015, "num_receptors": 20}
    return robots.build(
        folder,
        robots.link("base"),
        robots.link("neck"),
        robots.link("body"),
        robots.joint("turn", "continuous", "base", "neck", "0 0.6 0.8", None),
        robots.joint("nod", "revolute", "neck", "body", "1 0 0", (-1, 1), pose="0 0 -0.1 0 0 0"),
        *(robots.carried(name, *geometries) for name, geometries in TOUCHERS.items()),
        skins={"body": {"link": "body", "surface": SURFACES["torus"]}, "hand": hand},
        touching={name: {"link": name} for name in TOUCHERS},
    )


class Hand:
    """One of the touchers; the others are out of the way."""

    def __init__(self, world, name):
        self.world, self.station = world, robots.drakes_postures(world)
        joints = world.robot.joint_names
        self.rails = [joints.index(f"{name}_{axis}_joint") for axis in "xyz"]
        self._lined_up = {
            joints.index(f"{other}_{axis}_joint"): 10.0 * number
            for number, other in enumerate(TOUCHERS, start=1)
            for axis in "xyz"
            if other != name
        }

    def anywhere(self, number, seed, reach):
        """Configurations with this hand up to `reach` m from the skin along each axis."""
        q = robots.anywhere(self.world.robot, number, seed)
        q[:, list(self._lined_up)] = list(self._lined_up.values())
        q[:, self.rails] *= reach / self.world.robot.upper[self.rails]
        return q

    def feels(self, q):
        """`(N,)` whether Drake finds a touch."""
        return self.station.sensations(q).any(axis=1)


@pytest.fixture(scope="module", params=TOUCHERS)
def hand(request, world_of_hands):
    """Each of the touchers."""
    return Hand(world_of_hands, request.param)


def test_it_changes_no_sensation(world):
    q = robots.configurations(world)
    screened = world.probe.sensations(q)
    np.testing.assert_allclose(
        screened, robots.drakes_postures(world).sensations(q), rtol=0, atol=1e-12
    )
    assert screened.any(axis=1).sum() > 100


def test_it_changes_no_sensation_whatever_touches(hand):
    q = hand.anywhere(500, seed=0, reach=0.25)
    screened, asked = hand.world.probe.sensations(q), hand.station.sensations(q)
    np.testing.assert_allclose(screened, asked, rtol=0, atol=1e-12 * asked.max())
    assert asked.any(axis=1).sum() > 25
    assert not may_touch(hand.world, q).all()
    assert may_touch(hand.world, q)[asked.any(axis=1)].all()


def test_it_passes_what_comes_near_enough_to_touch(hand):
    q = hand.anywhere(400, seed=1, reach=0.25)
    touching = q[hand.feels(q)][:12]
    assert len(touching) == 12
    away = touching.copy()
    away[:, hand.rails] += np.random.default_rng(2).choice([-1.0, 1.0], (12, 3))
    # Where on the way each touches no more, to a tenth of a micrometre.
    felt, free = np.zeros((12, 1)), np.ones((12, 1))
    while (free - felt).max() > 1e-7:
        middle = (felt + free) / 2
        feels = hand.feels(touching + middle * (away - touching))[:, None]
        felt, free = np.where(feels, middle, felt), np.where(feels, free, middle)
    assert may_touch(hand.world, touching + felt * (away - touching)).all()


def test_it_rejects_what_is_far(hand):
    q = hand.anywhere(500, seed=3, reach=2.0)
    far = np.linalg.norm(q[:, hand.rails], axis=1) > 0.7
    assert far.sum() > 100
    assert not may_touch(hand.world, q[far]).any()


def test_a_ball_in_the_wall_passes(ball):
    (wall,) = (skin.wall for skin in ball.skins)
    rng = np.random.default_rng(2)
    corners = wall.tet_vertices[wall.tetrahedra]
    tets = corners[rng.integers(len(corners), size=20_000)]
    inside = np.einsum("nk,nki->ni", rng.dirichlet(np.ones(4), 20_000), tets)
    away = rng.standard_normal((20_000, 3))
    away *= RADIUS / np.linalg.norm(away, axis=1, keepdims=True)
    assert may_touch(ball, inside).all()
    assert may_touch(ball, inside + away).all()


def test_a_ball_that_just_touches_passes(ball):
    (wall,) = (skin.wall for skin in ball.skins)
    rng = np.random.default_rng(2)
    for side, vertices in ((1, wall.vertices), (-1, wall.inner_vertices)):
        surface = trimesh.Trimesh(vertices, wall.faces, process=False)
        face = rng.integers(len(surface.faces), size=200_000)
        on_surface = np.einsum(
            "nk,nki->ni", rng.dirichlet(np.ones(3), len(face)), surface.triangles[face]
        )
        assert may_touch(ball, on_surface + side * RADIUS * surface.face_normals[face]).all()


@pytest.mark.parametrize("q", [[9.0, 0, 0], [0, -9.0, 0], [0, 0, 1e4]])
def test_a_ball_far_away_is_rejected(ball, q):
    assert not may_touch(ball, np.array([q]))[0]


def test_it_saves_work(world):
    q = robots.configurations(world)[:2000]
    touching = world.probe.sensations(q).any(axis=1).mean()
    assert 0 < touching <= may_touch(world, q).mean() < 0.1 + 3 * touching


def test_one_of_two_balls_in_touch_is_enough(tmp_path):
    rails = [
        part
        for side in ("left", "right")
        for part in (
            robots.link(f"{side}_mount", mass=0.1),
            robots.joint(f"{side}_turn", "revolute", "base", f"{side}_mount"),
            robots.link(side),
            robots.joint(f"{side}_rail", "prismatic", f"{side}_mount", side, "1 0 0", (-9, 9)),
        )
    ]
    world = robots.build(
        tmp_path,
        robots.link("base"),
        *rails,
        skins={"body": {"link": "base", "surface": SURFACES["sphere"]}},
        touching={side: {"frame": side, "radius": RADIUS} for side in ("left", "right")},
    )
    rails = np.flatnonzero(~world.robot.turns)
    q = np.zeros((3, 4))
    q[:, rails] = [[9.0, 9.0], [9.0, 0.1], [0.1, 9.0]]
    np.testing.assert_array_equal(may_touch(world, q), [False, True, True])


def test_no_configurations_give_an_empty_result(world):
    none = np.empty((0, world.robot.num_joints))
    assert may_touch(world, none).shape == (0,)
    assert world.probe.sensations(none).shape == (0, world.experiment.num_receptors)
