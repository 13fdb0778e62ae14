import numpy as np
import pytest
import robots
from pydrake.math import BsplineBasis
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.trajectories import BsplineTrajectory, PiecewisePolynomial

from selftouch_drake.experience import RandomWalk
from selftouch_drake.robot import Babbler, MakeKinematicStation, PathSource, Simulation

PERIOD = 0.1
START, END = np.array([1.0, -2.0]), np.array([0.5, 3.0])


def walk(robot, seed=4, step_size=0.15):
    lower, upper = robot.babbled_range
    return RandomWalk(
        lower=lower,
        upper=upper,
        step_size=step_size,
        persistence=0.9,
        seed=np.random.SeedSequence(seed),
    )


def moving_to_the_end():
    """From 2 s to 5 s, with non-zero velocity at both ends."""
    return PiecewisePolynomial.FirstOrderHold([2.0, 5.0], np.stack([START, END], axis=1))


def command(source, context, time):
    context.SetTime(time)
    return np.split(source.GetOutputPort("desired_state").Eval(context), 2)


@pytest.mark.parametrize(
    ("time", "q", "v"),
    [
        (1.0, START, np.zeros(2)),
        (2.0, START, (END - START) / 3),
        (3.5, (START + END) / 2, (END - START) / 3),
        (5.0, END, np.zeros(2)),
        (1e6, END, np.zeros(2)),
    ],
)
def test_a_path_is_followed_and_rested_at_both_ends(time, q, v):
    source = PathSource(2)
    context = source.CreateDefaultContext()
    source.SetPath(context, moving_to_the_end())
    commanded_q, commanded_v = command(source, context, time)
    np.testing.assert_allclose(commanded_q, q, atol=1e-12)
    np.testing.assert_allclose(commanded_v, v, atol=1e-12)


def test_any_trajectory_is_a_path_and_another_one_later():
    spline = BsplineTrajectory(BsplineBasis(4, 6), [np.full((2, 1), float(i)) for i in range(6)])
    source = PathSource(2)
    context = source.CreateDefaultContext()
    source.SetPath(context, spline)
    q, v = command(source, context, 0.4)
    np.testing.assert_allclose(q, spline.value(0.4).ravel(), atol=1e-12)
    np.testing.assert_allclose(v, spline.EvalDerivative(0.4, 1).ravel(), atol=1e-12)
    source.SetPath(context, moving_to_the_end())
    np.testing.assert_allclose(command(source, context, 9.0)[0], END, atol=1e-12)


def test_two_contexts_of_one_source_follow_two_paths():
    source = PathSource(2)
    one, other = source.CreateDefaultContext(), source.CreateDefaultContext()
    source.SetPath(one, moving_to_the_end())
    source.SetPath(other, PiecewisePolynomial(np.array([[7.0], [8.0]])))
    np.testing.assert_allclose(command(source, one, 5.0)[0], END)
    np.testing.assert_allclose(command(source, other, 5.0)[0], [7.0, 8.0])
    np.testing.assert_allclose(command(source, one, 2.0)[0], START)


def test_a_babbler_without_a_walk_asks_for_one():
    message = "^the Babbler has no walk; call SetWalk on its context first$"
    babbler = Babbler(num_joints=6, period_s=PERIOD)
    for port in ("q", "desired_state"):
        with pytest.raises(ValueError, match=message):
            babbler.GetOutputPort(port).Eval(babbler.CreateDefaultContext())
    with pytest.raises(ValueError, match=message):
        Simulator(babbler).AdvanceTo(1.0)


def babbling_station(world):
    """A diagram of a kinematic station that a babbler drives."""
    builder = DiagramBuilder()
    station = builder.AddSystem(MakeKinematicStation(world.experiment, world.skins).diagram)
    babbler = builder.AddSystem(Babbler(num_joints=world.robot.num_joints, period_s=PERIOD))
    builder.Connect(babbler.GetOutputPort("q"), station.GetInputPort("q"))
    return builder.Build(), babbler, station


@pytest.mark.parametrize("name", ["torus_two_fingers", "turning_body", "two_arms"])
def test_a_babbler_in_a_diagram_walks_and_feels_as_the_random_walk_does(name):
    world = robots.shipped(name)
    diagram, babbler, station = babbling_station(world)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    babbler.SetWalk(babbler.GetMyMutableContextFromRoot(context), walk(world.robot))
    q, sensation = [], []
    for step in range(400):
        simulator.AdvanceTo((step + 0.5) * PERIOD)
        q.append(babbler.GetOutputPort("q").Eval(babbler.GetMyContextFromRoot(context)))
        station_context = station.GetMyContextFromRoot(context)
        sensation.append(station.GetOutputPort("sensation").Eval(station_context))
    expected = walk(world.robot).steps(400)
    np.testing.assert_array_equal(q, expected)
    felt = world.probe.sensations(expected)
    assert felt.any(axis=1).sum() >= 5
    np.testing.assert_allclose(sensation, felt, rtol=0, atol=1e-12)


