"""Motions of the agent: planned, timed, executed.

A `Plan` is a path. A `Motion` adds times and expected sensations. An `Execution` is a motion with
its results. Each can be turned into a flat dictionary of arrays and back, for files.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from scipy.interpolate import BSpline

#: Stands in `nodes` for a configuration in which nothing is felt.
NO_KERNEL = -1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """A geometric path in motor space through one configuration of each kernel on a route.

    W waypoints and J joints. Motor configurations are in the robot's units; lengths along the path
    are in scaled ones (rad).

    Attributes:
        nodes: `(W,)` kernels, from the start to the goal; the first is `NO_KERNEL` if the agent
            touches nothing there.
        links: `(W - 1,)` row in the planner's `links` of each step; -1 where it follows none: in
            the air, and on a literal route.
        in_air: `(W - 1,)` bool, steps on which the agent leaves one touch, or none, and lands at
            another.
        waypoints_q: `(W, J)` one motor configuration per kernel.
        waypoint_s: `(W,)` rad, where on `path` each waypoint is: length of the polyline up to it.
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
        """What `to_arrays` gave; other names are ignored.

        Raises:
            ValueError: an array is missing, or does not fit the others; the text names it.
        """
        found = _named(arrays, "path_knots", "path_control")
        knots, control = found["path_knots"], found["path_control"]
        degree = len(knots) - len(control) - 1
        if knots.ndim != 1 or control.ndim != 2 or degree < 1:
            raise ValueError("path_control does not fit path_knots")
        return cls(**_fields(cls, arrays, but="path"), path=BSpline(knots, control, degree))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """A plan with times and expected sensations.

    W waypoints, J joints, S receptors and T instants, evenly spaced in time.

    Attributes:
        nodes: `(W,)` as of the `Plan`.
        links: `(W - 1,)` as of the `Plan`.
        in_air: `(W - 1,)` bool, as of the `Plan`.
        waypoints_q: `(W, J)` as of the `Plan`.
        waypoint_s: `(W,)` rad, as of the `Plan`.
        time_s: `(T,)` s.
        s: `(T,)` rad, wanted length along the path.
        q: `(T, J)` motor configurations, in the robot's units.
        v: `(T, J)` their velocities, per second.
        predicted: `(T, S)` unit L2 norm, the expected sensation; null where nothing is expected.
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
        """A plan with times and expectations; arguments are the fields."""
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
        """`(T,)` the step that each instant belongs to, from one waypoint to the next."""
        return steps(self.waypoint_s, self.s)

    @property
    def touching(self) -> np.ndarray:
        """`(T,)` bool, whether touch is expected: where the agent is not in the air."""
        return touching(self.waypoint_s, self.in_air, self.s)

    def to_arrays(self) -> dict[str, np.ndarray]:
        """All fields, by name."""
        return _arrays(self)

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> Motion:
        """What `to_arrays` gave; other names are ignored.

        Raises:
            ValueError: an array is missing, or does not fit the others; the text names it.
        """
        return cls(**_fields(cls, arrays))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Execution:
    """A motion with its results.

    T instants, S receptors, J joints; N instants at which torques were read.

    Attributes:
        motion: the motion.
        felt: `(T, S)` N, sensations.
        q_measured: `(T, J)` where the joints were, in the robot's units.
        v_measured: `(T, J)` their velocities, per second.
        torque: `(N, J)` N m or N, of the actuators.

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
        """Share of the time with expected touch in which something was felt; else 1."""
        expected = self.motion.touching
        felt = np.any(self.felt, axis=1)[expected]
        return float(np.mean(felt)) if expected.any() else 1.0

    def to_arrays(self) -> dict[str, np.ndarray]:
        """All fields, and those of the motion, by name."""
        return self.motion.to_arrays() | _arrays(self, but="motion")

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> Execution:
        """What `to_arrays` gave; other names are ignored.

        Raises:
            ValueError: an array is missing, or does not fit the others; the text names it.
        """
        return cls(motion=Motion.from_arrays(arrays), **_fields(cls, arrays, but="motion"))


def steps(waypoint_s: np.ndarray, s: np.ndarray) -> np.ndarray:
    """`(T,)` between which waypoint and the next each `s` lies."""
    return np.searchsorted(waypoint_s, s, side="right").clip(1, max(len(waypoint_s) - 1, 1)) - 1


def touching(waypoint_s: np.ndarray, in_air: np.ndarray, s: np.ndarray) -> np.ndarray:
    """`(T,)` bool, whether the agent expects touch at each `s`; at the end it does."""
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


#: Kinds of numbers, where they are not real ones.
_KINDS = {"nodes": "iu", "links": "iu", "in_air": "b"}


def _check(record: Plan | Motion | Execution, expected: Mapping[str, tuple[int, ...]]) -> None:
    for name, shape in expected.items():
        array = getattr(record, name)
        if array.shape != shape or array.ndim != len(shape):
            raise ValueError(f"{name} has shape {array.shape}, not {shape}: it does not fit")
        if array.dtype.kind not in _KINDS.get(name, "iuf") or not np.isfinite(array).all():
            raise ValueError(f"{name} holds what is no {_WORDS.get(name, 'finite number')}")


_WORDS = {"nodes": "whole number", "links": "whole number", "in_air": "truth value"}


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
