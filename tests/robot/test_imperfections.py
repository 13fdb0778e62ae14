import dataclasses

import numpy as np
import pytest
import robots
from hypothesis import example, given, settings
from hypothesis import strategies as st

from selftouch_drake.bodies.drake import DrakeBodies
from selftouch_drake.experience.collect import random_walk
from selftouch_drake.experiment import load_experiment
from selftouch_drake.experiment.schema import Imperfections, JointSettings
from selftouch_drake.robot import ImperfectSkins, World
from selftouch_drake.robot.imperfections import ImperfectSkin, remembered, slip, standard_noise
from selftouch_drake.systems.simulation import Simulation

WORST = {
    "cross_talk": 0.1,
    "multiplicative_noise": 0.05,
    "additive_noise": 0.02,
    "saturation": 2.0,
    "quantisation": 0.01,
    "dead": 0.1,
}
Q = np.random.default_rng(0).uniform(-3, 3, (400, 6)).astype(np.float32)


def flawed(world, *, seed=0, **flaws):
    """The same world with imperfect skins; each skin with its own imperfections, or all alike."""
    each = {name: flaws.get(name, flaws) for name in world.experiment.skins}
    skins = {
        name: dataclasses.replace(skin, imperfections=Imperfections(**each[name]))
        for name, skin in world.experiment.skins.items()
    }
    made = World(dataclasses.replace(world.experiment, skins=skins, seed=seed))
    # The skins themselves are the same.
    made.skins = world.skins
    return made


def imperfect(world, **flaws):
    """Readings of the first skin only."""
    made = flawed(world, **flaws)
    return ImperfectSkin.of(made.experiment, 0, made.skins[0])


def touches(world, num_touches=50):
    """`(n, J)` configurations that touch, and `(n, S)` sensations of a perfect skin."""
    q, felt = robots.touches(world)
    assert len(q) >= num_touches
    return q[:num_touches], felt[:num_touches]


def test_perfect_skins_need_no_readings(world):
    assert ImperfectSkins.of(world.experiment, world.skins) is None


def test_noise_is_normal_and_of_configuration_column_and_seed():
    q = np.random.default_rng(1).uniform(-3, 3, (5000, 6)).astype(np.float32)
    noise = standard_noise(q, 40, seed=7)
    assert abs(noise.mean()) < 0.01
    assert abs(noise.std() - 1) < 0.01
    assert abs((noise**4).mean() - 3) < 0.1
    assert abs((noise[1:] * noise[:-1]).mean()) < 0.01
    assert abs((noise[:, 1:] * noise[:, :-1]).mean()) < 0.01
    np.testing.assert_array_equal(standard_noise(q[::-1], 40, seed=7)[::-1], noise)
    np.testing.assert_array_equal(standard_noise(q[:5].astype(float), 40, seed=7), noise[:5])
    other = standard_noise(q, 40, seed=8)
    assert abs((noise * other).mean()) < 0.01
    nudged = standard_noise(q + np.float32(1e-6), 40, seed=7)
    assert abs((noise * nudged).mean()) < 0.01


def test_multiplicative_noise_is_a_share_of_the_reading(cube_world):
    q, felt = touches(cube_world)
    read = imperfect(cube_world, multiplicative_noise=0.05)(felt, q)
    error = read[felt > 0] / felt[felt > 0] - 1
    assert 0.04 < error.std() < 0.06
    np.testing.assert_array_equal(read == 0, felt == 0)


def test_additive_noise_touches_nothing_by_itself(cube_world):
    q, felt = touches(cube_world)
    read = imperfect(cube_world, additive_noise=0.02)
    silent = np.random.default_rng(1).uniform(-3, 3, (5000, 6))
    assert not read(np.zeros((len(silent), felt.shape[1])), silent).any()
    noisy = read(felt, q)
    assert set((noisy > 0).sum(axis=1)) != {felt.shape[1]}
    loud = felt > 0.3
    assert 0.015 < (noisy - felt)[loud].std() < 0.025
    # Below the agent's threshold there is nothing.
    assert noisy[noisy > 0].min() >= 6 * 0.02
    assert not noisy[felt == 0].any()


