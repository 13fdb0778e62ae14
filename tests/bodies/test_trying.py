"""`selftouch body` tries a body, and says what is wrong in words."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from commands import refused, selftouch
from toys import Flat

from selftouch_drake.agent.body import Felt
from selftouch_drake.bodies.checked import CheckedBody
from selftouch_drake.bodies.trying import try_body

TOYS = Path(__file__).with_name("toys.py")


def problems(body):
    return [line for line in try_body(CheckedBody(body)) if line.startswith("problem: ")]


def test_a_body_is_described(tmp_path):
    done = selftouch("body", f"{TOYS}:Flat")
    assert done.status == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[:4] == [
        "Flat: 3 joints, 16 receptors",
        "  x: 0 to 1, at most 1/s and 4/s²",
        "  y: 0 to 1, at most 1/s and 4/s²",
        "  press: -1 to 0.5, at most 1/s and 4/s²",
    ]
    assert lines[4].endswith("postures per second; it jumps to them, and reached 100%")
    assert lines[5].startswith("at rest receptors read 0 to 0; visits of one posture differ by up")
    assert lines[6].endswith("of 500 postures, of 16 of 16 receptors")
    assert len(lines) == 7


def test_an_experiment_names_the_body(tmp_path):
    file = tmp_path / "mine.yaml"
    python = f"{{file: {TOYS}, class: Flat, arguments: {{jumps: false}}}}"
    file.write_text(f"python: {python}")
    done = selftouch("body", file, "--postures", 8)
    assert done.status == 0, done.stderr
    assert "s of the robot each; it travels to them" in done.stdout
    assert "of 8 postures" in done.stdout


@pytest.mark.parametrize(
    ("argument", "line"),
    [
        (f"{TOYS}:Falt", f"{TOYS} has no class 'Falt'; did you mean Flat?"),
        ("nowhere.py:Mine", "'nowhere.py' does not exist; give the path of a Python file"),
        ("cube", "cube has a robot that Drake simulates: check it with `selftouch robot cube`"),
    ],
)
def test_what_is_no_body_is_one_line(argument, line):
    assert refused("body", argument) == line


class Random(Flat):
    def feel(self, q):
        felt = super().feel(q)
        self.rng = getattr(self, "rng", np.random.default_rng(0))
        return Felt(
            q=q, sensation=self.rng.uniform(0, 9, felt.sensation.shape), reached=felt.reached
        )


class Stuck(Flat):
    def feel(self, q):
        felt = super().feel(q)
        still = q * [1, 0, 1] + [0, 0.5, 0]
        return Felt(q=still, sensation=self.touch(still), reached=felt.reached)


class Far(Flat):
    def feel(self, q):
        felt = super().feel(q)
        return Felt(q=q, sensation=0 * felt.sensation + 3, reached=q[:, 0] > 0.7)


@pytest.mark.parametrize(
    ("kind", "found"),
    [
        (Flat, []),
        (Random, ["the same posture feels as different each time as others do; "]),
        (Stuck, ["y does not move; leave it out, or look what holds it"]),
        (Far, ["66% of the postures are not reached", "no posture touches anything; look whether"]),
    ],
)
def test_what_is_wrong_is_said_in_words(kind, found):
    lines = problems(kind())
    assert len(lines) == len(found), lines
    for line, start in zip(lines, found, strict=True):
        assert line.startswith(f"problem: {start}")


@pytest.mark.parametrize("control", ["position", "torque"])
def test_a_foreign_arm_under_dynamics_is_a_body(control, tmp_path):
    for module in ("mujoco", "gymnasium"):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed")
    file = tmp_path / "arm.yaml"
    arm = Path(__file__).with_name("mujoco_body.py")
    python = f"{{file: {arm}, class: Dynamic, arguments: {{control: {control}}}}}"
    file.write_text(f"python: {python}")
    done = selftouch("body", file, "--postures", 5)
    assert done.status == 0, done.stderr
    assert "Dynamic: 12 joints, 160 receptors" in done.stdout
