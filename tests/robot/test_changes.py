"""Changes of links, joints and skins of any robot, as the experiment describes them."""

import numpy as np
import pytest

from selftouch_drake.experiment import ExperimentError, load_experiment
from selftouch_drake.robot import ImperfectSkins, World

SMALL = {
    "skins": {
        "body": {
            "num_receptors": 12,
            "surface": {"shape": "sphere", "radius": 0.25, "resolution": 0.06},
        }
    }
}


def world(*changes, name="sphere", **fields):
    small = SMALL if name == "sphere" else {}
    return World(load_experiment(name, {**small, **fields, "changes": list(changes)}))


@pytest.fixture(scope="module")
def base():
    return world()


@pytest.fixture(scope="module")
def q(base):
    lower, upper = base.robot.babbled_range
    return np.random.default_rng(0).uniform(0.9 * lower, 0.9 * upper, (4000, 6))


def test_a_grown_link_carries_what_hangs_on_it_farther(base, q):
    grown = world({"links": {"forearm": 0.1}})
    assert grown.robot.joint_names == base.robot.joint_names
    assert np.array_equal(grown.limits.torque, base.limits.torque)
    moved = grown.robot.toucher_positions(q) - base.robot.toucher_positions(q)
    assert np.linalg.norm(moved, axis=2) == pytest.approx(0.04)


def test_growth_adds_up(base, q):
    twice = world({"links": {"forearm": 0.1}}, {"links": {"forearm": 0.5, "upper_arm": -0.5}})
    moved = twice.robot.toucher_positions(q) - base.robot.toucher_positions(q)
    assert np.linalg.norm(moved, axis=2).max() <= 0.4 * (1.1 * 1.5 - 1) + 0.2 + 1e-9


def test_a_tool_is_taken_in_hand_and_put_away(base, q):
    bare, far = base.robot.toucher_positions(q), {"tools": {"fingertip_0": [0.03, 0.0, 0.04]}}
    first = world({"tools": {"fingertip_0": [0.05, 0.0, 0.0]}})
    held = first.robot.toucher_positions(q) - bare
    assert np.linalg.norm(held, axis=2) == pytest.approx(0.05)
    # The last one counts.
    other = world({"tools": {"fingertip_0": [0.05, 0.0, 0.0]}}, far).robot.toucher_positions(q)
    assert np.linalg.norm(other - bare, axis=2) == pytest.approx(0.05)
    assert np.einsum("nta,nta->nt", other - bare, held) == pytest.approx(0.05 * 0.03)
    away = world(far, {"tools": {"fingertip_0": [0.0, 0.0, 0.0]}}).robot
    np.testing.assert_allclose(away.toucher_positions(q), bare)


def test_a_joint_whose_zero_moved_is_elsewhere_than_it_reads(base, q):
    shifted = world({"joints": {"elbow_pitch": 0.1}})
    true = q + 0.1 * (np.arange(6) == 2)
    assert shifted.robot.toucher_positions(q) == pytest.approx(base.robot.toucher_positions(true))
    assert shifted.robot.lower[2] == pytest.approx(base.robot.lower[2] - 0.1)
    assert np.array_equal(shifted.limits.velocity, base.limits.velocity)


def test_a_joint_that_slides_moves_by_metres():
    base, shifted = world(name="gantry"), world({"joints": {"rail_z": 0.05}}, name="gantry")
    place = base.robot.joint_names.index("rail_z")
    q = np.tile(base.robot.babbled_range[0], (3, 1))
    true = q + 0.05 * (np.arange(q.shape[1]) == place)
    assert shifted.robot.toucher_positions(q) == pytest.approx(base.robot.toucher_positions(true))


def test_a_skin_slips_and_stretches_with_its_receptors(base):
    before = base.skins[0]
    (after,) = world(
        {"skins": {"body": {"stretch": 1.1, "rpy_deg": [0, 0, 90], "translation": [0, 0, 0.02]}}}
    ).skins
    turned = 1.1 * before.wall.vertices @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]).T
    assert after.wall.vertices == pytest.approx(turned + np.array([0, 0, 0.02]))
    assert len(after.fields.p_LS) == 12


def felt(base, *changes):
    """The readings 1 to 12 after the change."""
    experiment = load_experiment("sphere", {**SMALL, "changes": list(changes)})
    skins = ImperfectSkins.of(experiment, base.skins)
    return skins(np.arange(1.0, 13.0)[None], np.zeros((1, 6)))[0]


def test_receptors_die_change_places_and_come_to_life(base):
    read = felt(base, {"skins": {"body": {"dead": [0, 3], "swapped": [[4, 5]]}}})
    assert read.tolist() == [0, 2, 3, 0, 6, 5, 7, 8, 9, 10, 11, 12]
    new = {"skins": {"body": {"new": [3], "swapped": [[0, 1]]}}}
    read = felt(base, {"skins": {"body": {"dead": [0, 3]}}}, new)
    assert read.tolist() == [2, 0, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]


def test_the_seed_draws_shares(base):
    half = {"skins": {"body": {"dead_share": 0.5}}}
    read = felt(base, half)
    assert np.count_nonzero(read == 0) == 6
    assert np.array_equal(read, felt(base, half))
    shuffled = felt(base, {"skins": {"body": {"swapped_share": 0.5}}})
    assert sorted(shuffled) == list(range(1, 13))
    assert np.count_nonzero(shuffled != np.arange(1, 13)) == 6


def test_what_is_still_to_come_changes_nothing(base, q):
    later = world({"after": 500, "links": {"forearm": 0.1}})
    assert np.array_equal(later.robot.toucher_positions(q), base.robot.toucher_positions(q))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"links": {"forarm": 0.1}}, "changes[0].links is 'forarm'; the robot has no such link"),
        ({"joints": {"elbow": 0.1}}, "changes[0].joints is 'elbow'; the robot has no such joint"),
    ],
)
def test_names_that_the_robot_does_not_have(change, text):
    with pytest.raises(ExperimentError) as error:
        _ = world(change).robot
    assert str(error.value).startswith(text)