@pytest.mark.parametrize("threshold", [0.0, 0.5])
def test_the_threshold_may_be_given(cube_world, threshold):
    q, felt = touches(cube_world)
    read = imperfect(cube_world, additive_noise=0.02, threshold=threshold)(felt, q)
    assert read.min() == 0.0
    assert read[read > 0].min() >= threshold
    # Without one, half of the noise of silent receptors is heard.
    assert ((read > 0).mean() > 0.4) == (threshold == 0)


def test_readings_saturate_and_come_in_steps(cube_world):
    q, felt = touches(cube_world)
    assert felt.max() > 2.0
    read = imperfect(cube_world, saturation=2.0)(felt, q)
    np.testing.assert_array_equal(read, np.minimum(felt, 2.0))
    read = imperfect(cube_world, quantisation=0.25)(felt, q)
    np.testing.assert_array_equal(read % 0.25, 0)
    assert np.abs(read - felt).max() <= 0.125


def test_dead_receptors_read_nothing_and_the_seed_chooses_them(cube_world):
    felt = np.ones((len(Q), cube_world.experiment.num_receptors))
    read = imperfect(cube_world, dead=0.05)(felt, Q)
    assert (~read.any(axis=0)).sum() == 5
    np.testing.assert_array_equal(read[:, read.any(axis=0)], 1.0)
    assert (imperfect(cube_world, dead=0.05, seed=1)(felt, Q) != read).any()


def test_cross_talk_goes_to_neighbours_and_loses_nothing(cube_world):
    q, felt = touches(cube_world)
    read = imperfect(cube_world, cross_talk=0.2)(felt, q)
    np.testing.assert_allclose(read.sum(axis=1), felt.sum(axis=1), rtol=1e-12)
    fields = cube_world.skins[0].fields
    lone = np.eye(fields.num_receptors)
    spread = imperfect(cube_world, cross_talk=0.2)(lone, Q[: len(lone)])
    np.testing.assert_allclose(np.diag(spread), 0.8)
    distance = np.linalg.norm(fields.p_LS[:, None] - fields.p_LS, axis=2)
    assert distance[spread > 0].max() < 2 * fields.radius


@settings(max_examples=20, deadline=None)
@given(
    flaws=st.fixed_dictionaries(
        {},
        optional={
            "cross_talk": st.floats(0, 0.9),
            "multiplicative_noise": st.floats(0, 1),
            "additive_noise": st.floats(0, 10),
            "saturation": st.floats(0.001, 1000),
            "quantisation": st.floats(0, 10),
            "dead": st.floats(0, 0.9),
            "threshold": st.floats(0, 100),
        },
    ),
    force=st.floats(0, 1e3),
)
@example(flaws={"quantisation": 1e-320}, force=1.0)
def test_readings_are_forces_whatever_the_skin(flaws, force, cube_world):
    read = imperfect(cube_world, **flaws)
    if read is None:
        return
    felt = force * (np.arange(len(Q) * 100).reshape(-1, 100) % 7 == 0)
    found = read(felt, Q)
    assert np.isfinite(found).all()
    assert (found >= 0).all()
    assert (found[found > 0] >= read.threshold).all()


def test_each_skin_has_imperfections_of_its_own(two_arms):
    made = flawed(
        two_arms,
        body={},
        left_forearm={"dead": 0.5, "multiplicative_noise": 0.1},
        right_forearm={"dead": 0.5, "multiplicative_noise": 0.1},
    )
    q = np.tile(Q, 2)
    felt = np.ones((len(q), two_arms.experiment.num_receptors))
    read = ImperfectSkins.of(made.experiment, made.skins)(felt, q)
    body, left, right = (read[:, two_arms.receptor_skin == skin] for skin in range(3))
    np.testing.assert_array_equal(body, 1.0)
    alive = [forearm.any(axis=0) for forearm in (left, right)]
    assert alive[0].sum() == alive[1].sum() == 20
    # Seeds of their own: neither do the same receptors die, nor is it the same noise.
    assert (alive[0] != alive[1]).any()
    both = alive[0] & alive[1]
    assert abs(np.corrcoef(left[:, both].ravel(), right[:, both].ravel())[0, 1]) < 0.05


