"""Motions of the agent: planned, timed, executed.

A `Plan` is a path. A `Motion` adds times and the sensations that the agent predicts. An `Execution`
records what happened. Each can be converted to a flat dictionary of arrays and back, so that other
packages can store it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from scipy.interpolate import BSpline

#: Value in `nodes` of a configuration in which nothing is felt.
NO_KERNEL = -1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """A geometric path in motor space through one configuration of each kernel on a route.

    W waypoints and J joints. Motor configurations are in the robot's units; lengths along the path
    are between scaled configurations (rad).

    Attributes:
        nodes: `(W,)` kernels, from the start to the goal; the first is `NO_KERNEL` if the agent
            touches nothing there.
        links: `(W - 1,)` row of each step in the planner's `links`; -1 where there is none: in the
            air, and on a literal route.
        in_air: `(W - 1,)` bool, steps through the air, from one touch (or none) to another.
        waypoints_q: `(W, J)` one motor configuration per kernel.
        waypoint_s: `(W,)` rad, parameter of each waypoint on `path`: polyline length up to it.
        path: smooth quintic B-spline of motor configurations over `[0, waypoint_s[-1]]`, from the
            first waypoint to the last; constant over `[0, 1]` if the start is the goal.

    Raises:
        ValueError: shapes disagree; the text names the first array that does not fit.
    """

    nodes: np.ndarray
    links: np.ndarray
    in_air: np.ndarray
    waypoints_q: np.ndarray
    waypoint_s: np.ndarray
    path: BSpline

    def __post_init__(self) -> None:
        _check(self, _of_plan(self.nodes, self.waypoints_q))

    @property
    def goal(self) -> int:
        """The kernel to be felt at the end."""
        return int(self.nodes[-1])

    def to_arrays(self) -> dict[str, np.ndarray]:
        """All fields as arrays, by name; the path as `path_knots` and `path_control`."""
        return _arrays(self, but="path") | {"path_knots": self.path.t, "path_control": self.path.c}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> Plan:
        """Inverse of `to_arrays`; other names are ignored.

        Raises:
            ValueError: an array is missing or does not fit the others; the text names it.
        """
        found = _named(arrays, "path_knots", "path_control")
        knots, control = found["path_knots"], found["path_control"]
        degree = len(knots) - len(control) - 1
        if knots.ndim != 1 or control.ndim != 2 or degree < 1:
            raise ValueError("path_control does not fit path_knots")
        return cls(**_fields(cls, arrays, but="path"), path=BSpline(knots, control, degree))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """A plan with times, and with the sensations that the agent predicts.

    W waypoints, J joints, S receptors and T instants, evenly spaced in time.

    Attributes:
        nodes: `(W,)` as in `Plan`.
        links: `(W - 1,)` as in `Plan`.
        in_air: `(W - 1,)` bool, as in `Plan`.
        waypoints_q: `(W, J)` as in `Plan`.
        waypoint_s: `(W,)` rad, as in `Plan`.
        time_s: `(T,)` s.
        s: `(T,)` rad, desired position along the path.
        q: `(T, J)` desired motor configurations, in the robot's units.
        v: `(T, J)` their velocities, per second.
        predicted: `(T, S)` unit L2 norm, the predicted sensation; null where none is expected.
        predicted_spread: `(T,)` scale of the expected error, a cosine distance.

    Raises:
        ValueError: shapes disagree; the text names the first array that does not fit.
    """

    nodes: np.ndarray
    links: np.ndarray
    in_air: np.ndarray
    waypoints_q: np.ndarray
    waypoint_s: np.ndarray
    time_s: np.ndarray
    s: np.ndarray
    q: np.ndarray
    v: np.ndarray
    predicted: np.ndarray
    predicted_spread: np.ndarray

    def __post_init__(self) -> None:
        num_times, num_joints = self.time_s.size, _width(self.waypoints_q)
        expected = {
            **_of_plan(self.nodes, self.waypoints_q),
            **dict.fromkeys(("time_s", "s", "predicted_spread"), (num_times,)),
            **dict.fromkeys(("q", "v"), (num_times, num_joints)),
            "predicted": (num_times, _width(self.predicted)),
        }
        _check(self, expected)

    @classmethod
    def of(
        cls,
        plan: Plan,
        *,
        time_s: np.ndarray,
        s: np.ndarray,
        q: np.ndarray,
        v: np.ndarray,
        predicted: np.ndarray,
        predicted_spread: np.ndarray,
    ) -> Motion:
        """Combines a plan with times and predictions; arguments are the fields."""
        return cls(
            **_arrays(plan, but="path"),
            time_s=time_s,
            s=s,
            q=q,
            v=v,
            predicted=predicted,
            predicted_spread=predicted_spread,
        )

    @property
    def goal(self) -> int:
        """The kernel to be felt at the end."""
        return int(self.nodes[-1])

    @property
    def step(self) -> np.ndarray:
        """`(T,)` the step of each instant; step i leads from waypoint i to the next."""
        return steps(self.waypoint_s, self.s)

    @property
    def touching(self) -> np.ndarray:
        """`(T,)` bool, whether contact is expected: where the agent is not in the air."""
        return touching(self.waypoint_s, self.in_air, self.s)

    def contact(self, felt: np.ndarray) -> float:
        """Share of the time with expected contact in which sensations `felt` `(T, S)` are not null.

        1 if no contact is expected.
        """
        expected = self.touching
        return float(np.mean(np.any(felt, axis=1)[expected])) if expected.any() else 1.0

    def to_arrays(self) -> dict[str, np.ndarray]:
        """All fields, by name."""
        return _arrays(self)

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> Motion:
        """Inverse of `to_arrays`; other names are ignored.

        Raises:
            ValueError: an array is missing or does not fit the others; the text names it.
        """
        return cls(**_fields(cls, arrays))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Execution:
    """What happened when a motion was executed.

    T instants, S receptors, J joints; N instants at which torques were read.

    Attributes:
        motion: the desired motion.
        felt: `(T, S)` N, measured sensations.
        q_measured: `(T, J)` measured joint positions, in the robot's units.
        v_measured: `(T, J)` their velocities, per second.
        torque: `(N, J)` N m or N, actuator torques or forces.

    Raises:
        ValueError: shapes disagree; the text names the first array that does not fit.
    """

    motion: Motion
    felt: np.ndarray
    q_measured: np.ndarray
    v_measured: np.ndarray
    torque: np.ndarray

    def __post_init__(self) -> None:
        motion = self.motion
        num_torques = self.torque.shape[0] if self.torque.ndim else 0
        expected = {
            "felt": motion.predicted.shape,
            "q_measured": motion.q.shape,
            "v_measured": motion.q.shape,
            "torque": (num_torques, _width(motion.q)),
        }
        _check(self, expected)

    @property
    def contact(self) -> float:
        """Share of the time with expected contact in which something was felt."""
        return self.motion.contact(self.felt)

    def to_arrays(self) -> dict[str, np.ndarray]:
        """All fields, and those of the motion, by name."""
        return self.motion.to_arrays() | _arrays(self, but="motion")

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> Execution:
        """Inverse of `to_arrays`; other names are ignored.

        Raises:
            ValueError: an array is missing or does not fit the others; the text names it.
        """
        return cls(motion=Motion.from_arrays(arrays), **_fields(cls, arrays, but="motion"))


def steps(waypoint_s: np.ndarray, s: np.ndarray) -> np.ndarray:
    """`(T,)` the step of each `s`: the index of the waypoint before it."""
    return np.searchsorted(waypoint_s, s, side="right").clip(1, max(len(waypoint_s) - 1, 1)) - 1


def touching(waypoint_s: np.ndarray, in_air: np.ndarray, s: np.ndarray) -> np.ndarray:
    """`(T,)` bool, whether the agent expects contact at each `s`; at the end it always does."""
    if not len(in_air):
        return np.ones(len(s), dtype=bool)
    return ~in_air[steps(waypoint_s, s)] | (s >= waypoint_s[-1])


def _of_plan(nodes: np.ndarray, waypoints_q: np.ndarray) -> dict[str, tuple[int, ...]]:
    num = nodes.size
    return {
        "nodes": (num,),
        "links": (num - 1,),
        "in_air": (num - 1,),
        "waypoints_q": (num, _width(waypoints_q)),
        "waypoint_s": (num,),
    }


def _width(array: np.ndarray) -> int:
    return array.shape[1] if array.ndim == 2 else 0


#: Kinds of numbers of the arrays that do not hold real numbers.
_KINDS = {"nodes": "iu", "links": "iu", "in_air": "b"}


def _check(record: Plan | Motion | Execution, expected: Mapping[str, tuple[int, ...]]) -> None:
    for name, shape in expected.items():
        array = getattr(record, name)
        if array.shape != shape or array.ndim != len(shape):
            raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
        if array.dtype.kind not in _KINDS.get(name, "iuf") or not np.isfinite(array).all():
            raise ValueError(f"{name} must hold {_WORDS.get(name, 'finite numbers')}")


_WORDS = {"nodes": "whole numbers", "links": "whole numbers", "in_air": "booleans"}


def _named(arrays: Mapping[str, np.ndarray], *names: str) -> dict[str, np.ndarray]:
    if missing := [name for name in names if name not in arrays]:
        raise ValueError(f"{missing[0]} is missing")
    return {name: np.asarray(arrays[name]) for name in names}


def _fields(
    cls: type[Plan | Motion | Execution], arrays: Mapping[str, np.ndarray], but: str = ""
) -> dict[str, np.ndarray]:
    return _named(arrays, *(field.name for field in fields(cls) if field.name != but))


def _arrays(record: Plan | Motion | Execution, but: str = "") -> dict[str, np.ndarray]:
    return {f.name: getattr(record, f.name) for f in fields(record) if f.name != but}
