"""How far plans stray from where the robot was recorded (naive)."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial import KDTree

from selftouch_drake.agent.motions import Plan
from selftouch_drake.agent.planning.members import goal_members
from selftouch_drake.agent.representation.quotient import QuotientRepresentation

#: mu of path between the places that are looked at; most stored touches that are compared.
_SAMPLED, _MOST_TOUCHES = 0.1, 100_000

#: A place is known if so many recorded ones are near: the nearest alone may be a rare posture. And
#: number of starts from which `surest` plans.
_NEAR, _NUM_STARTS = 3, 48

#: Straying counts to this power, because plans fail where they stray most. Measured on 60 plans on
#: each of four recordings with 12 joints and 30,000 touches: rigid parts overlap on 1.2 to 2.2 % of
#: the samples; to the 4th power on 1.0 to 2.9 %, with the nearest place alone on 2.0 to 3.2 %, with
#: one start on 3.4 and 4.9 %.
_POWER = 16


class Recorded:
    """Where a robot was while it was recorded, in touch and, at `(m, J)` `free_q`, free.

    The typical distance of touches is that from one to the third nearest.
    """

    def __init__(self, representation: QuotientRepresentation, free_q: np.ndarray | None = None):
        q = representation.kernel_q[:: -(-representation.num_rows // _MOST_TOUCHES)]
        self._representation = representation
        places = q if free_q is None else np.concatenate([q, free_q])
        self._near = KDTree(representation.scaled(places))
        beside = self._near.query(self._near.data[: len(q)], k=[1 + _NEAR])[0]
        self._typical = float(np.median(beside)) or 1.0

    def strays(self, plan: Plan) -> np.ndarray:
        """`(n,)` how far the path is from anything recorded, in typical distances."""
        length = plan.waypoint_s[-1]
        places = plan.path(np.linspace(0.0, length, 2 + int(length / _SAMPLED)))
        away, _ = self._near.query(self._representation.scaled(places), k=[_NEAR])
        return away[:, 0] / self._typical

    def novelty(self, plan: Plan) -> float:
        """How far a plan strays: the 95th percentile along its path, in typical distances."""
        return float(np.quantile(self.strays(plan), 0.95))

    def surest(self, targets: Sequence[int], plan: Callable[..., Plan]) -> list[Plan]:
        """Plans from typical firm touches of the first target; that which strays least comes first.

        A plan may begin where its way is best known: `plan` makes it, as `Agent.plan` does.
        """
        known = self._representation
        rows = goal_members(known, targets[0])
        typical = rows[np.argsort(known.kernel_error[rows], kind="stable")[:_NUM_STARTS]]
        plans = [plan(*targets, q_start=known.kernel_q[row].astype(float)) for row in typical]
        return sorted(plans, key=lambda one: float(np.sum(self.strays(one) ** _POWER)))
