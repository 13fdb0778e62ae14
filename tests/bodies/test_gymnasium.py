"""A Gymnasium environment as a body: what its actions do is found out, and postures are reached."""

import numpy as np
import pytest
import yaml

gymnasium = pytest.importorskip("gymnasium", reason="pip install gymnasium")

from pathlib import Path  # noqa: E402

from scipy.optimize import linear_sum_assignment  # noqa: E402
from toys import Flat  # noqa: E402
from worlds import COUPLED, HIGH, LOW, SINGLE, Sliders  # noqa: E402

from selftouch_drake.agent.body import Body, BodyError  # noqa: E402
from selftouch_drake.bodies.checked import CheckedBody  # noqa: E402
from selftouch_drake.bodies.gymnasium import GymnasiumBody  # noqa: E402
from selftouch_drake.bodies.own import open_body  # noqa: E402
from selftouch_drake.experiment import load_experiment  # noqa: E402
from selftouch_drake.run.fingerprint import model_digests  # noqa: E402

POSTURES = np.array([[0.5, 0.5, 0.3], [0.1, 0.8, 0.2], [-0.2, 0.3, -0.4]])
KINDS = ("position", "velocity", "torque")


def body_of(kind="position", given=None, **fields):
    return GymnasiumBody(Sliders(kind, **fields), joints="joints", touch="touch", **given or {})


@pytest.mark.parametrize("effect", [SINGLE, COUPLED], ids=["single", "coupled"])
@pytest.mark.parametrize("kind", KINDS)
def test_what_actions_do_is_found_out(kind, effect):
    body = body_of(kind, effect=effect)
    assert isinstance(body, Body)
    assert body.actions.kind == kind
    unit = {"position": 1.0, "velocity": 1.0, "torque": 10.0}[kind]
    assert body.actions.effect == pytest.approx(unit * effect, rel=0.15, abs=1e-6)
    assert np.abs(body.actions.needed[1]).max() < 1e-12
    assert body.lower.tolist() == LOW.tolist()


@pytest.mark.parametrize("effect", [SINGLE, COUPLED], ids=["single", "coupled"])
@pytest.mark.parametrize("kind", KINDS)
def test_postures_are_reached_and_felt(kind, effect):
    body = CheckedBody(body_of(kind, effect=effect))
    felt = body.feel(POSTURES)
    assert felt.reached.all()
    assert felt.q == pytest.approx(POSTURES, abs=0.012 * 1.5)
    assert felt.sensation == pytest.approx(Flat().touch(felt.q))
    assert felt.sensation.any(axis=1).tolist() == [True, True, False]
    assert not body.jumps
    assert body.robot_s > 3


