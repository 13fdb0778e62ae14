"""A touch servo: it corrects a robot that follows a path beside the skin.

The strength of a touch does not show on which side of the skin's middle a finger is: it is weaker
on both sides. So the servo keeps a belief about the offset of the robot and updates it with the
sensations along the motion (a histogram filter, Thrun, Burgard, Fox: Probabilistic Robotics, 2005).
"""

from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    LeafSystem,
    OutputPort,
)

#: mu, offsets across the skin that the servo distinguishes: 4 mm at an arm's length.
OFFSETS = 0.005 * np.arange(-12, 13)

#: s between two updates, a small part of the time constant of the servo.
PERIOD = 0.01

#: rad/s: the offset follows the belief with a time constant of 83 ms, a bandwidth of 1.9 Hz.
BANDWIDTH = 12.0

#: rad, the longest offset: 6 cm at an arm's length.
MAX_OFFSET = 0.08

# The belief before anything is felt: the offset has a standard deviation of 0.02 rad.
_PRIOR = np.exp(-0.5 * np.square(OFFSETS / 0.02))
_PRIOR /= _PRIOR.sum()

# rad per root of a second: growth of the uncertainty, because the direction across turns.
_DRIFT = 0.02

# Error of a reading, in N and as a share of the expected one. Errors of successive readings are
# correlated, so each reading counts as half of one.
_ERROR_N, _ERROR_SHARE, _WEIGHT = 0.3, 0.2, 0.5

# Least probability of an offset, so that the belief can still change.
_LEAST_BELIEF = 1e-6


def corrected(belief: np.ndarray, felt: float, expected: np.ndarray, period_s: float) -> np.ndarray:
    """The belief `(G,)`, probabilities of `OFFSETS`, after a sensation and `period_s` s.

    The touch is felt with a strength in N; expected is `(G,)` N, the strength at each offset.
    """
    error = _ERROR_N + _ERROR_SHARE * expected
    likely = -0.5 * np.square((felt - expected) / error) - np.log(error)
    belief = belief * np.exp(_WEIGHT * (likely - likely.max()))
    belief = belief / belief.sum()
    spread = _DRIFT**2 * period_s / (2.0 * (OFFSETS[1] - OFFSETS[0]) ** 2)
    beside = np.pad(belief, 1, mode="edge")
    return belief + spread * (beside[2:] + beside[:-2] - 2.0 * belief)


def shifted(belief: np.ndarray, by: float) -> np.ndarray:
    """The belief after the robot moved across by `by` rad."""
    belief = np.interp(OFFSETS - by, OFFSETS, belief, left=0.0, right=0.0)
    belief = np.maximum(belief, _LEAST_BELIEF)
    return belief / belief.sum()


