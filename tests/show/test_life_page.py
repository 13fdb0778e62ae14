"""The page of a life: simulated where the robot babbles under dynamics, else stored touches."""

from types import SimpleNamespace

import numpy as np
import pytest
from laid_out import execution_of, fields_of

from selftouch_drake.agent.body_model.model import rejected
from selftouch_drake.evaluation.body_model import angles_between, found_axes, true_axes
from selftouch_drake.experiment import experiment_from_fields
from selftouch_drake.robot import World
from selftouch_drake.run.artifacts import load_body_model, load_representation
from selftouch_drake.show.meshcat.growing_skeleton import onto_home, unsure_models
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


def test_a_skeleton_is_laid_on_its_robot_and_drawn_with_pale_ones(two_skins):
    page, known = entered("kinematic"), load_representation(two_skins)
    model, done = load_body_model(two_skins), execution_of("two_skins")
    touching = done.felt.any(axis=1)
    q = done.q_measured[touching].astype(float)
    target = np.argmax(done.felt[touching] @ known.target_sensations.T, axis=1)
    page.grew(model, q, target)
    for name in ("links", "axes", "unsure_links", "unsure_axes"):
        assert page._meshcat.HasPath(f"/skeleton/{name}"), name
    world, home = page._world, page.robot.home
    onto = onto_home(model, world, home, q, target)
    off = angles_between(
        found_axes(model, home).moved(onto), true_axes(world.robot.kinematics, home)
    )
    assert np.nanmax(off) < 2.0
    nothing = rejected(
        "too few",
        joint_names=model.joint_names,
        kernel_part=known.part,
        num_rows=len(q),
        num_receptors=len(model.receptor_part),
        seed=0,
    )
    page.grew(nothing, q, target)
    assert not page._meshcat.HasPath("/skeleton")


def test_pale_skeletons_scatter_as_the_standard_errors_say(two_skins):
    model = load_body_model(two_skins)
    drawn = np.array([one.twists for one in unsure_models(model, 400)])
    sigma = np.sqrt(np.diag(np.nan_to_num(model.covariance)))[: model.twists.size]
    np.testing.assert_allclose(drawn.std(axis=0).ravel(), sigma, atol=0.2 * sigma.max() + 1e-12)
