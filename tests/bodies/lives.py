"""A toy that travels, remembers where it was asked to go, and breaks on request."""

import json
import os
from pathlib import Path

import numpy as np
from toys import Flat

from selftouch_drake.agent.body import Felt, Followed


class Travels(Flat):
    """A finger that travels over a flat skin, whose readings rest at 10 counts.

    It breaks in the motion whose number is in the file `TOY_BREAKS` names, as that file says, and
    writes into the file `TOY_RESTED` names that it rests.
    """

    step_s = 0.02

    def __init__(self):
        super().__init__(jumps=False)
        self.robot_s, self.at, self.asked, self.num = 0.0, self.lower, [], 0
        self.noise = np.random.default_rng(0)

    def touch(self, q):
        return 10.0 + np.rint(200.0 * super().touch(q)) + self.noise.integers(0, 2, (len(q), 16))

    def feel(self, q):
        self.asked.append(("feel", q.copy()))
        for posture in q:
            self.robot_s += float(np.max(np.abs(posture - self.at) / self.velocity)) + 0.1
            self.at = posture.copy()
        return Felt(q=q, sensation=self.touch(q), reached=np.ones(len(q), dtype=bool))

    def follow(self, time_s, q):
        self.num += 1
        breaks = Path(os.environ.get("TOY_BREAKS", "/nowhere"))
        if breaks.exists() and self.num >= (said := json.loads(breaks.read_text()))["motion"]:
            breaks.unlink()
            if said["how"] == "hangs":
                import time

                time.sleep(30)
            raise KeyboardInterrupt if said["how"] == "ctrl-c" else OSError("cable is loose")
        self.asked.append(("follow", q.copy(), time_s.copy(), self.at.copy()))
        times = np.arange(0.0, time_s[-1] + 1e-9, self.step_s)
        where = np.stack([np.interp(times, time_s, column) for column in q.T], axis=1)
        self.robot_s += float(time_s[-1])
        self.at = q[-1].copy()
        return Followed(time_s=times, q=where, sensation=self.touch(where))

    def rest(self):
        if "TOY_RESTED" in os.environ:
            with Path(os.environ["TOY_RESTED"]).open("a") as file:
                file.write("at rest\n")


class Walled(Travels):
    """A finger that stops at a wall across its skin, unless it is lifted."""

    def feel(self, q):
        wanted, rows = q.copy(), np.zeros(len(q), dtype=bool)
        for row, posture in enumerate(wanted):
            way = self.at + np.linspace(0, 1, 201)[:, None] * (posture - self.at)
            stops = (np.abs(way[:, 0] - 0.5) < 0.02) & (way[:, 2] > 0.1)
            rows[row] = not stops.any()
            q[row] = posture if rows[row] else way[max(stops.argmax() - 1, 0)]
            super().feel(q[row : row + 1])
        return Felt(q=q, sensation=self.touch(q), reached=rows)


class OtherJoints(Travels):
    joint_names = ("x", "y", "thumb")


class FewerReceptors(Travels):
    num_receptors = 15

    def touch(self, q):
        return super().touch(q)[:, :15]


class Jumps(Flat):
    """As `Travels`, but it is put into its postures."""

    def touch(self, q):
        return 10.0 + np.rint(200.0 * super().touch(q))


class Bumpy(Jumps):
    """Its skin is curved and thin: a finger that would press too deep is not let in."""

    def depth(self, q):
        return q[:, 2] - 0.3 * np.sin(7 * q[:, 0]) * np.cos(6 * q[:, 1])

    def touch(self, q):
        return super().touch(np.column_stack([q[:, :2], self.depth(q)]))

    def feel(self, q):
        return Felt(q=q, sensation=self.touch(q), reached=self.depth(q) < 0.1)


class Wounded(Bumpy):
    """As `Bumpy`, with receptors that died."""

    def touch(self, q):
        return np.where(np.isin(np.arange(16), [5, 6]), 10.0, super().touch(q))


class Numb(Bumpy):
    """As `Bumpy`, but it feels nothing any more."""

    def touch(self, q):
        return np.full((len(q), 16), 10.0)