class TouchServo(LeafSystem):
    """Shifts a commanded path towards the skin, by the offset that follows from sensations.

    .. pydrake_system::

        name: TouchServo
        input_ports:
        - desired_state
        - sensation
        - beside
        output_ports:
        - desired_state

    =================== ======== ==== ============ =========================================
    port                type     size unit         what
    =================== ======== ==== ============ =========================================
    desired_state (in)  vector   2J   rad, m, /s   positions as planned, then their rates
    sensation (in)      vector   S    N            one reading per receptor
    beside (in)         abstract                   what is felt beside the path, see below
    desired_state (out) vector   2J   rad, m, /s   the same with the offset
    =================== ======== ==== ============ =========================================

    `beside` may be left unconnected, or be `()`: then the offset stays as it is. Otherwise it says
    what is felt across the path, where `OFFSETS` lie, as attributes: `time_s` `(K,)` s of the
    context, of places along the path; `across` `(K, J)` unit directions across the skin, in
    configurations scaled by `joint_scale` `(J,)`; `strength` `(K, G)` N of the touch, 0 where the
    servo rests. An agent's `TouchProfile` is one.

    The offset, its rate and the belief are discrete state. The offset never exceeds `MAX_OFFSET`,
    and never leads out of the limits of the joints.

    Args:
        num_receptors: S.
        lower: `(J,)` rad or m, of the joints.
        upper: `(J,)` rad or m, of the joints.
    """

    def __init__(self, *, num_receptors: int, lower: np.ndarray, upper: np.ndarray):
        super().__init__()
        self._lower, self._upper = lower, upper
        self._num_joints = num_joints = len(lower)
        planned = self.DeclareVectorInputPort("desired_state", 2 * num_joints)
        self._sensation = self.DeclareVectorInputPort("sensation", num_receptors)
        self._beside = self.DeclareAbstractInputPort("beside", Value[object]())
        # The offset at the last update, its rate, and when that was.
        offset = self.DeclareDiscreteState(2 * num_joints + 1)
        self._offset = int(offset)
        self._belief = int(self.DeclareDiscreteState(_PRIOR))
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._update)
        self.DeclareVectorOutputPort(
            "desired_state",
            BasicVector(2 * num_joints),
            self._calc_desired_state,
            prerequisites_of_calc={
                self.input_port_ticket(planned.get_index()),
                self.discrete_state_ticket(offset),
                self.time_ticket(),
            },
        )

    @staticmethod
    def AddToBuilder(
        builder: DiagramBuilder,
        desired_state: OutputPort,
        sensation: OutputPort,
        *,
        lower: np.ndarray,
        upper: np.ndarray,
        name: str = "touch_servo",
    ) -> "TouchServo":
        """Adds a servo behind what commands a robot; limits are as in the constructor."""
        servo = TouchServo(num_receptors=sensation.size(), lower=lower, upper=upper)
        builder.AddNamedSystem(name, servo)
        builder.Connect(desired_state, servo.GetInputPort("desired_state"))
        builder.Connect(sensation, servo.GetInputPort("sensation"))
        return servo

    def Begin(self, context: Context, beside: Any, *, at_rest: bool) -> None:
        """Begins a motion at time 0: gives this system's context what is beside its path.

        Where the robot is put at rest, the offset is 0, else as it was.
        """
        # Any Python object but None, for old and new bindings.
        value = Value[object]()
        value.set_value(beside or ())
        self._beside.FixValue(context, value)
        offset = np.zeros(self._num_joints) if at_rest else self._moved(context)[0]
        held = np.zeros(self._num_joints + 1)
        context.SetDiscreteState(self._offset, np.concatenate([offset, held]))
        context.SetDiscreteState(self._belief, _PRIOR)

    def _moved(self, context):
        """The offset now, and its rate."""
        state = context.get_discrete_state(self._offset).value()
        offset, rate = state[: self._num_joints], state[self._num_joints : -1]
        return offset + (context.get_time() - state[-1]) * rate, rate

    def _update(self, context, discrete_state):
        beside: Any = self._beside.Eval(context) if self._beside.HasValue(context) else ()
        time_s = context.get_time()
        offset, _ = self._moved(context)
        rate, belief = np.zeros(self._num_joints), context.get_discrete_state(self._belief).value()
        expected = np.zeros(0)
        if beside:
            place = max(int(np.searchsorted(beside.time_s, time_s, side="right")) - 1, 0)
            across, expected = beside.across[place], beside.strength[place]
        if expected.any():
            felt = float(np.linalg.norm(self._sensation.Eval(context)))
            belief = corrected(belief, felt, expected, PERIOD)
            # Out of touch, the mean of two sides is neither.
            off = OFFSETS @ belief if felt > 0 else OFFSETS[belief.argmax()]
            x = offset * beside.joint_scale
            aim = x - BANDWIDTH * PERIOD * off * across
            aim *= min(1.0, MAX_OFFSET / max(float(np.linalg.norm(aim)), MAX_OFFSET))
            belief = shifted(belief, float(across @ (aim - x)))
            rate = (aim - x) / beside.joint_scale / PERIOD
        discrete_state.set_value(self._offset, np.concatenate([offset, rate, [time_s]]))
        discrete_state.set_value(self._belief, belief)

    def _calc_desired_state(self, context, output):
        q, v = np.split(self.GetInputPort("desired_state").Eval(context), 2)
        offset, rate = self._moved(context)
        there = (q + offset).clip(self._lower, self._upper)
        output.SetFromVector(np.concatenate([there, v + rate]))