@pytest.mark.parametrize("effect", [SINGLE, COUPLED], ids=["single", "coupled"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_motion_is_followed(kind, effect):
    body = body_of(kind, effect=effect)
    s = np.linspace(0, 1, 101)
    share = (s**3 * (10 - 15 * s + 6 * s**2))[:, None]
    path = (1 - share) * POSTURES[0] + share * POSTURES[1]
    followed = body.follow(4 * s, path)
    assert followed.time_s == pytest.approx(np.arange(201) * 0.02)
    wanted = np.stack([np.interp(followed.time_s, 4 * s, column) for column in path.T], axis=1)
    assert np.abs(followed.q - wanted).max() < 0.02
    assert followed.sensation == pytest.approx(Flat().touch(followed.q))


def test_what_is_in_the_way_is_not_reached():
    body = body_of("torque", {"lower": [-2.0, 0.0, -1.0], "upper": [2.0, 1.0, 0.5]})
    felt = body.feel(np.array([[1.8, 0.5, 0.0], [0.5, 0.5, 0.0]]))
    assert felt.reached.tolist() == [False, True]
    assert felt.q[0, 0] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("joints", "touch"), [("0:3", "3:19"), ([0, 1, 2], range(3, 19)), (":3", "-16:")]
)
def test_numbers_of_one_array_are_joints_and_touch(joints, touch):
    body = GymnasiumBody(Sliders(flat=True), joints=joints, touch=touch)
    assert body.num_receptors == 16
    assert body.upper.tolist() == HIGH.tolist()
    assert body.feel(POSTURES[:1]).reached.all()


def test_part_of_an_entry():
    body = GymnasiumBody(Sliders(), joints="joints[1:3]", touch="touch[4:]")
    assert body.upper.tolist() == HIGH[1:].tolist()
    assert body.actions.effect == pytest.approx(SINGLE[1:], rel=0.05, abs=1e-6)
    assert body.num_receptors == 12


def test_limits_are_those_that_actions_can_reach_if_the_observation_has_none():
    body = body_of(limited=False)
    # The first sags under gravity, and -6 to 6 is as far as actions reach.
    assert body.lower == pytest.approx([-6, -4.5, -1.5], rel=0.05)
    with pytest.raises(BodyError, match=r"^lower is \[-inf, .* give `lower`, 3 numbers$"):
        body_of("torque", limited=False)


def test_what_is_known_need_not_be_found_out():
    given = {
        "joint_names": ["x", "y", "press"],
        "lower": [0.0, 0.0, -1.0],
        "upper": [0.9, 0.9, 0.5],
        "velocity": [0.3, 0.3, 0.3],
        "acceleration": [3.0, 3.0, 3.0],
        "action": "torque",
        "step_s": 0.04,
    }
    body = body_of("velocity", given)
    assert body.joint_names == ["x", "y", "press"]
    for name in ("lower", "upper", "velocity", "acceleration"):
        assert getattr(body, name).tolist() == given[name]
    assert body.actions.kind == "torque"
    assert body.actions.step_s == 0.04


def test_the_end_of_an_episode_is_survived():
    body = body_of(given={"velocity": [2.0, 2.0, 2.0]}, length=150)
    felt = body.feel(np.tile(POSTURES, (3, 1)))
    assert felt.reached.all()
    followed = body.follow(np.array([0.0, 0.5]), POSTURES[[0, 0]])
    assert followed.q[-1] == pytest.approx(POSTURES[0], abs=0.02)
    with pytest.raises(
        BodyError, match=r"the episode ended in each of 3 tries of a motion of 9\.0 s"
    ):
        body.follow(np.array([0.0, 9.0]), POSTURES[[0, 0]])


@pytest.mark.parametrize("given", [{"set_posture": "set_posture"}, {"reset_option": "posture"}])
def test_an_environment_that_can_be_put_into_a_posture_jumps(given):
    body = CheckedBody(body_of(given=given | {"action": "none"}))
    assert body.jumps
    felt = body.feel(POSTURES)
    assert felt.q.tolist() == POSTURES.tolist()
    assert body.follow(np.arange(3.0), POSTURES).q.tolist() == POSTURES.tolist()
    assert body.robot_s == 0
    if "set_posture" in given:
        assert body.feel(np.array([[0.95, 0.5, 0.0]])).reached.tolist() == [False]


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (
            lambda: GymnasiumBody(Sliders(), joints="joint", touch="touch"),
            "the observation has no 'joint'; did you mean joints?",
        ),
        (
            lambda: GymnasiumBody(Sliders(flat=True), joints="0:3", touch="touch"),
            "the observation has no 'touch'; it has no named entries",
        ),
        (
            lambda: GymnasiumBody(Sliders(flat=True), joints=[0, 30], touch="3:"),
            "[0, 30] numbers more than the 19 entries of the observation",
        ),
        (
            lambda: GymnasiumBody(Sliders(), joints=[0, 1], touch="touch"),
            "[0, 1] numbers an observation that has entries joints, touch; give the key of one, as "
            "in 'qpos[7:19]'",
        ),
        (
            lambda: body_of(effect=0 * SINGLE, kind="torque"),
            "no action moves a joint: 4 were tried; name others as `joints`, or say what an action "
            "sets",
        ),
        (
            lambda: GymnasiumBody(Sliders(), joints="touch", touch="joints"),
            "no action moves joint_",
        ),
        (
            lambda: body_of("velocity", effect=COUPLED[[0, 0, 2]]),
            "4 actions move joint_0, joint_1, joint_2 in 2 ways only; leave out of `joints` those "
            "that move with others",
        ),
        (
            lambda: body_of(action_space=gymnasium.spaces.MultiDiscrete([3, 3])),
            "the action space is MultiDiscrete([3 3]); only Box(n,) can be used",
        ),
        (
            lambda: body_of(length=50),
            "the episode ends after 0.98 s without actions; make the environment with longer",
        ),
        (
            lambda: body_of(given={"action": "none"}),
            "action is none; then give set_posture or reset_option",
        ),
        (
            lambda: body_of(given={"set_posture": "put"}),
            "set_posture is 'put'; the environment has no such one",
        ),
    ],
)
def test_an_environment_that_makes_no_body_says_why(make, line):
    with pytest.raises(BodyError) as error:
        make()
    assert str(error.value).startswith(line)


