"""The system that babbles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydrake.systems.framework import LeafSystem

if TYPE_CHECKING:
    from selftouch_drake.experience.walk import RandomWalk


class Babbler(LeafSystem):
    """Commands a random walk through motor space.

    .. pydrake_system::

        name: Babbler
        output_ports:
        - q
        - desired_state

    - q: `(J,)` rad, the last step of the walk, held: for a kinematic station.
    - desired_state: `(2J,)` rad and rad/s, from there to the next step at constant velocity: for
      joint controllers.

    The walk itself is not part of the context: one Babbler serves one simulation at a time.
    """

    def __init__(self, *, num_joints: int, period_s: float, walk: RandomWalk | None = None):
        super().__init__()
        if walk is not None:
            self.set_walk(walk)
        self._num_joints = num_joints
        self._period_s = period_s
        # The step that was left, the one that is gone to, and when the one was left. Drake updates
        # all systems of an instant at once: whoever follows the walk still sees it arrive there.
        self.DeclareDiscreteState(2 * num_joints + 1)
        self.DeclareInitializationDiscreteUpdateEvent(self._begin)
        self.DeclarePeriodicDiscreteUpdateEvent(period_s, period_s, self._step)
        self.DeclareVectorOutputPort("q", num_joints, self._calc_q)
        self.DeclareVectorOutputPort("desired_state", 2 * num_joints, self._calc_desired_state)

    def set_walk(self, walk: RandomWalk) -> None:
        """Gives the walk that begins with the next simulation."""
        self._walk = walk

    def _begin(self, context, discrete_state):
        discrete_state.set_value(np.append(self._walk.steps(2), context.get_time()))

    def _step(self, context, discrete_state):
        _, arrived, _ = self._split(context)
        discrete_state.set_value(
            np.concatenate([arrived, self._walk.steps(1)[0], [context.get_time()]])
        )

    def _calc_q(self, context, output):
        output.SetFromVector(self._split(context)[0])

    def _calc_desired_state(self, context, output):
        left, goal, left_at = self._split(context)
        velocity = (goal - left) / self._period_s
        elapsed = context.get_time() - left_at
        output.SetFromVector(np.concatenate([left + elapsed * velocity, velocity]))

    def _split(self, context):
        state = context.get_discrete_state_vector().value()
        return state[: self._num_joints], state[self._num_joints : -1], state[-1]
