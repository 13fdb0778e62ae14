import socket
import struct
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from laid_out import motion_of

from selftouch_drake.bodies.drake import DrakeBodies
from selftouch_drake.bodies.embodiment import pilot_in
from selftouch_drake.run.artifacts import load_agent
from selftouch_drake.run.directory import RunDirectory, RunError
from selftouch_drake.show.meshcat.live import BRAKING_S, SPEED, TARGET, LiveShow, braked
from selftouch_drake.show.meshcat.stage import open_meshcat
from selftouch_drake.show.outputs import play
from selftouch_drake.show.run_data import RunData


@cache
def data_of(path) -> RunData:
    return RunData(RunDirectory.open(path))


def live(run, plan_feeling=None):
    """A live agent at full speed, and the lines that it prints."""
    data, said = data_of(run.path), []
    if plan_feeling is None:
        pilot = pilot_in(DrakeBodies(data.world), load_agent(run), run.experiment)
    else:
        pilot = SimpleNamespace(plan_feeling=plan_feeling)
    show = LiveShow(open_meshcat(), data, pilot, said.append)
    show.simulation.set_rate(0.0)
    show.said = said
    return show


@pytest.fixture
def show(reported):
    return live(reported)


def step_until(show, condition, *, most=3000):
    for _ in range(most):
        if condition():
            return
        show.step()
    pytest.fail(f"not after {most} frames; said {show.said}")


def going_to(target: int, line: str) -> bool:
    """Whether a line announces a motion; it may lift off, because these postures do not touch."""
    return line.removesuffix(", through the air") == f"to sensation {target}"


def test_it_begins_with_a_tour_and_the_slider_ends_it(show):
    meshcat = show._meshcat
    step_until(show, lambda: show.moving)
    assert meshcat.GetSliderValue(TARGET) == show.goal
    assert meshcat.HasPath("/skins/body/plan/path_0")

    meshcat.SetSliderValue(TARGET, 40)
    step_until(show, lambda: any(going_to(40, line) for line in show.said))
    q_before = show.simulation.q_commanded
    step_until(show, lambda: not show.moving)
    assert np.abs(show.simulation.q_commanded - q_before).max() > 0.01
    assert any(line.startswith("sensation 40: ") for line in show.said)

    for _ in range(60):
        show.step()
    assert not show.moving, "the tour is over"


def test_another_target_interrupts_a_motion(show):
    step_until(show, lambda: show.moving)
    first = show.goal
    for _ in range(10):
        show.step()
    other = (first + 25) % 60
    show._meshcat.SetSliderValue(TARGET, other)
    commanded = []

    def going_there():
        commanded.append(show.simulation.q_commanded)
        return going_to(other, show.said[-1])

    step_until(show, going_there)
    assert show.goal == other
    assert not any(line.startswith(f"sensation {first}:") for line in show.said)
    steps = np.abs(np.diff(commanded, axis=0)).max(axis=1)
    assert steps.max() < 1.2 / 30, "it jumps nowhere: no joint is faster than it may be"
    assert steps[-1] < 0.3 * steps.max(), "it has slowed down"


def test_several_targets_while_it_slows_down_are_one(show):
    step_until(show, lambda: show.moving)
    for _ in range(10):
        show.step()
    for wanted in (11, 12, 13):
        show._meshcat.SetSliderValue(TARGET, wanted)
        show.step()
    step_until(show, lambda: going_to(13, show.said[-1]))
    assert not any(going_to(n, line) for n in (11, 12) for line in show.said)


def test_a_braked_motion_stays_on_its_path_and_stands_still():
    motion = motion_of("ball")
    time_s, q, v = braked(motion, 0.5)
    speed = np.abs(motion.v[50]).max()
    assert time_s[[0, -1]] == pytest.approx([0.0, BRAKING_S])
    assert q[0] == pytest.approx(motion.q[50])
    assert np.abs(v[0]).max() == pytest.approx(speed)
    assert v[-1] == pytest.approx(np.zeros(6))
    # This path is straight.
    along = (q - motion.q[0]) @ (motion.q[-1] - motion.q[0])
    across = (q - motion.q[0]) - np.outer(along, motion.q[-1] - motion.q[0]) / np.sum(
        np.square(motion.q[-1] - motion.q[0])
    )
    assert np.abs(across).max() < 1e-9
    assert (np.diff(along) >= 0).all()
    # Near its end it does not go beyond.
    _, q, _ = braked(motion, 1.15)
    assert q[-1] == pytest.approx(motion.q[-1])


def test_an_impossible_plan_is_reported(reported):
    def refuse(*args):
        raise ValueError("target 7 cannot be reached from target 0")

    show = live(reported, refuse)
    show._meshcat.SetSliderValue(TARGET, 7)
    show.step()
    assert not show.moving
    assert show.said[-1] == "target 7 cannot be reached from target 0"


def test_skins_move_with_the_robot_and_the_air_is_announced(two_skins):
    motion = motion_of("two_skins")
    show = live(two_skins, lambda *query: SimpleNamespace(motion=motion))
    show.simulation.rest_at(motion.q[0])
    show._meshcat.SetSliderValue(TARGET, motion.plan.goal)
    show.step()
    assert show.said[-1] == f"to sensation {motion.plan.goal}, through the air"
    before = transform_of(show, "/skins/forearm")
    step_until(show, lambda: not show.moving)
    after = transform_of(show, "/skins/forearm")
    assert np.abs(after - before).max() > 0.1
    assert transform_of(show, "/expected/forearm") == pytest.approx(after)
    last = show.said[-1]
    assert "where touch was expected" in last
    contact = int(last.split("in contact ")[1].split("%")[0])
    assert contact >= 90, "time in the air does not count"


def transform_of(show, path) -> np.ndarray:
    """`(16,)` the matrix as sent to the browser: sixteen doubles in MessagePack."""
    packed = show._meshcat._GetPackedTransform(path)[-144:]
    return np.array([struct.unpack(">d", packed[k + 1 : k + 9])[0] for k in range(0, 144, 9)])


def test_speed_is_how_much_of_the_world_a_frame_is(show):
    show._meshcat.SetSliderValue(SPEED, 4.0)
    before = show.simulation.time_s
    show.step()
    assert show.simulation.time_s - before == pytest.approx(4 / 30)


def test_a_taken_port_is_a_users_mistake(reported):
    with socket.socket() as taken:
        taken.bind(("localhost", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ValueError, match=f"--port {port} is in use; give another"):
            play(reported, port=port)


def test_a_run_that_has_not_learned_says_so(make_run):
    with pytest.raises(RunError, match="has learned nothing yet; run `selftouch learn"):
        play(make_run("babbled"))


def test_it_lives_without_the_truth(make_run):
    run = make_run("learned")
    for path in run.truth.iterdir():
        path.unlink()
    show = live(run)
    show.step()
    assert show._meshcat.HasPath("/recovered/kernels"), "the agent's own layout"
    assert not show._meshcat.HasPath("/recovered/part_0")
