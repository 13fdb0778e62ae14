"""The page of a life: simulated where the robot babbles under dynamics, else stored touches."""

from types import SimpleNamespace

import numpy as np
import pytest
from laid_out import execution_of, fields_of

from selftouch_drake.experiment import experiment_from_fields
from selftouch_drake.robot import World
from selftouch_drake.show.meshcat.pages import BabblingRobot, LifePage
from selftouch_drake.show.meshcat.stage import FeelingRobot, open_meshcat

LIFE = SimpleNamespace(
    num_touches=1234, has_doubts=False, noticed=[], learner=SimpleNamespace(knows=False)
)


def entered(mode: str) -> LifePage:
    fields = fields_of("two_skins", "two_skins")
    fields["babbling"] = fields["babbling"] | {"mode": mode}
    fields["joints"] = {"offset": 0.05}
    page = LifePage(open_meshcat())
    page.enter(World(experiment_from_fields(fields)))
    return page


@pytest.mark.parametrize(
    ("mode", "kind"), [("kinematic", FeelingRobot), ("dynamic", BabblingRobot)]
)
def test_who_babbles_under_dynamics_is_simulated(mode, kind):
    page, done = entered(mode), execution_of("two_skins")
    assert type(page.robot) is kind
    page.lived(done.q_measured[:4], done.felt[:4], LIFE)
    assert page.robot.status == "1,234 touches: it is beginning"
    assert page._meshcat.HasPath("/skins/forearm")
    assert page._meshcat.HasPath("/drake")


def test_what_is_shown_is_what_the_simulation_feels():
    page, done = entered("dynamic"), execution_of("two_skins")
    row = int(np.argmax(np.linalg.norm(done.felt, axis=1)))
    page.robot.show(done.q_measured[row], np.zeros_like(done.felt[row]))
    simulation = page.robot.simulation
    assert simulation.felt.any()
    # While it babbles no joint has slipped.
    np.testing.assert_array_equal(simulation.slip, np.zeros(len(simulation.q)))
    np.testing.assert_allclose(simulation.q, done.q_measured[row], atol=0.02)
    assert simulation.time_s > 0.0