def test_the_first_skin_s_seed_is_that_of_a_robot_with_one_skin(cube_world, two_arms):
    experiment = flawed(cube_world, dead=0.1, additive_noise=0.01).experiment
    skin = dataclasses.replace(two_arms.skins[0], name="body")
    one = ImperfectSkin.of(experiment, 0, skin)
    chance = np.random.default_rng(experiment.random_stream("skin", 0))
    dead = chance.choice(100, 10, replace=False)
    assert sorted(dead) == np.flatnonzero(~one.alive).tolist()
    (seed,) = experiment.random_stream("skin", 1).generate_state(1, np.uint64)
    assert one.seed == int(seed)


@pytest.mark.parametrize("name", ["cube", "turning_body", "two_arms"])
def test_the_station_reads_what_the_probe_reads(name):
    world = robots.shipped(name)
    made = flawed(world, **WORST)
    q, felt = touches(world, 20)
    expected = made.probe.sensations(q)
    assert np.abs(expected - felt).max() > 0.05
    station = robots.DrakesPostures(made)
    for row in [*q, np.zeros(world.robot.num_joints)]:
        np.testing.assert_allclose(
            station.sensations(row[None]), made.probe.sensations(row[None]), rtol=0, atol=1e-9
        )
    np.testing.assert_array_equal(made.probe.sensations(q[::-1])[::-1], expected)


@pytest.mark.parametrize("name", ["cube", pytest.param("two_arms", marks=pytest.mark.slow)])
def test_a_dynamic_walk_reads_what_the_probe_reads(name):
    world = robots.shipped(name)
    made = flawed(world, multiplicative_noise=0.05, additive_noise=0.02, dead=0.05)
    babbling = dataclasses.replace(made.experiment.babbling, mode="dynamic")
    made = World(dataclasses.replace(made.experiment, babbling=babbling))
    body = DrakeBodies(made).babbling
    path = random_walk(made.experiment, body, 3).steps(100)
    followed = body.follow(made.experiment.babbling.step_duration * np.arange(100), path)
    sensation, q = followed.sensation, followed.q.astype(np.float32)
    expected = made.probe.sensations(q)
    assert expected.any(axis=1).sum() > 5
    # The configuration is stored in float32; a reading at the threshold may fall on either side.
    np.testing.assert_allclose(sensation, expected, atol=1e-3 * expected.max())


def logged_at_every_step(world, q, duration):
    """Sensations at every step of the plant between two configurations."""
    period = world.experiment.execution.time_step
    simulation = Simulation(world.experiment, world.skins, log_period=period)
    v = np.tile(np.diff(q, axis=0) / duration, (2, 1))
    simulation.follow(np.array([0.0, duration]), q, v, jump=True)
    simulation.advance_to(duration)
    return simulation.take_log()


def test_a_late_skin_reads_what_was_felt_before(two_arms):
    q, felt = robots.touches(two_arms)
    on_left = felt[:, two_arms.receptor_skin == 1].any(axis=1)
    start = q[on_left][0].astype(float)
    way = np.stack([start, start + 0.1])
    now = logged_at_every_step(two_arms, way, 0.3).felt
    made = flawed(two_arms, body={"delay": 0.1}, left_forearm={"delay": 0.05}, right_forearm={})
    late = logged_at_every_step(made, way, 0.3).felt
    assert now[0].any()
    assert now.any(axis=1).sum() > 5
    assert np.ptp(now, axis=0).max() > 0.1
    for skin, delay in enumerate((0.1, 0.05, 0.0)):
        columns = two_arms.receptor_skin == skin
        steps = round(delay / two_arms.experiment.execution.time_step)
        np.testing.assert_array_equal(late[steps:, columns], now[: len(now) - steps, columns])
        # What is touched at the beginning was touched before.
        first = np.tile(now[0, columns], (steps, 1))
        np.testing.assert_array_equal(late[:steps, columns], first)


def test_joints_are_remembered_with_noise_and_slip_once():
    exact = load_experiment("sphere")
    assert remembered(exact, Q) is Q
    np.testing.assert_array_equal(slip(exact, 6), 0)
    loose = dataclasses.replace(exact, joints=JointSettings(noise=0.01, offset=0.02))
    error = remembered(loose, Q) - Q
    assert remembered(loose, Q).dtype == np.float32
    assert 0.009 < error.std() < 0.011
    assert 0 < np.abs(slip(loose, 6)).max() < 0.1
    np.testing.assert_array_equal(slip(loose, 6), slip(loose, 6))
