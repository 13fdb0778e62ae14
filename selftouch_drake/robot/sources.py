"""Systems that command a robot's joints: along a path, or at random."""

from __future__ import annotations

import copy
from typing import Protocol

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem
from pydrake.trajectories import Trajectory


class Walk(Protocol):
    """A walk through motor space."""

    def steps(self, num_steps: int) -> np.ndarray:
        """`(num_steps, J)` rad or m, the next configurations."""


class PathSource(LeafSystem):
    """Commands the state along a path, and rest at its ends before and after it.

    The path is an input, so that it is part of the context: two contexts of one diagram may follow
    two paths. (Drake's `TrajectorySource` keeps its trajectory in the system.)

    .. pydrake_system::

        name: PathSource
        input_ports:
        - path
        output_ports:
        - desired_state

    - path: a Drake `Trajectory` of q `(J, 1)`.
    - desired_state: `(2J,)` rad or m, and their rates.
    """

    def __init__(self, num_joints: int):
        super().__init__()
        self._path = self.DeclareAbstractInputPort("path", Value[object]())
        self.DeclareVectorOutputPort("desired_state", 2 * num_joints, self._calc_desired_state)

    def SetPath(self, context: Context, path: Trajectory) -> None:
        """Gives this system's context a path over the context's time, s."""
        self._path.FixValue(context, value_of(path))

    def _calc_desired_state(self, context, output):
        path = self._path.Eval(context)
        time = context.get_time()
        q = path.value(min(max(time, path.start_time()), path.end_time())).ravel()
        moving = path.start_time() <= time < path.end_time()
        v = path.EvalDerivative(time, 1).ravel() if moving else np.zeros_like(q)
        output.SetFromVector(np.concatenate([q, v]))


class Babbler(LeafSystem):
    """Commands a random walk through motor space.

    .. pydrake_system::

        name: Babbler
        output_ports:
        - q
        - desired_state

    - q: `(J,)` rad or m, the step of the walk just taken, held: for a kinematic station.
    - desired_state: `(2J,)` rad or m and their rates, from there to the next step at constant
      velocity: for joint controllers.

    The walk is part of the context: two contexts of one diagram walk independently.

    Args:
        num_joints: J.
        period_s: s, from step to step.
    """

    def __init__(self, *, num_joints: int, period_s: float):
        super().__init__()
        self._num_joints = num_joints
        self._period_s = period_s
        # The walk, and the step after the next one.
        self._walk = self.DeclareAbstractState(value_of(()))
        # The previous step, the next one, and the time of the previous one.
        self._steps = self.DeclareDiscreteState(2 * num_joints + 1)
        # Drake updates all discrete states of an instant at once: followers of the walk still see
        # the step arrive, because the next step is drawn before the update.
        self.DeclarePeriodicUnrestrictedUpdateEvent(period_s, period_s, self._draw)
        self.DeclarePeriodicDiscreteUpdateEvent(period_s, period_s, self._step)
        self.DeclareVectorOutputPort("q", num_joints, self._calc_q)
        self.DeclareVectorOutputPort("desired_state", 2 * num_joints, self._calc_desired_state)

    def SetWalk(self, context: Context, walk: Walk) -> None:
        """Begins a walk in this system's context, now; `walk` itself does not move."""
        walk = copy.deepcopy(walk)
        first = walk.steps(2)
        context.get_mutable_abstract_state(int(self._walk)).set_value((walk, first[-1]))
        context.SetDiscreteState(int(self._steps), np.append(first, context.get_time()))

    def _draw(self, context, state):
        walk = copy.deepcopy(self._given(context)[0])
        drawn = walk.steps(1)[0]
        state.get_mutable_abstract_state(int(self._walk)).set_value((walk, drawn))

    def _step(self, context, discrete_state):
        _, arrived, _ = self._split(context)
        _, drawn = self._given(context)
        discrete_state.set_value(np.concatenate([arrived, drawn, [context.get_time()]]))

    def _calc_q(self, context, output):
        output.SetFromVector(self._split(context)[0])

    def _calc_desired_state(self, context, output):
        taken, following, taken_at = self._split(context)
        velocity = (following - taken) / self._period_s
        elapsed = context.get_time() - taken_at
        output.SetFromVector(np.concatenate([taken + elapsed * velocity, velocity]))

    def _split(self, context):
        self._given(context)
        state = context.get_discrete_state(int(self._steps)).value()
        return state[: self._num_joints], state[self._num_joints : -1], state[-1]

    def _given(self, context):
        given = context.get_abstract_state(int(self._walk)).get_value()
        if not given:
            raise ValueError("the Babbler has no walk; call SetWalk on its context first")
        return given


def value_of(content: object) -> AbstractValue:
    """Any Python object but None as a Drake value, for old and new bindings."""
    value = Value[object]()
    value.set_value(content)
    return value
