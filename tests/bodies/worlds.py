"""A small Gymnasium environment in numpy, for every kind of action and every mistake."""

import gymnasium
import numpy as np
from toys import Flat

#: How much each of four actions moves each joint; the second moves nothing. Coupled, the others
#: move two joints each.
SINGLE = np.array([[0.0, 0.0, -2.0, 0.0], [0.0, 0.0, 0.0, 1.5], [0.5, 0.0, 0.0, 0.0]])
COUPLED = np.array([[0.5, 0.0, 0.0, -1.0], [0.0, 0.0, 1.5, 1.0], [0.5, 0.0, 0.7, 0.0]])
LOW, HIGH = np.array([-0.5, 0.0, -1.0]), np.array([1.0, 1.0, 0.5])


class Sliders(gymnasium.Env):
    """Three joints; see `toys.Flat`. Gravity pulls the first."""

    metadata = {"render_modes": [], "render_fps": 50}  # noqa: RUF012

    def __init__(
        self,
        kind="position",
        flat=False,
        limited=True,
        length=None,
        effect=SINGLE,
        action_space=None,
    ):
        self.kind, self.flat, self.length = kind, flat, length
        self.effect = np.array(effect)
        box = gymnasium.spaces.Box
        most = np.inf if not limited else 1.0
        self.action_space = action_space or box(-3.0, 3.0, (4,), np.float32)
        low, high = (LOW, HIGH) if limited else (np.full(3, -most), np.full(3, most))
        entries = {
            "joints": box(low, high, dtype=np.float64),
            "touch": box(0, 9, (16,), np.float64),
        }
        self.observation_space = gymnasium.spaces.Dict(entries)
        if flat:
            low, high = np.r_[low, np.zeros(16)], np.r_[high, np.full(16, 9.0)]
            self.observation_space = box(low, high, dtype=np.float64)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.q, self.v, self.steps = np.array([0.3, 0.4, -0.5]), np.zeros(3), 0
        if options and "posture" in options:
            self.q = np.array(options["posture"], dtype=float)
        return self.observation(), {}

    def set_posture(self, q):
        self.q, self.v = np.array(q), np.zeros(3)
        return None if q[0] > 0.9 else self.observation()

    def step(self, action):
        wanted = self.effect @ action
        gravity = np.array([-2.0, 0.0, 0.0])
        for _ in range(5):
            if self.kind == "velocity":
                self.v = wanted
            else:
                servo = 200.0 * (wanted - self.q) - 25.0 * self.v
                self.v = self.v + 0.004 * (
                    gravity + (servo if self.kind == "position" else 10 * wanted)
                )
                self.v = self.v * 0.999
            self.q = self.q + 0.004 * self.v
            stopped = (self.q < LOW) | (self.q > HIGH)
            self.q, self.v = self.q.clip(LOW, HIGH), np.where(stopped, 0.0, self.v)
        self.steps += 1
        ended = self.length is not None and self.steps >= self.length
        return self.observation(), 0.0, False, ended, {}

    def observation(self):
        touch = Flat().touch(self.q[None])[0]
        if self.flat:
            return np.r_[self.q, touch]
        return {"joints": self.q.copy(), "touch": touch}
