"""The system that commands a robot's joints, along a path."""

from __future__ import annotations

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem
from pydrake.trajectories import Trajectory


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


def value_of(content: object) -> AbstractValue:
    """Any Python object but None as a Drake value, for old and new bindings."""
    value = Value[object]()
    value.set_value(content)
    return value
