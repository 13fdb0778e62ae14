"""A servo on one joint that crosses a skin 6 cm wide, and one joint that moves nothing."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

from selftouch_drake.agent.body import TouchProfile
from selftouch_drake.systems.touch_servo import (
    BANDWIDTH,
    MAX_OFFSET,
    OFFSETS,
    TouchServo,
    corrected,
    shifted,
)

LIMIT = np.array([1.0, 1.0])
TIME_S = 0.02 * np.arange(200)


def strength(x, time_s=0.0, slipped=0.0):
    """N, reading at x rad; the plan alternates between the two flanks of the skin."""
    middle = 0.012 * np.cos(3.0 * time_s) + slipped
    return np.maximum(0.0, 4.0 - np.square((x - middle) / 0.015))


def beside(expected=None):
    """Strengths beside a plan that stays at 0."""
    felt = strength(OFFSETS, TIME_S[:, None])
    return TouchProfile(
        time_s=TIME_S,
        across=np.tile([1.0, 0.0], (len(TIME_S), 1)),
        joint_scale=np.ones(2),
        strength=felt if expected is None else np.tile(expected, (len(TIME_S), 1)),
    )


class Skin(LeafSystem):
    """Feels where the first joint is commanded to be."""

    def __init__(self, slipped):
        super().__init__()
        self._slipped = slipped
        self.DeclareVectorInputPort("state", 4)
        self.DeclareVectorOutputPort("sensation", 1, self._feel)

    def _feel(self, context, output):
        x = self.GetInputPort("state").Eval(context)[0]
        output.SetFromVector([strength(x, context.get_time(), self._slipped)])


def served(slipped, planned=0.0, duration=3.0, pressing=None):
    """`(T,)` s and `(T, 2)` rad, commanded positions."""
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource([planned, 0.0, 0.0, 0.0]))
    servo = builder.AddSystem(TouchServo(num_receptors=1, lower=-LIMIT, upper=LIMIT))
    skin = builder.AddSystem(Skin(slipped))
    builder.Connect(source.get_output_port(), servo.GetInputPort("desired_state"))
    builder.Connect(servo.get_output_port(), skin.get_input_port())
    builder.Connect(skin.get_output_port(), servo.GetInputPort("sensation"))
    log = LogVectorOutput(servo.get_output_port(), builder, publish_period=0.01)
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    servo_context = servo.GetMyMutableContextFromRoot(context)
    servo.Begin(servo_context, beside() if pressing is None else pressing, at_rest=True)
    simulator.AdvanceTo(duration)
    found = log.FindLog(context)
    return found.sample_times(), found.data().T[:, :2]


def held(slipped):
    """The smallest strength of the touch after the first half second."""
    time_s, q = served(slipped)
    later = time_s > 0.5
    assert not q[:, 1].any()
    return strength(q[later, 0], time_s[later], slipped).min()


@pytest.mark.parametrize("slipped", [-0.03, -0.02, 0.02, 0.03])
def test_it_holds_a_touch_that_the_plan_alone_would_lose(slipped):
    assert strength(0.0, TIME_S, slipped).min() < 0.5
    assert held(slipped) > 1.5


def test_it_stays_where_all_is_as_it_was_learned():
    _, q = served(0.0)
    assert np.abs(q).max() < 0.01  # two of the offsets that it distinguishes


def test_it_follows_what_it_believes_with_its_bandwidth():
    # Only the far end of the scale explains that nothing is felt.
    pressing = beside(np.where(OFFSETS[2] > OFFSETS, 0.0, 4.0))
    time_s, q = served(10.0, pressing=pressing)
    rate = (q[1, 0] - q[0, 0]) / (time_s[1] - time_s[0])
    assert 0 < rate <= -1.01 * BANDWIDTH * OFFSETS[0]


def test_the_offset_is_bounded_and_stays_within_the_limits():
    pressing = beside(np.where(OFFSETS[2] > OFFSETS, 0.0, 4.0))
    _, q = served(10.0, pressing=pressing, duration=5.0)
    assert np.abs(q).max() == pytest.approx(MAX_OFFSET, rel=0.01)
    _, q = served(10.0, planned=0.97, pressing=pressing, duration=5.0)
    assert q.max() == pytest.approx(1.0)


def commanded(servo, felt, pressing):
    """A context after 0.2 s of the same reading."""
    context = servo.CreateDefaultContext()
    servo.Begin(context, pressing, at_rest=True)
    servo.GetInputPort("desired_state").FixValue(context, [0.3, 0.0, 0.1, 0.0])
    servo.GetInputPort("sensation").FixValue(context, [felt])
    Simulator(servo, context).AdvanceTo(0.2)
    return context


@pytest.fixture
def servo():
    return TouchServo(num_receptors=1, lower=-LIMIT, upper=LIMIT)


def offset(servo, context):
    return servo.get_output_port().Eval(context)[0] - 0.3


@pytest.mark.parametrize("pressing", [None, beside(np.zeros(len(OFFSETS)))])
def test_it_rests_in_the_air_and_without_explored_strengths(servo, pressing):
    context = commanded(servo, 0.0, pressing)
    assert servo.get_output_port().Eval(context).tolist() == [0.3, 0.0, 0.1, 0.0]


def test_two_contexts_of_one_servo_do_not_disturb_each_other(servo):
    alone = offset(servo, commanded(servo, 4.0, beside()))
    contexts = [commanded(servo, felt, beside()) for felt in (4.0, 0.0)]
    assert offset(servo, contexts[0]) == alone
    assert abs(offset(servo, contexts[1]) - alone) > 0.01


def test_a_motion_begins_with_the_offset_of_the_last_one_and_at_rest_with_none(servo):
    context = commanded(servo, 0.0, beside())
    before = offset(servo, context)
    servo.Begin(context, None, at_rest=False)
    context.SetTime(0.0)
    assert offset(servo, context) == pytest.approx(before)
    servo.Begin(context, None, at_rest=True)
    assert offset(servo, context) == 0.0


def test_belief_narrows_to_what_explains_the_touch_and_moves_with_the_robot():
    belief = np.full(len(OFFSETS), 1.0 / len(OFFSETS))
    expected = 4.0 - 40.0 * OFFSETS  # one place for each strength
    for _ in range(50):
        belief = corrected(belief, 3.6, expected, 0.01)
    assert OFFSETS @ belief == pytest.approx(0.01, abs=0.004)
    assert belief.sum() == pytest.approx(1.0)
    moved = shifted(belief, 0.02)
    assert OFFSETS @ moved == pytest.approx(OFFSETS @ belief + 0.02, abs=0.004)
