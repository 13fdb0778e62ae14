"""Toy bodies: a finger on sliding joints over a flat skin, and all that can be wrong with it."""

import time

import numpy as np

from selftouch_drake.agent.body import Felt, Followed

GRID = np.stack(np.meshgrid(*[np.linspace(0.1, 0.9, 4)] * 2), axis=-1).reshape(-1, 2)


class Flat:
    """Two joints move a finger over 16 receptors; the third joint presses."""

    joint_names = ("x", "y", "press")
    lower = np.array([0.0, 0.0, -1.0])
    upper = np.array([1.0, 1.0, 0.5])
    velocity = np.ones(3)
    acceleration = np.full(3, 4.0)
    num_receptors = len(GRID)
    jumps = True

    def __init__(self, jumps: bool = True):
        self.jumps = jumps
        self.calls = []

    def feel(self, q):
        self.calls.append(len(q))
        return Felt(q=q, sensation=self.touch(q), reached=np.ones(len(q), dtype=bool))

    def follow(self, time_s, q):
        return Followed(time_s=time_s, q=q, sensation=self.touch(q))

    def touch(self, q):
        away = np.linalg.norm(q[:, None, :2] - GRID, axis=-1)
        return np.maximum(0.0, 1 - away / 0.4) * q[:, 2:].clip(0.0)


def changed(**attributes):
    """A class of bodies with other attributes; None takes one away."""
    kept = {name: value for name, value in vars(Flat).items() if not name.startswith("__")}
    kept |= {"__init__": lambda self: None, **attributes}
    return type("Mine", (), {name: value for name, value in kept.items() if value is not None})


def feels(change):
    """A class of bodies whose `feel` is changed: `change` takes and returns the parts of a Felt."""

    def feel(self, q):
        parts = {"q": q, "sensation": self.touch(q), "reached": np.ones(len(q), dtype=bool)}
        return Felt(**parts | change(parts))

    return changed(feel=feel, jumps=False)


def follows(change):
    def follow(self, time_s, q):
        parts = {"time_s": time_s, "q": q, "sensation": self.touch(q)}
        return Followed(**parts | change(parts))

    return changed(follow=follow)


def shrinks():
    """Its sensation gets shorter after three postures."""
    left = iter([16, 16, 16])
    return feels(lambda felt: {"sensation": felt["sensation"][:, : next(left, 15)]})


def hangs(self, q):
    for _ in range(2000):
        time.sleep(0.01)


def disconnects(self, q):
    raise ConnectionError("no answer from /dev/ttyUSB0")


def nan_at(felt, name):
    values = felt[name].copy()
    values[0, 1] = np.nan
    return {name: values}


DESCRIBED = "as selftouch_drake.agent.body.Body describes it"

#: What is wrong with a body as it is made, and its line.
MADE = [
    (changed(feel=None), f"Mine has no method feel; write one, {DESCRIBED}"),
    (changed(follow=None), f"Mine has no method follow; write one, {DESCRIBED}"),
    (changed(lower=None), f"Mine: lower is missing; set it, {DESCRIBED}"),
    (changed(joint_names="xyz"), "Mine: joint_names is 'xyz'; give a list of different names"),
    (changed(joint_names=["x", "x", "z"]), "Mine: joint_names is ['x', 'x', 'z']; give a list of "
     "different names"),
    (changed(upper=[1.0, 1.0]), "Mine: upper is [1.0, 1.0]; give one number for each of 3 joints"),
    (changed(upper="much"), "Mine: upper is 'much'; give one number for each of 3 joints"),
    (changed(lower=[0.0, np.nan, 0.0]), "Mine: lower of y is nan; give a finite number"),
    (changed(upper=[1.0, np.inf, 1.0]), "Mine: upper of y is inf; give a finite number"),
    (changed(lower=[0.0, 0.0, 0.6]), "Mine: lower of press is 0.6, and upper 0.5; give the smaller "
     "one as lower"),
    (changed(velocity=[1.0, 0.0, 1.0]), "Mine: velocity of y is 0; give a number above 0"),
    (changed(num_receptors=2.5), "Mine: num_receptors is 2.5; give a whole number, at least 4"),
    (changed(num_receptors=0), "Mine: num_receptors is 0; give a whole number, at least 4"),
    (changed(jumps="no"), "Mine: jumps is 'no'; give True if any posture may be asked for next, or "
     "False if it must be travelled to"),
]  # fmt: skip

#: What is wrong with what it feels, and its line.
FELT = [
    (changed(feel=lambda self, q: None), "Mine: feel returned None, without q; return a "
     "selftouch_drake.agent.body.Felt"),
    (feels(lambda felt: {"sensation": felt["sensation"][0]}), "Mine: feel returned sensation of "
     "shape (16,); return (1, 16), each time"),
    (feels(lambda felt: {"sensation": "hard"}), "Mine: feel returned sensation 'hard'; return "
     "numbers of shape (1, 16)"),
    (shrinks(), "Mine: feel returned sensation of shape (1, 15); return (1, 16), each time"),
    (feels(lambda felt: {"reached": True}), "Mine: feel returned reached of shape (); return (1,), "
     "each time"),
    (feels(lambda felt: nan_at(felt, "q")), "Mine: feel returned q with nan at [0, 1]; return the "
     "last good reading, or reached False"),
    (feels(lambda felt: nan_at(felt, "sensation")), "Mine: feel returned sensation with nan at "
     "[0, 1]; return the last good reading, or reached False"),
    (feels(lambda felt: {"q": np.rad2deg(felt["q"])}), "Mine: feel says that x reached 0.5, and "
     "that it is at 28.65; give q in the unit of lower and upper, or reached False"),
]  # fmt: skip

#: What is wrong with what it follows, and its line.
FOLLOWED = [
    (follows(lambda found: {"time_s": found["time_s"][::-1]}), "Mine: follow returned time_s "
     "[1.0, 0.5, 0.0]; give seconds from the start of the motion, ascending"),
    (follows(lambda found: {"q": found["q"][:2]}), "Mine: follow returned q of shape (2, 3); "
     "return (3, 3), each time"),
    (follows(lambda found: nan_at(found, "sensation")), "Mine: follow returned sensation with "
     "nan at [0, 1]; return the last good reading, or reached False"),
]  # fmt: skip