def test_two_contexts_of_one_diagram_walk_apart(cube_world):
    babbler = Babbler(num_joints=6, period_s=PERIOD)
    simulators = [Simulator(babbler) for _ in range(2)]
    seeds = (1, 2)
    for simulator, seed in zip(simulators, seeds, strict=True):
        babbler.SetWalk(simulator.get_mutable_context(), walk(cube_world.robot, seed))
    found = ([], [])
    for step in range(60):
        # In turn, and one of them twice as often.
        for number, simulator in enumerate(simulators):
            for part in range(1 + number):
                simulator.AdvanceTo((step + (part + 1) / (2 + number)) * PERIOD)
            found[number].append(babbler.GetOutputPort("q").Eval(simulator.get_context()))
    for q, seed in zip(found, seeds, strict=True):
        np.testing.assert_array_equal(q, walk(cube_world.robot, seed).steps(60))


def test_a_walk_that_was_given_is_not_walked(cube_world):
    given = walk(cube_world.robot)
    babbler = Babbler(num_joints=6, period_s=PERIOD)
    simulator = Simulator(babbler)
    babbler.SetWalk(simulator.get_mutable_context(), given)
    simulator.AdvanceTo(2.0)
    np.testing.assert_array_equal(given.steps(5), walk(cube_world.robot).steps(5))


def test_a_copy_of_a_context_goes_on_by_itself(cube_world):
    babbler = Babbler(num_joints=6, period_s=PERIOD)
    simulator = Simulator(babbler)
    babbler.SetWalk(simulator.get_mutable_context(), walk(cube_world.robot))
    simulator.AdvanceTo(1.05)
    copied = Simulator(babbler, simulator.get_context().Clone())
    copied.AdvanceTo(3.05)
    expected = walk(cube_world.robot).steps(31)
    q = babbler.GetOutputPort("q")
    np.testing.assert_array_equal(q.Eval(copied.get_context()), expected[30])
    np.testing.assert_array_equal(q.Eval(simulator.get_context()), expected[10])
    simulator.AdvanceTo(2.05)
    np.testing.assert_array_equal(q.Eval(simulator.get_context()), expected[20])


def test_joint_controllers_are_led_from_step_to_step_without_a_jump(cube_world):
    steps = walk(cube_world.robot).steps(6)
    babbler = Babbler(num_joints=6, period_s=PERIOD)
    simulator = Simulator(babbler)
    babbler.SetWalk(simulator.get_mutable_context(), walk(cube_world.robot))
    for time in (0.0, 0.03, 0.1, 0.17, 0.2, 0.45):
        simulator.AdvanceTo(time)
        q, v = np.split(babbler.GetOutputPort("desired_state").Eval(simulator.get_context()), 2)
        for expected, joint in zip(steps.T, q, strict=True):
            assert joint == pytest.approx(np.interp(time, PERIOD * np.arange(6), expected))
        # Right at a step the one before is still to be seen, by whoever moves at that instant.
        done = max(int(np.ceil(time / PERIOD - 1e-9)) - 1, 0)
        np.testing.assert_allclose(v, (steps[done + 1] - steps[done]) / PERIOD, atol=1e-9)


@pytest.mark.parametrize("name", ["cube", "gantry"])
def test_a_robot_that_follows_a_walk_does_not_jerk(name):
    world = robots.shipped(name)
    time_step = world.experiment.execution.time_step
    simulation = Simulation(world.experiment, world.skins, log_period=time_step, babbles=True)
    simulation.babble(walk(world.robot, seed=0, step_size=0.05))
    simulation.advance_to(2.0)
    log = simulation.take_log()
    late = log.time_s > 0.2 - time_step / 2
    into_the_instant = np.diff(log.v[late], axis=0)[:: round(PERIOD / time_step)]
    # The walk turns there only for the plant step after, by 0.2 rad/s (standard deviation).
    assert np.abs(into_the_instant).max() < 0.02
    assert np.abs(np.diff(log.v[late], axis=0)).max() > 0.05
