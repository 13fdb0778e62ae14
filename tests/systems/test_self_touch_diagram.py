"""The whole simulation in one diagram: who commands, servo, station, and what is shown of it."""

import dataclasses

import numpy as np
import pytest
import robots
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import PortDataType
from pydrake.systems.primitives import ConstantVectorSource

from selftouch_drake.experiment.schema import JointSettings
from selftouch_drake.robot.imperfections import remembered, slip
from selftouch_drake.show.meshcat.stage import drawn_page
from selftouch_drake.systems import Babbler, MakeSelfTouchDiagram, PlanSource
from selftouch_drake.systems.simulation import Simulation

OUTPUTS = ["q", "sensation", "state", "torque", "contact_results", "body_poses"]


def changed(experiment, **settings):
    """An experiment with settings of its joints or its execution."""
    return dataclasses.replace(
        experiment,
        **{
            room: dataclasses.replace(getattr(experiment, room), **fields)
            for room, fields in settings.items()
        },
    )


@pytest.fixture(scope="module")
def babbling(two_arms):
    return MakeSelfTouchDiagram(
        two_arms.experiment, Babbler(two_arms.experiment), skins=two_arms.skins
    )


def test_its_ports(babbling, two_arms):
    ports = [babbling.get_output_port(i) for i in range(babbling.num_output_ports())]
    assert [port.get_name() for port in ports] == OUTPUTS
    sizes = [p.size() for p in ports if p.get_data_type() == PortDataType.kVectorValued]
    num_joints = two_arms.robot.num_joints
    assert sizes == [num_joints, two_arms.experiment.num_receptors, 2 * num_joints, num_joints]
    assert babbling.num_input_ports() == 0


def test_what_it_feels_is_what_the_probe_feels_in_the_same_posture(babbling, two_arms):
    simulator = Simulator(babbling)
    context, felt = simulator.get_context(), []
    for time in np.arange(0.1, 16.0, 0.1):
        simulator.AdvanceTo(time)
        q = babbling.GetOutputPort("q").Eval(context)
        sensation = babbling.GetOutputPort("sensation").Eval(context)
        expected = two_arms.probe.sensations(q[None])[0]
        np.testing.assert_allclose(sensation, expected, rtol=0, atol=1e-9)
        felt.append(sensation.any())
    assert 3 < sum(felt) < 140


def test_the_plant_starts_where_the_walk_does(world):
    babbler = Babbler(world.experiment)
    diagram = MakeSelfTouchDiagram(world.experiment, babbler, skins=world.skins)
    context = diagram.CreateDefaultContext()
    first = babbler.nodes(1)[0]
    np.testing.assert_array_equal(diagram.GetOutputPort("q").Eval(context), first)
    simulator = Simulator(diagram, context)
    simulator.AdvanceTo(0.5)
    commanded = babbler.GetOutputPort("q").Eval(babbler.GetMyContextFromRoot(context))
    assert np.abs(diagram.GetOutputPort("q").Eval(context) - commanded).max() < 0.3


def test_a_context_set_back_babbles_the_same_again(babbling):
    def babble(context):
        simulator = Simulator(babbling, context)
        simulator.Initialize()
        simulator.AdvanceTo(2.0)
        return babbling.GetOutputPort("state").Eval(context).copy()

    first = babble(babbling.CreateDefaultContext())
    np.testing.assert_array_equal(babble(babbling.CreateDefaultContext()), first)


def test_q_is_as_the_joints_read(cube_world):
    experiment = changed(cube_world.experiment, joints={"noise": 0.01, "offset": 0.02})
    offset = slip(experiment, 6)
    source = ConstantVectorSource(np.concatenate([np.full(6, 0.2), np.zeros(6)]))
    source.set_name("still")

    class Still(type(source)):
        def GetOutputPort(self, name):
            return self.get_output_port()

    commander = Still(np.concatenate([np.full(6, 0.2), np.zeros(6)]))
    diagram = MakeSelfTouchDiagram(experiment, commander, skins=cube_world.skins)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.5)
    context = simulator.get_context()
    true = diagram.GetOutputPort("state").Eval(context)[:6]
    # The joints are led to where they read 0.2.
    np.testing.assert_allclose(true, 0.2 - offset, atol=1e-3)
    read = diagram.GetOutputPort("q").Eval(context)
    np.testing.assert_array_equal(read, remembered(experiment, (true + offset)[None])[0])
    assert np.abs(read - true - offset).max() > 1e-3


def test_while_it_babbles_no_joint_has_slipped(cube_world):
    experiment = dataclasses.replace(cube_world.experiment, joints=JointSettings(offset=0.02))
    babbler = Babbler(experiment)
    diagram = MakeSelfTouchDiagram(experiment, babbler, skins=cube_world.skins)
    context = diagram.CreateDefaultContext()
    state = diagram.GetOutputPort("state").Eval(context)
    np.testing.assert_array_equal(state[:6], babbler.nodes(1)[0])


def test_a_touch_servo_is_there_if_the_experiment_says_so_and_may_be_left_alone(cube_world):
    ends = []
    for servo in (False, True):
        experiment = changed(cube_world.experiment, execution={"touch_servo": servo})
        babbler = Babbler(experiment)
        diagram = MakeSelfTouchDiagram(experiment, babbler, skins=cube_world.skins)
        assert diagram.HasSubsystemNamed("touch_servo") == servo
        simulator = Simulator(diagram)
        simulator.AdvanceTo(1.0)
        ends.append(diagram.GetOutputPort("q").Eval(simulator.get_context()).copy())
    np.testing.assert_allclose(*ends, atol=1e-12)


def test_a_commander_of_another_robot_is_refused(cube_world):
    with pytest.raises(ValueError, match="desired_state has 4 numbers, and cube 6 joints: give 12"):
        MakeSelfTouchDiagram(
            cube_world.experiment, PlanSource(num_joints=2), skins=cube_world.skins
        )


def test_meshcat_shows_this_simulation(cube_world):
    with drawn_page() as meshcat:
        simulation = Simulation(cube_world.experiment, cube_world.skins, meshcat=meshcat)
        touching, felt = robots.touches(cube_world)
        row = int(felt.sum(axis=1).argmax())
        simulation.rest_at(touching[row].astype(float))
        simulation.advance(0.1)
        assert simulation.felt.any()
        strongest = int(simulation.felt.argmax())
        path = f"/skins/body/receptors/{strongest}"
        assert meshcat.HasPath(path)
        assert meshcat.HasPath("/touching/0")
        shown = simulation.visualizer.last_sensation
        np.testing.assert_allclose(shown, simulation.felt, atol=0.2 * simulation.felt.max())
    assert not meshcat.HasPath("/skins")
