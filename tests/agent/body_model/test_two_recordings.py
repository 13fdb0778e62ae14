"""Two recordings of one body: what differs is said, and nothing where nothing does."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_chains import ArmOnBall
from made_up import made_up_model

from selftouch_drake.agent.body_model.chain import adjoint
from selftouch_drake.agent.body_model.chain_change import Change
from selftouch_drake.agent.body_model.model import BASE, JointKind
from selftouch_drake.agent.body_model.two_recordings import (
    Touches,
    chain_between,
    changed_between,
)

NAMES = tuple(f"{side} {joint}" for side in ("left", "right") for joint in range(4))
NUMBER = 300


class TwoArms:
    """Two arms that touch one ball, one of them at a time."""

    def __init__(self):
        self.arms = [ArmOnBall(), ArmOnBall()]
        # The right one reaches the ball from elsewhere.
        turn = np.eye(4)
        turn[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
        turn[:3, 3] = self.arms[1].center - turn[:3, :3] @ self.arms[1].center
        self.move(1, 0, turn)

    def move(self, arm, place, motion):
        """Moves an arm, from a joint on, by a rigid motion."""
        one = self.arms[arm]
        one.twists[place:] = adjoint(motion, one.twists[place:])
        one.point = motion[:3, :3] @ one.point + motion[:3, 3]

    def touches(self, number, seed):
        """As many touches of each arm; the other one is anywhere."""
        random = np.random.default_rng(seed)
        q, felt = [], []
        for arm, one in enumerate(self.arms):
            own, sensation = one.touches(number, seed=int(random.integers(2**31)))
            other = random.uniform(-1.5, 1.5, own.shape)
            q.append(np.hstack([own, other] if arm == 0 else [other, own]))
            felt.append(sensation)
        sensation = np.concatenate(felt)
        return Touches(np.concatenate(q), sensation, sensation.argmax(axis=1))

    def model(self):
        """What an agent that knows it all knows: a kernel for each receptor."""
        ball = self.arms[0]
        place = ball.center + ball.radius * ball.receptors
        number, joints = len(place), len(NAMES)
        of_part = {"held_out": 0.97, "inliers": 0.99, "criterion": -12.0}
        return made_up_model(
            joint_names=NAMES,
            joint_parent=np.array([BASE, 0, 1, 2, BASE, 4, 5, 6]),
            joint_kind=np.full(joints, int(JointKind.TURNS)),
            order_group=np.full(joints, -1),
            twists=np.concatenate([arm.twists for arm in self.arms]),
            twist_sigma=np.full((joints, 6), 0.001),
            part_link=np.array([BASE]),
            toucher_link=np.array([3, 7]),
            toucher_place=np.stack([arm.point for arm in self.arms]),
            toucher_shape=np.zeros((2, 5)),
            kernel_part=np.zeros(number, dtype=int),
            kernel_place=place,
            kernel_normal=ball.receptors,
            receptor_part=np.zeros(number, dtype=int),
            receptor_place=place,
            receptor_normal=ball.receptors,
            receptor_sigma=np.full(number, 0.01),
            accepted_by_part=np.array([True]),
            num_touches=np.array([3000]),
            **{name: np.array([value]) for name, value in of_part.items()},
        )


@pytest.fixture(scope="module")
def monday():
    body = TwoArms()
    return body.model(), body.touches(NUMBER, seed=1)


def bent(arm, place):
    """Two arms, one of which is bent before a joint by three degrees."""
    body, motion, a = TwoArms(), np.eye(4), 0.06
    motion[1:3, 1:3] = [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
    body.move(arm, place, motion)
    return body


def test_of_one_body_nothing_is_said(monday):
    found = [
        pair.change
        for seed in range(10, 15)
        for pair in changed_between(*monday, TwoArms().touches(100, seed))
    ]
    assert found == [None] * 10


@pytest.mark.parametrize("arm", [0, 1])
def test_a_bent_link_is_said_by_what_its_arm_touches(monday, arm):
    pairs = changed_between(*monday, bent(arm, 2).touches(100, seed=10))
    assert [(pair.part, pair.toucher) for pair in pairs] == [(0, 0), (0, 1)]
    assert pairs[1 - arm].change is None
    (part,) = pairs[arm].change.parts
    assert (part.kind, part.joint) == (Change.BENT_LINK, 4 * arm + 1)
    # Its error is what it says.
    turn, error = np.linalg.norm(part.amount[:3]), np.linalg.norm(part.sigma[:3])
    assert abs(turn - 0.06) < 3 * error < 0.06
    assert pairs[arm].change.said(NAMES).startswith(f"the link after joint {NAMES[4 * arm + 1]}")


def test_what_was_hardly_touched_is_left_out(monday):
    model, before = monday
    after = TwoArms().touches(100, seed=10)
    assert len(changed_between(model, before, after.some(np.arange(130)))) == 1
    assert changed_between(model, before.some(np.arange(100)), after) == []
    few = replace(model, num_touches=np.array([100]))
    assert changed_between(few, before, after) == []


def test_the_chain_to_a_toucher_is_that_of_the_model(monday):
    model, (q, sensation, target) = monday
    toucher = model.touched_by(q, target)
    assert np.mean(toucher == np.repeat([0, 1], NUMBER)) > 0.99
    for arm in range(2):
        rows = toucher == arm
        known = chain_between(model, 0, arm, q[rows], sensation[rows])
        np.testing.assert_allclose(known.places(q[rows]), model.place(q[rows], target[rows]))