def experiment(folder, **fields):
    for name in ("toys.py", "worlds.py"):
        (folder / name).write_bytes(Path(__file__).with_name(name).read_bytes())
    settings = {"env": "worlds.py:Sliders", "joints": "joints", "touch": "touch"} | fields
    (folder / "mine.yaml").write_text(yaml.safe_dump({"gymnasium": settings}))
    return load_experiment(folder / "mine.yaml")


def test_an_experiment_names_an_environment_in_a_file(tmp_path):
    found = experiment(tmp_path, arguments={"kind": "velocity"}, upper=[0.9, 1, 0.5])
    with open_body(found) as body:
        assert body.upper.tolist() == [0.9, 1, 0.5]
        assert body.feel(POSTURES[:1]).reached.all()
    assert list(model_digests(found)) == [str(tmp_path / "worlds.py")]


def test_a_registered_environment_has_no_end(tmp_path):
    gymnasium.register("Sliders-v0", lambda **given: Sliders(**given), max_episode_steps=20)
    with open_body(experiment(tmp_path, env="Sliders-v0", arguments={"length": None})) as body:
        assert body.feel(POSTURES[:1]).reached.all()


@pytest.mark.parametrize(
    ("fields", "line"),
    [
        ({"env": "Nowhere-v0"}, "gymnasium.env is 'Nowhere-v0': Environment `Nowhere` doesn't"),
        ({"env": "worlds.py:Slider"}, "has no class 'Slider'; did you mean Sliders?"),
        ({"arguments": {"kid": 3}}, "arguments of Sliders are {'kid': 3}: got an unexpected"),
        ({"touch": "touch[:2]"}, "num_receptors is 2; give a whole number, at least 4"),
    ],
)
def test_mistakes_in_an_experiment_are_one_line(tmp_path, fields, line):
    with pytest.raises(BodyError) as error:
        open_body(experiment(tmp_path, **fields))
    assert line in str(error.value)


@pytest.mark.parametrize("control", ["position", "torque"])
def test_a_foreign_arm_walks_under_dynamics_and_does_not_get_stuck(control):
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    from mujoco_body import START, Dynamic

    body = Dynamic(control)
    assert body.actions.kind == control
    of_joint, _ = linear_sum_assignment(np.log(np.abs(body.actions.effect).clip(1e-300)).T, True)
    assert of_joint.tolist() == list(range(12))
    rng, span, q, step = np.random.default_rng(0), body.upper - body.lower, START, np.zeros(12)
    reached, touched = [], np.zeros(160, dtype=bool)
    for _ in range(150):
        step = 0.8 * step + 0.04 * span * rng.normal(size=12)
        step = np.where((q + step < body.lower) | (q + step > body.upper), -step, step)
        felt = body.feel((q + step).clip(body.lower, body.upper)[None])
        q = felt.q[0]
        reached.append(felt.reached[0])
        touched |= felt.sensation[0] > 0
    assert np.mean(reached) > 0.8
    assert np.mean(reached[100:]) > 0.7
    assert touched.sum() > 10
