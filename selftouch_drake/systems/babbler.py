"""The babbling controller: it commands the random walk of an experiment."""

from functools import lru_cache

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from selftouch_drake.experience.collect import random_walk
from selftouch_drake.experience.walk import StraightPieces
from selftouch_drake.experiment import Experiment
from selftouch_drake.robot.robot import BabblingJoints


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

    The walk follows from the time of the context and from its parameters: the number of the walk,
    and from where and for how long the joints approach its first node. So two contexts walk alike,
    and a context that is set back walks the same way again.

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
        # What is kept follows from the number of the walk alone.
        self._walk = lru_cache(maxsize=2)(self._make_walk)
        # The number of the walk, s of the approach, and `(J,)` where it begins.
        start = BasicVector(np.concatenate([[walk, 0.0], np.zeros(num_joints)]))
        self._parameter = self.DeclareNumericParameter(start)
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
        begin = np.zeros(self._num_joints) if q_from is None else q_from
        parameter = context.get_mutable_numeric_parameter(self._parameter)
        parameter.SetFromVector(np.concatenate([[walk, approach_s], begin]))

    def nodes(self, num_nodes: int, *, walk: int = 0) -> np.ndarray:
        """`(num_nodes, J)` rad or m, the first nodes of a walk."""
        return self._walk(walk).nodes(num_nodes)

    def _make_walk(self, walk: int) -> StraightPieces:
        babbling = self._experiment.babbling
        return StraightPieces(
            random_walk(self._experiment, self._joints, walk),
            duration=babbling.step_duration,
            velocity=None if babbling.jumps else self._joints.velocity,
        )

    def _now(self, context: Context) -> tuple[np.ndarray, np.ndarray]:
        """`(J,)` where joints are commanded to be, and `(J,)` how fast."""
        given = context.get_numeric_parameter(self._parameter).value()
        walk, approach_s, time_s = self._walk(int(given[0])), given[1], context.get_time()
        if time_s >= approach_s:
            return walk.at(time_s - approach_s)
        begin = given[2:]
        rate = (walk.nodes(1)[0] - begin) / approach_s
        return begin + time_s * rate, rate

    def _calc_desired_state(self, context, output):
        output.SetFromVector(np.concatenate(self._now(context)))

    def _calc_q(self, context, output):
        output.SetFromVector(self._now(context)[0])
