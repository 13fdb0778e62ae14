"""A real robot as the body of the agent: slow, with a time-out, and with two kinds of stop.

`Driver` stands for what your robot comes with. Replace it, and set what is marked.
"""

import time

import numpy as np

from selftouch_drake.agent.body import BodyError, Felt, Followed


class Driver:
    """A stand-in: three joints that follow at once, and 16 receptors over which a finger moves."""

    stopped = False  # whether someone pressed the emergency stop

    def __init__(self):
        self.q = np.array([0.5, 0.5, -0.5])

    def send(self, q):
        """Where the joints are to go next."""
        self.q = np.array(q)

    def read(self):
        """The time of a reading, joint positions, and raw readings of the skin."""
        grid = np.stack(np.meshgrid(*[np.linspace(0.1, 0.9, 4)] * 2), -1).reshape(-1, 2)
        near = (1 - np.linalg.norm(grid - self.q[:2], axis=1) / 0.4).clip(0.0)
        return time.monotonic(), self.q, 20.0 + 100.0 * near * max(0.0, self.q[2])


class MyRobot:
    """Moves along straight lines, slowly, and stops where the skin is pressed too hard."""

    jumps = False
    # Set these: of your robot, in the unit of its encoders, per second and per second squared.
    joint_names = ("x", "y", "press")
    lower, upper = np.array([0.0, 0.0, -0.5]), np.array([1.0, 1.0, 1.0])
    velocity, acceleration = np.full(3, 0.5), np.full(3, 2.0)
    num_receptors = 16

    def __init__(self, hardest=80.0, slow=0.3, period_s=0.02, silent_s=0.5):
        self.driver, self.hardest, self.period_s = Driver(), hardest, period_s
        self.silent_s, self.step = silent_s, slow * self.velocity * period_s
        self.offset = np.median([self.read()[1] for _ in range(10)], axis=0)

    def read(self):
        """Joint positions and readings; an error if they are old or someone pressed the stop."""
        if self.driver.stopped:
            raise BodyError("the emergency stop is pressed; release it and give the command again")
        at, q, sensation = self.driver.read()
        if time.monotonic() - at > self.silent_s:
            raise BodyError(f"no reading for {self.silent_s} s; check the cable of the skin")
        return np.array(q), np.array(sensation)

    def pressed(self, sensation):
        """Whether a receptor is pressed harder than it may be."""
        return (sensation - self.offset).max() > self.hardest

    def go(self, goal):
        """Goes there in small steps; False, and one step back, where it is pressed too hard."""
        start, _ = self.read()
        num_steps = int(np.ceil((np.abs(goal - start) / self.step).max()))
        before = start
        for share in np.linspace(0, 1, num_steps + 1)[1:]:
            self.driver.send(start + share * (goal - start))
            time.sleep(self.period_s)
            now, sensation = self.read()
            if self.pressed(sensation):
                self.driver.send(before)
                time.sleep(self.period_s)
                return False
            before = now
        return True

    def feel(self, q):
        """As in `Body`."""
        rows = [(self.go(posture), *self.read()) for posture in q]
        reached, where, felt = map(np.array, zip(*rows, strict=True))
        return Felt(q=where, sensation=felt, reached=reached)

    def follow(self, time_s, q):
        """As in `Body`; it ends early where it is pressed too hard."""
        self.go(q[0])
        began, rows = time.monotonic(), []
        while (now := time.monotonic() - began) < time_s[-1]:
            self.driver.send([np.interp(now, time_s, column) for column in q.T])
            where, sensation = self.read()
            rows.append((now, where, sensation))
            if self.pressed(sensation):
                break
            time.sleep(self.period_s)
        times, where, felt = map(np.array, zip(*rows, strict=True))
        return Followed(time_s=times, q=where, sensation=felt)

    def rest(self):
        """Called at the end, on Ctrl-C and after an error."""
        self.driver.send(self.driver.read()[1])


def main():
    """Returns which of three postures are reached; the last one presses too hard."""
    robot = MyRobot(slow=20.0)
    felt = robot.feel(np.array([[0.5, 0.5, 0.1], [0.4, 0.6, 0.3], [0.37, 0.63, 1.0]]))
    robot.follow(np.array([0.0, 0.2]), np.array([[0.4, 0.6, 0.3], [0.4, 0.5, 0.3]]))
    robot.rest()
    return felt.reached.tolist()


if __name__ == "__main__":
    print("reached:", main())
