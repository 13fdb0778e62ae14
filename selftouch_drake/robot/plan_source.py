"""The system that commands a plan."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import LeafSystem
from pydrake.trajectories import Trajectory


class PlanSource(LeafSystem):
    """Commands the state along a trajectory, and rest at its ends before and after it.

    Unlike Drake's TrajectorySource it takes a new trajectory between simulations, and needs no
    derivative of it as a trajectory of its own.

    .. pydrake_system::

        name: PlanSource
        output_ports:
        - desired_state

    - desired_state: `(2J,)` rad and rad/s.
    """

    def __init__(self, trajectory: Trajectory):
        super().__init__()
        self.set_trajectory(trajectory)
        self.DeclareVectorOutputPort(
            "desired_state", 2 * trajectory.rows(), self._calc_desired_state
        )

    def set_trajectory(self, trajectory: Trajectory) -> None:
        """Replaces the trajectory; its start is time zero of the next simulation."""
        self._trajectory = trajectory

    def _calc_desired_state(self, context, output):
        path = self._trajectory
        time = path.start_time() + context.get_time()
        q = path.value(np.clip(time, path.start_time(), path.end_time())).ravel()
        moving = path.start_time() <= time < path.end_time()
        v = path.EvalDerivative(time, 1).ravel() if moving else np.zeros_like(q)
        output.SetFromVector(np.concatenate([q, v]))
