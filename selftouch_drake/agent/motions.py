"""Motions of the agent: planned, timed, executed.

A `Plan` is a path. A `Motion` adds times and the sensations that the agent predicts. An `Execution`
adds what happened. Each holds the one before.
"""

from dataclasses import dataclass, replace

import numpy as np

from selftouch_drake.agent.records import Record
from selftouch_drake.quotient.plan import MotorPath

#: Value in `nodes` of a configuration in which nothing is felt.
NO_KERNEL = -1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan(MotorPath, Record):
    """A path in motor space along links, through the air, and past imagined touches.

    W waypoints, of which the first has the node `NO_KERNEL` if the agent touches nothing there.

    Attributes:
        links: `(W - 1,)` row of each step in the planner's `links`; -1 where there is none: in the
            air.
        in_air: `(W - 1,)` bool, steps through the air, from one touch (or none) to another.
        modes: `(W - 1,)` the mode of the touches on each step along links; `NO_MODE` of others.
        imagined: `(W,)` bool, waypoints between two touches, where the agent only expects one.
        doubts: what may go wrong on it as the agent imagines, in words; empty where it sees nothing
            that may, or has no body model to see it with.
    """

    links: np.ndarray
    in_air: np.ndarray
    modes: np.ndarray
    imagined: np.ndarray
    doubts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        num = self.nodes.size
        waypoints = dict.fromkeys(("nodes", "waypoint_s", "imagined"), (num,))
        steps = dict.fromkeys(("links", "in_air", "modes"), (num - 1,))
        self.check_arrays({**waypoints, "waypoints_q": (num, None), **steps})

    @property
    def is_imagined(self) -> bool:
        """Whether it touches on the way, and no step of it follows a link of the quotient."""
        without_link = (self.links < 0).all() and (self.modes < 0).all()
        return bool(without_link and not self.in_air.all())

    def without_imagined(self) -> "Plan":
        """The same path, without the waypoints that are imagined."""
        rows = np.flatnonzero(~self.imagined)
        steps = {name: getattr(self, name)[rows[:-1]] for name in ("links", "in_air", "modes")}
        names = ("nodes", "imagined", "waypoints_q", "waypoint_s")
        return replace(self, **steps, **{name: getattr(self, name)[rows] for name in names})

    def touching(self, s: np.ndarray) -> np.ndarray:
        """`(T,)` bool, whether the agent expects contact at each `s`; at the end it always does."""
        if not len(self.in_air):
            return np.ones(len(s), dtype=bool)
        return ~self.in_air[steps(self.waypoint_s, s)] | (s >= self.waypoint_s[-1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion(Record):
    """A plan with times, and with the sensations that the agent predicts.

    J joints, S receptors and T instants, evenly spaced in time.

    Attributes:
        plan: the plan.
        time_s: `(T,)` s.
        s: `(T,)` mu, desired position along the path.
        q: `(T, J)` desired motor configurations, in the robot's units.
        v: `(T, J)` their velocities, per second.
        predicted: `(T, S)` unit L2 norm, the predicted sensation; null where none is expected.
        predicted_spread: `(T,)` scale of the expected error, a cosine distance.
    """

    plan: "Plan"
    time_s: np.ndarray
    s: np.ndarray
    q: np.ndarray
    v: np.ndarray
    predicted: np.ndarray
    predicted_spread: np.ndarray

    def __post_init__(self) -> None:
        num = self.time_s.size
        rows = dict.fromkeys(("time_s", "s", "predicted_spread"), (num,))
        moves = dict.fromkeys(("q", "v"), (num, self.plan.waypoints_q.shape[1]))
        self.check_arrays({**rows, **moves, "predicted": (num, None)})

    @property
    def step(self) -> np.ndarray:
        """`(T,)` the step of each instant; step i leads from waypoint i to the next."""
        return steps(self.plan.waypoint_s, self.s)

    @property
    def touching(self) -> np.ndarray:
        """`(T,)` bool, whether contact is expected: where the agent is not in the air."""
        return self.plan.touching(self.s)

    def contact(self, felt: np.ndarray) -> float:
        """Share of the time with expected contact in which sensations `felt` `(T, S)` are not null.

        1 if no contact is expected.
        """
        expected = self.touching
        return float(np.mean(np.any(felt, axis=1)[expected])) if expected.any() else 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Execution(Record):
    """What happened when a motion was executed.

    T instants, S receptors, J joints; N instants at which torques were read.

    Attributes:
        motion: the desired motion.
        felt: `(T, S)` N, measured sensations.
        q_measured: `(T, J)` measured joint positions, in the robot's units.
        v_measured: `(T, J)` their velocities, per second.
        torque: `(N, J)` N m or N, actuator torques or forces.
    """

    motion: Motion
    felt: np.ndarray
    q_measured: np.ndarray
    v_measured: np.ndarray
    torque: np.ndarray

    def __post_init__(self) -> None:
        moves = dict.fromkeys(("q_measured", "v_measured"), self.motion.q.shape)
        torque = (None, self.motion.q.shape[1])
        self.check_arrays({"felt": self.motion.predicted.shape, **moves, "torque": torque})

    @property
    def contact(self) -> float:
        """Share of the time with expected contact in which something was felt."""
        return self.motion.contact(self.felt)


def steps(waypoint_s: np.ndarray, s: np.ndarray) -> np.ndarray:
    """`(T,)` the step of each `s`: the index of the waypoint before it."""
    return np.searchsorted(waypoint_s, s, side="right").clip(1, max(len(waypoint_s) - 1, 1)) - 1
