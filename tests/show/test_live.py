import socket

import numpy as np
import pytest

from selftouch_drake.run.directory import RunError
from selftouch_drake.run.motions import load_representation
from selftouch_drake.show import play
from selftouch_drake.show.live import SPEED, TARGET, LiveShow
from selftouch_drake.show.server import open_meshcat


@pytest.fixture
def show(reported):
    told = []
    live = LiveShow(open_meshcat(), reported, told.append)
    live.arm.set_rate(0.0)  # as fast as it can
    live.told = told
    return live


def step_until(show, condition, *, most=3000):
    for _ in range(most):
        if condition():
            return
        show.step()
    pytest.fail(f"not after {most} frames; told {show.told}")


def test_it_begins_with_a_tour_and_a_slider_ends_it(show):
    meshcat = show._meshcat
    step_until(show, lambda: show.moving)
    first_stop = show.goal
    assert meshcat.GetSliderValue(TARGET) == first_stop
    assert meshcat.HasPath("/plan/path_0")

    meshcat.SetSliderValue(TARGET, 40)
    show.step()
    assert show.goal == first_stop, "a motion that has begun is brought to its end"
    step_until(show, lambda: show.goal == 40)
    q_before = show.arm.q_commanded
    step_until(show, lambda: not show.moving)
    assert np.abs(show.arm.q_commanded - q_before).max() > 0.01
    assert any(line.startswith("sensation 40: ") for line in show.told)

    for _ in range(60):
        show.step()
    assert not show.moving, "the tour is over"


def test_what_cannot_be_planned_is_told(show, monkeypatch):
    def refuse(*args):
        raise ValueError("target 7 cannot be reached from target 0")

    monkeypatch.setattr(show._pilot, "motion_from", refuse)
    show._meshcat.SetSliderValue(TARGET, 7)
    show.step()
    assert not show.moving
    assert show.told[-1] == "target 7 cannot be reached from target 0"


def test_speed_is_how_much_of_the_world_a_frame_is(show):
    show._meshcat.SetSliderValue(SPEED, 4.0)
    before = show.arm.time_s
    show.step()
    assert show.arm.time_s - before == pytest.approx(4 / 30)


def test_a_taken_port_is_a_users_mistake(reported):
    with socket.socket() as taken:
        taken.bind(("localhost", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ValueError, match=f"--port {port} is taken; choose another"):
            play(reported, port=port)


def test_a_run_that_has_not_learned_says_so(make_run):
    with pytest.raises(RunError, match="has learned nothing yet; run `selftouch learn"):
        play(make_run("babbled"))


def test_it_lives_without_the_truth(make_run):
    run = make_run("learned")
    for path in run.truth.iterdir():
        path.unlink()
    live = LiveShow(open_meshcat(), run)
    live.step()
    assert not live._meshcat.HasPath("/mind")
    assert load_representation(run).num_targets > live.goal
