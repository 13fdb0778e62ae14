"""The trajectory source: it commands the motion of a plan, and says what should be felt."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from selftouch_drake.agent.motions import Motion


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Course:
    """What a `PlanSource` follows, over the time of its context.

    Attributes:
        path: `(J,)` rad or m, as the joints read.
        rate: its derivative.
        time_s: `(T,)` s, of the predictions.
        predicted: `(T, S)` predicted sensations of unit L2 norm.
        ends_s: s, first and last time of the path.
    """

    path: Trajectory
    rate: Trajectory
    time_s: np.ndarray
    predicted: np.ndarray
    ends_s: tuple[float, float]

    @staticmethod
    def along(path: Trajectory, num_receptors: int) -> "Course":
        """A path without predictions."""
        nothing = np.zeros((1, num_receptors))
        return Course(
            path=path,
            rate=path.MakeDerivative(),
            time_s=np.zeros(1),
            predicted=nothing,
            ends_s=(path.start_time(), path.end_time()),
        )

    @staticmethod
    def of_motion(motion: Motion) -> "Course":
        """A motion: the cubic through its samples with their velocities."""
        path = PiecewisePolynomial.CubicHermite(motion.time_s, motion.q.T, motion.v.T)
        return Course(
            path=path,
            rate=path.MakeDerivative(),
            time_s=motion.time_s,
            predicted=motion.predicted,
            ends_s=(path.start_time(), path.end_time()),
        )

    def __deepcopy__(self, memo: dict[int, Any]) -> "Course":
        """Itself: Drake copies the state of a context, and a course never changes."""
        return self


class PlanSource(LeafSystem):
    """Commands the joints along the motion of a plan, practised or not, or along any path.

    .. pydrake_system::

        name: PlanSource
        output_ports:
        - desired_state
        - predicted_sensation

    ========================= ====== ==== ========== =======================================
    port                      type   size unit       what
    ========================= ====== ==== ========== =======================================
    desired_state (out)       vector 2J   rad, m, /s positions as joints read, then rates
    predicted_sensation (out) vector S    none       the agent's prediction, of unit L2 norm
    ========================= ====== ==== ========== =======================================

    Its course is the cubic through the motion's positions and rates. A body that executes the
    motion is given its positions alone, and takes the same course within 1e-6 rad
    (`bodies/drake.py: rates_through`).

    The motion is abstract state of the context: one diagram serves many plans, and two contexts
    follow two of them. Its time is that of the context. Before its start and after its end the
    command rests there.

    Args:
        motion: that it follows unless a context is given another; without, it rests at 0.
        num_joints: J, where no motion is given.
        num_receptors: S, where no motion is given.
    """

    def __init__(
        self, motion: Motion | None = None, *, num_joints: int = 0, num_receptors: int = 0
    ):
        super().__init__()
        if motion is None:
            rest = PiecewisePolynomial(np.zeros((num_joints, 1)))
            course = Course.along(rest, num_receptors)
        else:
            course = Course.of_motion(motion)
        self._num_receptors = course.predicted.shape[1]
        value = Value[object]()
        value.set_value(course)
        state = self.DeclareAbstractState(value)
        self._state = int(state)
        needs = {self.time_ticket(), self.abstract_state_ticket(state)}
        self.DeclareVectorOutputPort(
            "desired_state",
            2 * course.path.rows(),
            self._calc_desired_state,
            prerequisites_of_calc=needs,
        )
        self.DeclareVectorOutputPort(
            "predicted_sensation",
            self._num_receptors,
            self._calc_predicted,
            prerequisites_of_calc=needs,
        )

    @staticmethod
    def AddToBuilder(
        builder: DiagramBuilder, motion: Motion, *, name: str = "plan_source"
    ) -> "PlanSource":
        """Adds a source of a motion to a diagram."""
        source = PlanSource(motion)
        builder.AddNamedSystem(name, source)
        return source

    def SetMotion(self, context: Context, motion: Motion) -> None:
        """Has this system's context follow another motion, which begins at time 0.

        Raises:
            ValueError: it has other joints or receptors.
        """
        found = motion.q.shape[1], motion.predicted.shape[1]
        wanted = self.GetOutputPort("desired_state").size() // 2, self._num_receptors
        if found != wanted:
            raise ValueError(
                f"the motion has {found[0]} joints and {found[1]} receptors, and this PlanSource "
                f"{wanted[0]} and {wanted[1]}; make another for it"
            )
        self._set(context, Course.of_motion(motion))

    def SetPath(self, context: Context, path: Trajectory) -> None:
        """Has this system's context follow a path `(J,)` over its time, without predictions."""
        self._set(context, Course.along(path, self._num_receptors))

    def _set(self, context: Context, course: Course) -> None:
        context.get_mutable_abstract_state(self._state).set_value(course)

    def _course(self, context: Context) -> Course:
        return context.get_abstract_state(self._state).get_value()

    def _calc_desired_state(self, context, output):
        course, time = self._course(context), context.get_time()
        q, (start, end) = course.path.value(time), course.ends_s
        v = course.rate.value(time) if start <= time <= end else np.zeros_like(q)
        output.SetFromVector(np.concatenate([q, v]))

    def _calc_predicted(self, context, output):
        course = self._course(context)
        row = int(np.searchsorted(course.time_s, context.get_time(), side="right")) - 1
        output.SetFromVector(course.predicted[max(row, 0)])
