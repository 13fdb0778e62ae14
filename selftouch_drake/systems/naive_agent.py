"""The naive agent as a system: it moves to a wanted sensation."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.planning.timing import braking, time_path

#: rad/s and rad/s², or m/s and m/s², limits of its motions by default, as in an experiment.
VELOCITY, ACCELERATION = 1.0, 5.0

#: s between two looks at the goal.
PERIOD_S = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Intention:
    """What the agent is about.

    Attributes:
        goal: `(S,)` the sensation that it moves to, or null; None if it has to decide.
        path: `(J,)` over the context's time; at its end the agent rests.
    """

    goal: np.ndarray | None
    path: Trajectory

    def __deepcopy__(self, memo: dict[int, Any]) -> "Intention":
        """Itself: Drake copies the state of a context, and an intention never changes."""
        return self


class NaiveAgent(LeafSystem):
    """An agent that has learned, in a diagram: it plans to a wanted sensation, and goes there.

    .. pydrake_system::

        name: NaiveAgent
        input_ports:
        - q
        - sensation
        - goal
        output_ports:
        - desired_state

    =================== ====== ==== ========== ==============================================
    port                type   size unit       what
    =================== ====== ==== ========== ==============================================
    q (in)              vector J    rad or m   where the joints read that they are
    sensation (in)      vector S    N          what it feels
    goal (in)           vector S    N          what it is to feel, of any strength; or null
    desired_state (out) vector 2J   rad, m, /s where joints are commanded to be, and rates
    =================== ====== ==== ========== ==============================================

    It plans when the goal changes, from where it is, with what it has learned; nobody has followed
    that plan before. If it is moving, it first slows down on its path. Without a goal, that is a
    null one, and where it finds no way, it holds still. All that it is about is state of the
    context.

    Args:
        agent: that has learned.
        velocity: rad/s or m/s, limit of its motions, one for all or `(J,)`.
        acceleration: rad/s² or m/s², likewise.
    """

    def __init__(
        self,
        agent: Agent,
        *,
        velocity: float | np.ndarray = VELOCITY,
        acceleration: float | np.ndarray = ACCELERATION,
    ):
        super().__init__()
        self._agent = agent
        num_receptors = agent.representation.target_sensations.shape[1]
        self._num_joints = num_joints = agent.representation.kernel_q.shape[1]
        self._velocity = np.broadcast_to(velocity, num_joints).astype(float)
        self._acceleration = np.broadcast_to(acceleration, num_joints).astype(float)
        self._q = self.DeclareVectorInputPort("q", num_joints)
        self._sensation = self.DeclareVectorInputPort("sensation", num_receptors)
        self._goal = self.DeclareVectorInputPort("goal", num_receptors)
        unborn = Value[object]()
        unborn.set_value(())
        state = self.DeclareAbstractState(unborn)
        self._state = int(state)
        self.DeclareInitializationUnrestrictedUpdateEvent(self._begin)
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD_S, 0.0, self._decide)
        # It acts in its events only; otherwise the diagram would have an algebraic loop.
        self.DeclareVectorOutputPort(
            "desired_state",
            2 * num_joints,
            self._calc_desired_state,
            prerequisites_of_calc={
                self.time_ticket(),
                self.abstract_state_ticket(state),
                self.input_port_ticket(self._q.get_index()),
            },
        )

    @staticmethod
    def AddToBuilder(
        builder: DiagramBuilder, agent: Agent, *, name: str = "naive_agent", **limits: Any
    ) -> "NaiveAgent":
        """Adds an agent to a diagram; limits are as in the constructor."""
        mind = NaiveAgent(agent, **limits)
        builder.AddNamedSystem(name, mind)
        return mind

    def _begin(self, context, state):
        self._set(state, Intention(goal=None, path=_resting(self._q.Eval(context))))

    def _decide(self, context, state):
        about, now = self._about(context), context.get_time()
        goal = self._goal.Eval(context).copy()
        if about.goal is not None and np.array_equal(goal, about.goal):
            return
        if now < about.path.end_time():
            if about.goal is not None:
                self._set(state, Intention(goal=None, path=_braked(about.path, now)))
            return
        self._set(state, replace(self._planned(context, about.path, goal), goal=goal))

    def _planned(self, context: Context, path: Trajectory, goal: np.ndarray) -> Intention:
        """What it is about from now on; it rests at the end of a path."""
        q, now = path.value(path.end_time()).ravel(), context.get_time()
        still = Intention(goal=goal, path=_resting(q))
        wanted = self._agent.target_felt(goal)
        if wanted is None:
            return still
        here = self._agent.target_felt(self._sensation.Eval(context))
        try:
            plan = self._agent.plan(here, wanted, q_start=q)
        except ValueError:  # there is no way
            return still
        timed = time_path(
            plan.path, velocity_limit=self._velocity, acceleration_limit=self._acceleration
        )
        course = PiecewisePolynomial.CubicHermite(now + timed.time_s, timed.q.T, timed.v.T)
        return Intention(goal=goal, path=course)

    def _set(self, state, about: Intention) -> None:
        state.get_mutable_abstract_state(self._state).set_value(about)

    def _about(self, context: Context) -> Intention:
        """What it is about; before its first event it rests where it is."""
        about = context.get_abstract_state(self._state).get_value()
        if isinstance(about, Intention):
            return about
        return Intention(goal=None, path=_resting(self._q.Eval(context)))

    def _calc_desired_state(self, context, output):
        path, time = self._about(context).path, context.get_time()
        q = path.value(time).ravel()
        moving = path.start_time() <= time < path.end_time()
        v = path.EvalDerivative(time, 1).ravel() if moving else np.zeros_like(q)
        output.SetFromVector(np.concatenate([q, v]))


def _braked(path: Trajectory, now: float) -> PiecewisePolynomial:
    """A path from a time on, slowed down to a stop."""
    since, at, share = braking(now, path.end_time())
    rate = path.MakeDerivative()
    v = rate.vector_values(at) * share
    return PiecewisePolynomial.CubicHermite(now + since, path.vector_values(at), v)


def _resting(q: np.ndarray) -> PiecewisePolynomial:
    """A path that never leaves `(J,)` q, and has ended at all times."""
    nodes = np.stack([q, q], axis=1)
    return PiecewisePolynomial.FirstOrderHold([-2.0, -1.0], nodes)
