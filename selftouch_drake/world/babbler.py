"""The system that babbles."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydrake.systems.framework import LeafSystem

if TYPE_CHECKING:
    from selftouch_drake.babbling.walk import RandomWalk


class Babbler(LeafSystem):
    """Commands the next motor configuration of a random walk at every period.

    .. pydrake_system::

        name: Babbler
        output_ports:
        - q

    - q: `(J,)` rad, held between periods.

    The walk itself is not part of the context: one Babbler serves one simulation.
    """

    def __init__(self, *, walk: RandomWalk, num_joints: int, period_s: float):
        super().__init__()
        self._walk = walk
        state = self.DeclareDiscreteState(num_joints)
        self.DeclareInitializationDiscreteUpdateEvent(self._step)
        self.DeclarePeriodicDiscreteUpdateEvent(period_s, period_s, self._step)
        self.DeclareStateOutputPort("q", state)

    def _step(self, context, discrete_state):
        discrete_state.set_value(self._walk.steps(1)[0])
