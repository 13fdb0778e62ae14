import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydrake.trajectories import PiecewisePolynomial
from tests.robot.conftest import MovingAgent

from selftouch_drake.experience import RandomWalk
from selftouch_drake.experience.sources import DynamicSource
from selftouch_drake.experiment import Experiment, Imperfections, Joints, experiment_from_fields
from selftouch_drake.robot import ContactProbe, MakeKinematicStation, Readings
from selftouch_drake.robot.execution import DynamicWorld
from selftouch_drake.robot.joints import remembered, slip
from selftouch_drake.robot.readings import standard_noise

WORST = {
    "cross_talk": 0.1,
    "multiplicative_noise": 0.05,
    "additive_noise": 0.02,
    "saturation": 2.0,
    "quantisation": 0.01,
    "dead": 0.1,
}
Q = np.random.default_rng(0).uniform(-3, 3, (400, 6)).astype(np.float32)


def flawed(world, **flaws):
    """The same world with a skin that is not perfect."""
    skin = dataclasses.replace(world.experiment.skin, imperfections=Imperfections(**flaws))
    experiment = dataclasses.replace(world.experiment, skin=skin)
    return SimpleNamespace(experiment=experiment, skin=world.skin, fields=world.fields)


def readings(world, **flaws):
    made = flawed(world, **flaws)
    return Readings.of(made.experiment, made.fields)


def touches(world, num_touches=50):
    """`(n, 6)` configurations that touch, and `(n, S)` what a perfect skin feels there."""
    agent = world.probe.agent
    q = np.random.default_rng(3).uniform(agent.lower, agent.upper, (4000, 6)).astype(np.float32)
    felt = world.probe.sensations(q)
    rows = np.flatnonzero(felt.any(axis=1))[:num_touches]
    assert len(rows) == num_touches
    return q[rows], felt[rows]


def test_a_perfect_skin_needs_no_readings(world):
    assert readings(world) is None


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
    read = readings(cube_world, multiplicative_noise=0.05)(felt, q)
    error = read[felt > 0] / felt[felt > 0] - 1
    assert 0.04 < error.std() < 0.06
    np.testing.assert_array_equal(read == 0, felt == 0)


def test_additive_noise_touches_nothing_by_itself(cube_world):
    q, felt = touches(cube_world)
    read = readings(cube_world, additive_noise=0.02)
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
    read = readings(cube_world, additive_noise=0.02, threshold=threshold)(felt, q)
    assert read.min() == 0.0
    assert read[read > 0].min() >= threshold
    assert (read > 0).mean() == pytest.approx(0.5, abs=0.1) if threshold == 0 else True


def test_readings_saturate_and_come_in_steps(cube_world):
    q, felt = touches(cube_world)
    assert felt.max() > 2.0
    read = readings(cube_world, saturation=2.0)(felt, q)
    np.testing.assert_array_equal(read, np.minimum(felt, 2.0))
    read = readings(cube_world, quantisation=0.25)(felt, q)
    np.testing.assert_array_equal(read % 0.25, 0)
    assert np.abs(read - felt).max() <= 0.125


def test_dead_receptors_read_nothing_and_the_seed_chooses_them(cube_world):
    q = Q
    felt = np.ones((len(q), cube_world.fields.num_receptors))
    read = readings(cube_world, dead=0.05)(felt, q)
    assert (~read.any(axis=0)).sum() == 5
    np.testing.assert_array_equal(read[:, read.any(axis=0)], 1.0)
    other = flawed(cube_world, dead=0.05)
    other.experiment.seed = 1
    assert (Readings.of(other.experiment, other.fields)(felt, q) != read).any()


def test_cross_talk_goes_to_neighbours_and_loses_nothing(cube_world):
    q, felt = touches(cube_world)
    read = readings(cube_world, cross_talk=0.2)(felt, q)
    np.testing.assert_allclose(read.sum(axis=1), felt.sum(axis=1), rtol=1e-12)
    p_BS = cube_world.fields.p_BS
    lone = np.eye(len(p_BS))
    spread = readings(cube_world, cross_talk=0.2)(lone, Q[: len(lone)])
    np.testing.assert_allclose(np.diag(spread), 0.8)
    distance = np.linalg.norm(p_BS[:, None] - p_BS, axis=2)
    assert distance[spread > 0].max() < 2 * cube_world.fields.radius


