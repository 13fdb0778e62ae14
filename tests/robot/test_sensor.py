"""One sensor model: the probe, Drake's contact and the dynamic simulation feel the same."""

import numpy as np
import pytest
import robots

from selftouch_drake.systems import MakeDynamicStation
from selftouch_drake.systems.simulation import simulation_of

#: All shipped robots; the quick tests have one with several touchers and one that moves linearly.
QUICK_AND_SLOW = [
    name if name in ("torus_two_fingers", "gantry") else pytest.param(name, marks=pytest.mark.slow)
    for name in robots.SHIPPED
]


def swing_through(world, q, duration=0.3):
    """The log of a robot that swings past a configuration, at every step of the plant."""
    robot, simulation = world.robot, simulation_of(world)
    reach = np.where(robot.turns, 0.15, 0.02) * (-1.0) ** np.arange(robot.num_joints)
    time_s = np.linspace(0.0, duration, 31)
    phase = np.pi * time_s / duration
    path = np.clip(q - np.outer(np.cos(phase), reach), robot.lower, robot.upper)
    v = np.gradient(path, time_s, axis=0)
    simulation.rest_at(path[0])
    simulation.follow(time_s, path, v, jump=True)
    simulation.advance_to(duration)
    return simulation.take_log()


@pytest.mark.parametrize("world", QUICK_AND_SLOW, indirect=True)
def test_a_moving_simulation_feels_what_the_probe_feels_where_it_is(world):
    q, _ = robots.touches(world)
    for middle in q[:3].astype(float):
        log = swing_through(world, middle)
        expected = world.probe.sensations(log.q)
        assert expected.any(axis=1).sum() >= 5
        np.testing.assert_allclose(log.felt, expected, rtol=0, atol=1e-12)


def test_skins_move_in_that_comparison(turning_body, two_arms):
    for world, moving in ((turning_body, 0), (two_arms, 1)):
        q, _ = robots.touches(world)
        log = swing_through(world, q[0].astype(float))
        X_WL = world.robot.skin_positions(log.q)[:, moving]
        assert np.ptp(X_WL, axis=0).max() > 0.01


def test_every_skin_of_two_arms_is_felt(two_arms):
    _, felt = robots.touches(two_arms)
    for skin in range(3):
        assert felt[:, two_arms.receptor_skin == skin].any(axis=1).sum() >= 5


def test_drake_s_contact_is_felt_as_the_probe_feels(world):
    q, felt = robots.touches(world)
    rows = slice(0, 40)
    station = robots.drakes_postures(world)
    np.testing.assert_allclose(station.sensations(q[rows]), felt[rows], rtol=0, atol=1e-12)
    assert not station.sensations(_free(world)[None]).any()


def _free(world):
    q = robots.anywhere(world.robot, 100, seed=5)
    return q[~world.probe.sensations(q).any(axis=1)][0]


def test_contacts_of_drake_s_plant_are_felt_where_the_probe_says(two_arms):
    # Drake's own contact results, by the dynamic station's plant.
    station = MakeDynamicStation(two_arms.experiment, two_arms.skins)
    context = station.diagram.CreateDefaultContext()
    plant = station.robot.plant
    q, felt = robots.touches(two_arms)
    port = station.diagram.GetInputPort("desired_state")
    for row in range(20):
        state = np.concatenate([q[row], np.zeros_like(q[row])]).astype(float)
        port.FixValue(context, state)
        plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), state)
        results = station.diagram.GetOutputPort("contact_results").Eval(context)
        assert results.num_hydroelastic_contacts() >= 1
        sensation = station.diagram.GetOutputPort("sensation").Eval(context)
        np.testing.assert_allclose(sensation, felt[row], rtol=0, atol=1e-12)


def test_sensations_do_not_depend_on_what_was_asked_before(world):
    q, felt = robots.touches(world)
    alone = np.concatenate([world.probe.sensations(row[None]) for row in q[19::-1]])
    np.testing.assert_array_equal(alone[::-1], felt[:20])


def test_contacts_are_on_the_wall_that_they_press(world):
    q, felt = robots.touches(world)
    touches = world.probe.touches(q[:200])
    assert np.all(np.diff(touches.row) >= 0)
    np.testing.assert_array_equal(np.unique(touches.row), np.arange(min(200, len(q))))
    starts = np.cumsum([0, *(skin.fields.num_receptors for skin in world.skins)])
    for skin, model in enumerate(world.skins):
        here = touches.skin == skin
        columns = slice(starts[skin], starts[skin + 1])
        # A skin reads where it is pressed, and nowhere else.
        pressed = np.isin(np.arange(len(q[:200])), touches.row[here])
        np.testing.assert_array_equal(felt[:200, columns].any(axis=1), pressed)
        if here.any():
            points = model.wall.tet_vertices
            low, high = points.min(axis=0) - 1e-9, points.max(axis=0) + 1e-9
            assert ((touches.p_LC[here] >= low) & (touches.p_LC[here] <= high)).all()


def test_what_presses_is_near_where_it_presses(open_world):
    world = open_world
    q, _ = robots.touches(world)
    touches = world.probe.touches(q[:200])
    X_WL = world.robot.skin_positions(q[touches.row])[np.arange(len(touches.row)), touches.skin]
    p_WC = np.einsum("nij,nj->ni", X_WL[:, :, :3], touches.p_LC) + X_WL[:, :, 3]
    p_WT = world.robot.toucher_positions(q[touches.row])
    distance = np.linalg.norm(p_WT[np.arange(len(p_WC)), touches.toucher] - p_WC, axis=1)
    # All touchers of these robots are balls of 1 cm.
    assert distance.max() < 0.0101
