import itertools

import numpy as np
import pytest
import robots

from selftouch_drake.systems.simulation import simulation_of

# A torso and two arms whose upper parts overlap it, as in most models. All shapes have a pose.
DUMMY = (
    robots.link("base", robots.shape("capsule", "0 0 0.1 0 0 0", radius=0.1, length=0.1)),
    *(
        part
        for side, y in (("left", 0.15), ("right", -0.15))
        for part in (
            robots.link(
                f"{side}_upper",
                robots.shape("capsule", "0 0 -0.1 0.2 0 0", radius=0.06, length=0.2),
                pose=f"0 {y} 0.1 0 0 0",
            ),
            robots.link(
                f"{side}_lower",
                robots.shape("cylinder", "0.1 0 0 0 1.5 0", radius=0.04, length=0.2),
                robots.shape("ellipsoid", "0.22 0 0 0.3 0.2 0", radii="0.07 0.03 0.04"),
                pose=f"0 {y} -0.2 0 0 0",
            ),
            robots.joint(f"{side}_a", "revolute", "base", f"{side}_upper", "0.6 0.8 0", (-2, 2)),
            robots.joint(
                f"{side}_b", "revolute", f"{side}_upper", f"{side}_lower", "0 0.6 0.8", (-2.5, 2.5)
            ),
        )
    ),
)
PAIRS = {
    frozenset(pair)
    for pair in (
        ("base", "left_lower"),
        ("base", "right_lower"),
        ("left_upper", "right_upper"),
        ("left_upper", "right_lower"),
        ("left_lower", "right_upper"),
        ("left_lower", "right_lower"),
    )
}


@pytest.fixture(scope="module")
def dummy(tmp_path_factory):
    """A robot with rigid parts: skins on its torso's own geometry, and round an upper arm."""
    return robots.build(
        tmp_path_factory.mktemp("dummy"),
        *DUMMY,
        robot={"collision_depth": 0.01},
        skins={
            "torso": {"link": "base", "surface": "collision", "thickness": 0.01},
            "right_upper": {
                "link": "right_upper",
                "surface": {"shape": "cylinder", "radius": 0.09, "height": 0.2},
                "num_receptors": 20,
            },
        },
        touching={
            "left_hand": {"link": "left_lower"},
            "right_hand": {"frame": "right_lower", "radius": 0.02},
        },
    )


def brute_force(world, q):
    """`(N, P)` m, depth of each two links beyond the allowed one, computed by Drake."""
    station = robots.drakes_postures(world)
    depth = np.full((len(q), len(station.robot.rigid_pairs)), -np.inf)
    for row, at in enumerate(q):
        query = station.query(at)
        for number, pair in enumerate(station.robot.rigid_pairs):
            for a, b in itertools.product(*pair.geometry_ids):
                found = query.ComputeSignedDistancePairClosestPoints(a, b)
                beyond = -found.distance - pair.allowed_depth
                depth[row, number] = max(depth[row, number], beyond)
    return depth


def assert_as_deep(world, q, margin=0.0):
    """Asserts that the postures are impossible in which Drake finds a pair too deep."""
    impossible = world.probe.impossible(q, margin)
    depth = brute_force(world, q).max(axis=1) + margin
    # Drake's distances of round shapes are right to a few micrometres.
    known = np.abs(depth) > 1e-5
    np.testing.assert_array_equal(impossible[known], depth[known] > 0)
    assert known.mean() > 0.99
    return impossible


def test_possible_is_what_drake_s_signed_distances_allow(dummy):
    impossible = assert_as_deep(dummy, robots.anywhere(dummy.robot, 400, seed=0))
    assert 20 < impossible.sum() < 360


SHAPES = {
    "sphere": robots.shape("sphere", "0.01 0 0 0 0 0", radius=0.06),
    "ellipsoid": robots.shape("ellipsoid", "0 0.02 0 0.4 0 0", radii="0.09 0.05 0.03"),
    "capsule": robots.shape("capsule", "0 0 0.01 0 0.5 0", radius=0.03, length=0.1),
    "cylinder": robots.shape("cylinder", "0 0 0 0 0 0.3", radius=0.05, length=0.08),
    "box": robots.shape("box", "0 0 0 0.2 0.3 0.4", size="0.1 0.08 0.05"),
    "mesh": robots.shape("mesh", "0 0 0 0.3 0 0", uri="wedge.obj"),
}

#: A skin that nothing here presses.
COARSE = {"shape": "sphere", "radius": 0.3, "resolution": 0.1}


