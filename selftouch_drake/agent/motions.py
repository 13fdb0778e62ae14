"""Motions of the agent: planned, timed, executed.

A `Plan` is a path. A `Motion` adds times and the sensations that the agent predicts. An `Execution`
adds what happened. Each holds the one before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from scipy.interpolate import BSpline

#: Value in `nodes` of a configuration in which nothing is felt.
NO_KERNEL = -1


class _Record:
    """A record of arrays, which is saved as one flat dictionary of arrays by name."""

    __slots__ = ()

    def to_arrays(self) -> dict[str, np.ndarray]:
        """All fields, and those of the record that it holds.

        A path becomes `path_knots` and `path_control`.
        """
        arrays: dict[str, np.ndarray] = {}
        for name, value in ((f.name, getattr(self, f.name)) for f in fields(self)):  # type: ignore[arg-type]
            if isinstance(value, _Record):
                arrays |= value.to_arrays()
            elif isinstance(value, BSpline):
                arrays |= {"path_knots": value.t, "path_control": value.c}
            else:
                arrays[name] = value
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> Self:
        """Inverse of `to_arrays`; other names are ignored.

        Raises:
            ValueError: an array is missing or does not fit the others; the text names it.
        """
        return cls(**{field.name: _restored(field.name, arrays) for field in fields(cls)})  # type: ignore[arg-type]


def _restored(name: str, arrays: Mapping[str, np.ndarray]) -> Any:
    if name == "plan":
        return Plan.from_arrays(arrays)
    if name == "motion":
        return Motion.from_arrays(arrays)
    if name == "path":
        knots, control = (_restored(part, arrays) for part in ("path_knots", "path_control"))
        fits = knots.ndim == 1 and control.ndim == 2 and len(knots) > len(control) + 1
        if not fits or {knots.dtype.kind, control.dtype.kind} != {"f"}:
            raise ValueError("path_control does not fit path_knots")
        return BSpline(knots, control, len(knots) - len(control) - 1)
    if name not in arrays:
        raise ValueError(f"{name} is missing")
    return np.asarray(arrays[name])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan(_Record):
    """A geometric path in motor space through one configuration of each kernel on a route.

    W waypoints and J joints. Motor configurations are in the robot's units; lengths along the path
    are between scaled configurations (rad).

    Attributes:
        nodes: `(W,)` kernels, from the start to the goal; the first is `NO_KERNEL` if the agent
            touches nothing there.
        links: `(W - 1,)` row of each step in the planner's `links`; -1 where there is none: in the
            air.
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
        num = self.nodes.size
        steps = dict.fromkeys(("links", "in_air"), (num - 1,))
        q = (num, _width(self.waypoints_q))
        check_arrays(self, {"nodes": (num,), **steps, "waypoints_q": q, "waypoint_s": (num,)})

    @property
    def goal(self) -> int:
        """The kernel to be felt at the end."""
        return int(self.nodes[-1])

    def touching(self, s: np.ndarray) -> np.ndarray:
        """`(T,)` bool, whether the agent expects contact at each `s`; at the end it always does."""
        if not len(self.in_air):
            return np.ones(len(s), dtype=bool)
        return ~self.in_air[steps(self.waypoint_s, s)] | (s >= self.waypoint_s[-1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion(_Record):
    """A plan with times, and with the sensations that the agent predicts.

    J joints, S receptors and T instants, evenly spaced in time.

    Attributes:
        plan: the plan.
        time_s: `(T,)` s.
        s: `(T,)` rad, desired position along the path.
        q: `(T, J)` desired motor configurations, in the robot's units.
        v: `(T, J)` their velocities, per second.
        predicted: `(T, S)` unit L2 norm, the predicted sensation; null where none is expected.
        predicted_spread: `(T,)` scale of the expected error, a cosine distance.

    Raises:
        ValueError: shapes disagree; the text names the first array that does not fit.
    """

    plan: Plan
    time_s: np.ndarray
    s: np.ndarray
    q: np.ndarray
    v: np.ndarray
    predicted: np.ndarray
    predicted_spread: np.ndarray

    def __post_init__(self) -> None:
        num = self.time_s.size
        rows = dict.fromkeys(("time_s", "s", "predicted_spread"), (num,))
        moves = dict.fromkeys(("q", "v"), (num, _width(self.plan.waypoints_q)))
        check_arrays(self, {**rows, **moves, "predicted": (num, _width(self.predicted))})

    @property
    def goal(self) -> int:
        """The kernel to be felt at the end."""
        return self.plan.goal

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
class Execution(_Record):
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
        moves = dict.fromkeys(("q_measured", "v_measured"), self.motion.q.shape)
        num_torques = self.torque.shape[0] if self.torque.ndim else 0
        torque = (num_torques, _width(self.motion.q))
        check_arrays(self, {"felt": self.motion.predicted.shape, **moves, "torque": torque})

    @property
    def contact(self) -> float:
        """Share of the time with expected contact in which something was felt."""
        return self.motion.contact(self.felt)


def steps(waypoint_s: np.ndarray, s: np.ndarray) -> np.ndarray:
    """`(T,)` the step of each `s`: the index of the waypoint before it."""
    return np.searchsorted(waypoint_s, s, side="right").clip(1, max(len(waypoint_s) - 1, 1)) - 1


def _width(array: np.ndarray) -> int:
    return array.shape[1] if array.ndim == 2 else 0


_WHOLE, _BOOLEANS = ("iu", "whole numbers"), ("b", "booleans")
#: Kinds of numbers of the arrays that do not hold real numbers, and their names in errors.
_KINDS = dict.fromkeys(("nodes", "links", "node", "offsets"), _WHOLE) | {"in_air": _BOOLEANS}


def check_arrays(record: Any, expected: Mapping[str, tuple[int, ...]], prefix: str = "") -> None:
    """Checks shapes and kinds of arrays of a record; the prefix is of their names in a file.

    Raises:
        ValueError: an array does not fit; the text names it.
    """
    for name, shape in expected.items():
        array = getattr(record, name)
        if array.shape != shape:
            raise ValueError(f"{prefix}{name} has shape {array.shape}, expected {shape}")
        kinds, words = _KINDS.get(name, ("iuf", "finite numbers"))
        if array.dtype.kind not in kinds or not np.isfinite(array).all():
            raise ValueError(f"{prefix}{name} must hold {words}")
