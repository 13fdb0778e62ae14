"""The babbling controller: it commands the random walk of an experiment."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem

from selftouch_drake.experience.collect import random_walk
from selftouch_drake.experience.walk import StraightPieces
from selftouch_drake.experiment import Experiment
from selftouch_drake.robot.robot import BabblingJoints


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BegunWalk:
    """A walk that was begun.

    Attributes:
        pieces: of the walk.
        approach_s: s, in which the joints are led to its first node.
        approach: `(2J,)` where they begin, and their rates until then.
    """

    pieces: StraightPieces
    approach_s: float
    approach: np.ndarray

    def __deepcopy__(self, memo: dict[int, Any]) -> "BegunWalk":
        """Itself: Drake copies the parameters of a context, and what was begun never changes."""
        return self


class Babbler(LeafSystem):
    """Commands a random walk through motor space, in straight pieces from node to node.

    .. pydrake_system::

        name: Babbler
        output_ports:
        - desired_state
        - q

    =================== ====== ==== ========== ==========================================
    port                type   size unit       what
    =================== ====== ==== ========== ==========================================
    desired_state (out) vector 2J   rad, m, /s where joints are commanded to be, and rates
    q (out)             vector J    rad or m   where they are commanded to be
    =================== ====== ==== ========== ==========================================

    The nodes are those of the experiment's `RandomWalk`, one for each `babbling.step_duration`. If
    the robot must travel (`babbling.jumps: false`), a piece lasts so many steps that no joint is
    faster than it may be.

    The walk follows from the time of the context, and from its parameter: the walk, and from where
    and for how long the joints approach its first node. So two contexts walk alike, and a context
    that is set back walks the same way again.

    Args:
        experiment: of the walk.
        walk: number of the walk of a default context.
        joints: of the experiment's robot, if they are known already.
    """

    def __init__(
        self, experiment: Experiment, *, walk: int = 0, joints: BabblingJoints | None = None
    ):
        super().__init__()
        self._experiment = experiment
        self._joints = joints or BabblingJoints.of(experiment)
        self._num_joints = num_joints = len(self._joints.lower)
        self._first = self._make_walk(walk)
        self._start = int(self.DeclareAbstractParameter(self._begun(self._first)))
        needs = {self.time_ticket(), self.all_parameters_ticket()}
        self.DeclareVectorOutputPort(
            "desired_state", 2 * num_joints, self._calc_desired_state, prerequisites_of_calc=needs
        )
        self.DeclareVectorOutputPort("q", num_joints, self._calc_q, prerequisites_of_calc=needs)

    @staticmethod
    def AddToBuilder(
        builder: DiagramBuilder, experiment: Experiment, *, walk: int = 0, name: str = "babbler"
    ) -> "Babbler":
        """Adds the babbler of an experiment to a diagram."""
        babbler = Babbler(experiment, walk=walk)
        builder.AddNamedSystem(name, babbler)
        return babbler

    def SetWalk(
        self,
        context: Context,
        walk: int,
        *,
        q_from: np.ndarray | None = None,
        approach_s: float = 0.0,
    ) -> None:
        """Has this system's context walk another walk from time 0 on.

        A robot that cannot jump is led to the first node from `q_from` `(J,)`, in `approach_s` s.
        """
        pieces = self._make_walk(walk)
        value = self._begun(pieces, q_from, approach_s)
        context.get_mutable_abstract_parameter(self._start).SetFrom(value)

    def nodes(self, num_nodes: int) -> np.ndarray:
        """`(num_nodes, J)` rad or m, the first nodes of the walk of a default context."""
        return self._first.nodes(num_nodes)

    def first_node(self, walk: int) -> np.ndarray:
        """`(J,)` rad or m, where a walk begins."""
        return self._make_walk(walk).nodes(1)[0]

    def _begun(
        self, pieces: StraightPieces, q_from: np.ndarray | None = None, approach_s: float = 0.0
    ) -> Value:
        first = pieces.nodes(1)[0]
        begin = first if q_from is None else q_from
        rate = (first - begin) / approach_s if approach_s else np.zeros_like(first)
        value = Value[object]()
        approach = np.concatenate([begin, rate])
        value.set_value(BegunWalk(pieces=pieces, approach_s=approach_s, approach=approach))
        return value

    def _make_walk(self, walk: int) -> StraightPieces:
        babbling = self._experiment.babbling
        return StraightPieces(
            random_walk(self._experiment, self._joints, walk),
            duration=babbling.step_duration,
            velocity=None if babbling.jumps else self._joints.velocity,
        )

    def _now(self, context: Context) -> np.ndarray:
        """`(2J,)` where joints are commanded to be, and how fast."""
        # At every step of a plant: so one look at the context, and few operations of numpy.
        begun, time_s = context.get_abstract_parameter(self._start).get_value(), context.get_time()
        since = time_s - begun.approach_s
        if since >= 0.0:
            return begun.pieces.at(since)
        q, rate = np.split(begun.approach, 2)
        return np.concatenate([q + time_s * rate, rate])

    def _calc_desired_state(self, context, output):
        output.set_value(self._now(context))

    def _calc_q(self, context, output):
        output.set_value(self._now(context)[: self._num_joints])