@pytest.mark.parametrize(
    "pair", [*itertools.combinations_with_replacement(SHAPES, 2)], ids="-".join
)
def test_two_shapes_of_each_kind_are_as_deep_in_each_other_as_in_drake(pair, tmp_path):
    corners = [(0, 0, 0), (0.12, 0, 0), (0, 0.1, 0), (0.02, 0.03, 0.09), (0.03, 0.02, 0.01)]
    (tmp_path / "wedge.obj").write_text(
        "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
        + "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\nf 1 2 5\n"
    )
    world = robots.build(
        tmp_path,
        robots.link("base", SHAPES[pair[0]]),
        robots.carried("hand", SHAPES[pair[1]], reach=0.1),
        skins={"base": {"link": "base", "surface": COARSE, "num_receptors": 10}},
        touching={"hand": {"frame": "hand_z", "radius": 0.01}},
    )
    q = robots.anywhere(world.robot, 200, seed=0)
    impossible = assert_as_deep(world, q)
    assert 20 < impossible.sum() < 190
    apart = assert_as_deep(world, q, margin=0.02)  # none nearer than 15 mm
    assert impossible.sum() < apart.sum() < 200


def test_what_is_possible_for_an_infant_is_what_drake_s_signed_distances_allow():
    infant = robots.shipped("infant")
    impossible = assert_as_deep(infant, robots.anywhere(infant.robot, 150, seed=0))
    assert 5 < impossible.sum() < 100


def test_links_next_to_each_other_are_no_pair(dummy):
    found = {frozenset(link.name() for link in pair.links) for pair in dummy.robot.rigid_pairs}
    assert found == PAIRS
    # Though they overlap: the upper arms hang beside the torso by less than they are thick.
    station = robots.drakes_postures(dummy)
    own = {
        link.name(): ids
        for pair in station.robot.rigid_pairs
        for link, ids in zip(pair.links, pair.geometry_ids, strict=True)
    }
    query = station.query(np.zeros(4))
    found = query.ComputeSignedDistancePairClosestPoints(own["base"][0], own["left_upper"][0])
    assert found.distance < -0.005
    assert not dummy.probe.impossible(np.zeros((1, 4))).any()


def test_skins_on_a_link_s_own_geometry_are_soft(dummy):
    depth = {
        frozenset(link.name() for link in pair.links): pair.allowed_depth
        for pair in dummy.robot.rigid_pairs
    }
    # The torso's skin is its outer layer; that of the upper arm is beside its geometry.
    assert depth == {pair: pytest.approx(0.02 if "base" in pair else 0.01) for pair in PAIRS}


def test_what_touches_is_no_rigid_part(dummy):
    inspector = dummy.robot.scene_graph.model_inspector()
    names = {
        inspector.GetName(g).split("::")[-1]
        for pair in dummy.robot.rigid_pairs
        for ids in pair.geometry_ids
        for g in ids
    }
    assert names == {"collision_0", "collision_1"}


def test_a_robot_without_rigid_parts_takes_every_posture(cube_world):
    q = robots.anywhere(cube_world.robot, 10, seed=0)
    np.testing.assert_array_equal(cube_world.probe.impossible(q), np.zeros(10, dtype=bool))


def test_no_postures_give_no_answers(dummy):
    assert dummy.probe.impossible(np.empty((0, 4))).shape == (0,)


def test_a_half_space_is_no_part_of_a_robot(tmp_path):
    world = robots.build(
        tmp_path,
        robots.link("base", robots.shape("plane")),
        robots.link("arm", pose="0.3 0 0 0 0 0"),
        robots.link("hand", robots.shape("sphere", radius=0.05), pose="0.6 0 0 0 0 0"),
        robots.joint("a", "revolute", "base", "arm"),
        robots.joint("b", "revolute", "arm", "hand"),
        skins={"base": {"link": "base", "surface": {"shape": "sphere", "radius": 0.1}}},
        touching={"hand": {"frame": "hand", "radius": 0.06}},
    )
    assert world.robot.rigid_pairs == ()
    assert not world.probe.impossible(robots.anywhere(world.robot, 20, seed=0)).any()


def test_rigid_parts_push_each_other_away_under_dynamics(dummy):
    robot, simulation = dummy.robot, simulation_of(dummy)
    q = robots.anywhere(robot, 2000, seed=3)
    free = q[~dummy.probe.impossible(q)]
    impossible = q[dummy.probe.impossible(q)]
    depth = brute_force(dummy, impossible)
    deep, depth = (each[depth.max(axis=1) > 0.02] for each in (impossible, depth))
    # All of an arm but what touches the torso, whose outer layer is its skin.
    torso = [any(link.name() == "base" for link in pair.links) for pair in robot.rigid_pairs]
    apart = ~(depth[:, torso] > 0).any(axis=1)
    for goal in deep[apart][:3]:
        start = free[np.linalg.norm(free - goal, axis=1).argmin()]
        path = np.stack([start, goal])
        simulation.follow(np.array([0.0, 1.0]), path, np.zeros((2, 4)), jump=True)
        simulation.advance_to(1.5)
        reached, wanted = brute_force(dummy, np.stack([simulation.q, goal])).max(axis=1)
        assert reached < wanted / 2
    assert apart.sum() >= 3