@settings(max_examples=40, deadline=None)
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
    read = readings(cube_world, **flaws)
    if read is None:
        return
    felt = force * (np.arange(len(Q) * 100).reshape(-1, 100) % 7 == 0)
    found = read(felt, Q)
    assert np.isfinite(found).all()
    assert (found >= 0).all()
    assert (found[found > 0] >= read.threshold).all()


def test_the_station_reads_what_the_probe_reads(world):
    made = flawed(world, **WORST)
    probe = ContactProbe(made.experiment, made.skin, made.fields)
    diagram = MakeKinematicStation(made.experiment, made.skin, made.fields).diagram
    q, felt = touches(world, 20)
    expected = probe.sensations(q)
    assert np.abs(expected - felt).max() > 0.05
    context = diagram.CreateDefaultContext()
    for row in [*q, np.zeros(6)]:
        diagram.GetInputPort("q").FixValue(context, row)
        sensation = diagram.GetOutputPort("sensation").Eval(context)
        np.testing.assert_allclose(sensation, probe.sensations(row[None])[0], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(probe.sensations(q[::-1])[::-1], expected)


def _walk(agent):
    return RandomWalk(
        lower=agent.lower,
        upper=agent.upper,
        step_size=0.15,
        persistence=0.9,
        seed=np.random.SeedSequence(3),
    )


def test_a_dynamic_walk_reads_what_the_probe_reads(cube_world):
    made = flawed(cube_world, multiplicative_noise=0.05, additive_noise=0.02, dead=0.05)
    source = DynamicSource(made.experiment, made.skin, made.fields)
    source.begin(_walk(source.agent))
    q, sensation = source.next_steps()
    expected = ContactProbe(made.experiment, made.skin, made.fields).sensations(q)
    assert expected.any(axis=1).sum() > 10
    # The configuration is stored in float32; a reading at the threshold may fall on either side.
    np.testing.assert_allclose(sensation, expected, atol=1e-3 * expected.max())


def test_a_late_skin_reads_what_was_felt_before(cube_world):
    (q, *_), _ = touches(cube_world, 1)
    goal = q + np.array([0, 0, 0.2, 0, 0, 0])
    path = PiecewisePolynomial.FirstOrderHold([0.0, 0.5], np.stack([q, goal], axis=1))
    now, late = (
        MovingAgent(made).follow(path, start=q, duration=0.5).sensation
        for made in (flawed(cube_world), flawed(cube_world, delay=0.05))
    )
    assert now.any(axis=1).sum() > 5
    steps = round(0.05 / cube_world.experiment.execution.time_step)
    np.testing.assert_array_equal(late[steps:], now[:-steps])
    # What is touched at the beginning was touched before.
    np.testing.assert_array_equal(late[:steps], np.tile(now[0], (steps, 1)))


def test_joints_are_remembered_with_noise_and_slip_once():
    exact = Experiment()
    assert remembered(exact, Q) is Q
    np.testing.assert_array_equal(slip(exact, 6), 0)
    loose = experiment_from_fields({"joints": {"noise": 0.01, "offset": 0.02}})
    error = remembered(loose, Q) - Q
    assert remembered(loose, Q).dtype == np.float32
    assert 0.009 < error.std() < 0.011
    assert 0 < np.abs(slip(loose, 6)).max() < 0.1
    np.testing.assert_array_equal(slip(loose, 6), slip(loose, 6))


def test_an_arm_whose_joints_slipped_goes_astray_by_as_much(cube_world):
    experiment = dataclasses.replace(cube_world.experiment, joints=Joints(offset=0.02))
    world = DynamicWorld(experiment, cube_world.skin, cube_world.fields)
    q = np.tile([0.5, -0.5, 0.3, 0.2, 0.4, -0.3], (11, 1))
    done = world.execute(0.01 * np.arange(11), q, np.zeros_like(q))
    np.testing.assert_allclose(
        q - done.q_measured, np.tile(slip(experiment, 6), (11, 1)), atol=1e-4
    )
