import dataclasses

import numpy as np
import pytest
from scipy.sparse import issparse
from skins import SHAPES, readings, receptors, touch

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.motions import NO_KERNEL, Execution
from selftouch_drake.agent.representation.estimator import QuotientLearner
from selftouch_drake.agent.representation.touches import felt_kernels
from selftouch_drake.agent.tries import judged_try

NUM_ROWS = 24_000
#: Where parts and places alone are asked for.
ONLY_PLACES = pytest.mark.usefixtures("without_networks")


@pytest.fixture(scope="module")
def experience():
    return touch(["sphere", "tube"], NUM_ROWS)


@pytest.fixture(scope="module")
def agent(experience):
    q, sensation, _, _ = experience
    return Agent.learn(q, sensation, num_targets=240, seed=0)


def learned(q, sensation, num_targets):
    """What an agent learns, without what it takes to plan."""
    return QuotientLearner(num_targets).fit(sensation, q).representation_


def on_part(agent, part, count, seed=0):
    kernels = np.flatnonzero(agent.representation.part == part)
    return np.random.default_rng(seed).choice(kernels, count, replace=False).tolist()


def felt_by(q):
    """Sensations as in `touch`; null farther than 0.1 from both skins."""
    place, parts = q[:, :3].astype(float), []
    for number, shape in enumerate(SHAPES[name] for name in ("sphere", "tube")):
        at = place - 6.0 * number * np.array([1.0, 0.0, 0.0])
        off = np.linalg.norm(at if number == 0 else at[:, :2], axis=1) - 1.0
        near = (np.abs(off) < 0.1) & (np.abs(at[:, 2]) < 1.1)
        name = "sphere" if shape is SHAPES["sphere"] else "tube"
        parts.append(readings(at, receptors(name, 60), 0.75) * near[:, None])
    return np.concatenate(parts, axis=1)


def carried_out(agent, plan, num=400):
    s = np.linspace(0.0, plan.waypoint_s[-1], num)
    q, v = plan.path(s), np.zeros((num, plan.waypoints_q.shape[1]))
    motion = agent.motion(plan, time_s=s, s=s, q=q, v=v)
    return Execution(motion=motion, felt=felt_by(q), q_measured=q, v_measured=v, torque=v)


def test_an_agent_learns_recovers_plans_and_remembers(agent):
    assert agent.representation.num_targets == 240
    body = agent.recover("sensorimotor")
    assert [part.topology.betti for part in body.parts] in (
        [(1, 0, 1), (1, 1, 0)],
        [(1, 1, 0), (1, 0, 1)],
    )
    assert np.isfinite(body.embed(agent.representation).embedding).all()

    start, goal = on_part(agent, 0, 2)
    plan = agent.plan(start, goal)
    assert (plan.nodes[0], plan.goal) == (start, goal)
    assert not plan.in_air.any()
    before = agent.memory.link_penalty.copy()
    wiser = agent.recalling(agent.memory.after(plan.links))
    assert np.array_equal(agent.memory.link_penalty, before)
    assert (wiser.memory.link_penalty[plan.links] == 8.0).all()
    assert wiser.planner is agent.planner
    other = wiser.plan(start, goal, q_start=plan.waypoints_q[0])
    again = set(other.links) & set(plan.links)
    assert len(again) <= len(plan.links) // 4 or len(plan.links) == 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        agent.memory = None


def test_who_remembers_otherwise_shares_the_planner_which_is_built_when_one_plans(agent):
    first = Agent.of(agent.representation)
    wiser = first.recalling(first.memory.after(np.array([0])))
    wisest = wiser.recalling(wiser.memory.after(np.array([1])))
    for one in (first, wiser, wisest):
        assert not {"planner", "imagination"} & vars(one).keys()
    assert wisest.planner is first.planner is wiser.planner
    assert wisest.imagination is None


def test_planned_motions_stay_on_the_skin_and_feel_as_predicted(agent):
    for seed in range(6):
        start, goal = on_part(agent, seed % 2, 2, seed)
        execution = carried_out(agent, agent.plan(start, goal))
        assert execution.contact > 0.9
        one = judged_try(execution, agent.representation)
        assert one.reached
        felt, predicted = execution.felt, execution.motion.predicted
        rows = felt.any(axis=1)
        felt = felt[rows] / np.linalg.norm(felt[rows], axis=1, keepdims=True)
        assert np.mean(1.0 - np.sum(felt * predicted[rows], axis=1)) < 0.05


def test_between_parts_the_agent_lifts_off_and_lands_again(agent):
    (start,), (goal,) = on_part(agent, 0, 1, seed=3), on_part(agent, 1, 1, seed=3)
    plan = agent.plan(start, goal)
    (air,) = np.flatnonzero(plan.in_air)
    part = agent.representation.part
    left, landed = plan.nodes[air : air + 2]
    assert part[left] == part[start]
    assert part[landed] == part[goal]
    assert plan.links[air] == -1
    assert (np.delete(plan.links, air) >= 0).all()
    # It flies straight to the nearest firm touch on the other skin.
    step = np.linalg.norm(np.diff(plan.waypoints_q[air : air + 2], axis=0))
    assert 2.0 < step < 8.0
    execution = carried_out(agent, plan)
    touching = execution.motion.touching
    assert 0 < touching.sum() < len(touching)
    assert not execution.motion.predicted[~touching].any()
    assert execution.motion.predicted[touching].any(axis=1).all()
    # Steps in the air do not count as lost contact.
    assert execution.contact > 0.9 > execution.felt.any(axis=1).mean()
    assert judged_try(execution, agent.representation).reached


def test_a_tour_may_leave_a_part_and_come_back(agent):
    (a, b), (c,) = on_part(agent, 0, 2), on_part(agent, 1, 1)
    plan = agent.plan(a, c, b)
    assert plan.in_air.sum() == 2
    assert [n for n in plan.nodes if n in (a, b, c)] == [a, c, b] or c in plan.nodes


@pytest.mark.parametrize("part", [0, 1])
def test_a_free_start_lands_on_the_part_of_its_goal(agent, part):
    (goal,) = on_part(agent, part, 1)
    q_start = np.array([3.0, 0.0, 2.0, 0.0, 0.0])
    plan = agent.plan(None, goal, q_start=q_start)
    assert plan.nodes[0] == NO_KERNEL
    assert plan.in_air.tolist() == [True] + [False] * (len(plan.links) - 1)
    assert agent.representation.part[plan.nodes[1]] == part
    assert np.array_equal(plan.waypoints_q[0], q_start)


def test_a_plan_from_a_touch_begins_with_what_is_felt(agent, experience):
    q, sensation, _, _ = experience
    start = agent.target_felt(sensation[7])
    goal = int(np.flatnonzero(agent.representation.part == agent.representation.part[start])[3])
    assert agent.plan(start, goal, q_start=q[7]).nodes[0] == start
    with pytest.raises(ValueError, match="limits of the joint"):
        agent.plan(start, goal, q_start=q[7], limits=(np.full(5, 50.0), np.full(5, 60.0)))


def test_nothing_felt_needs_a_configuration(agent):
    assert agent.target_felt(np.zeros(120)) is None
    with pytest.raises(ValueError, match=r"^q_start is missing"):
        agent.plan(None, 3)


def test_it_keeps_what_was_felt_at_each_configuration(agent, experience):
    _, sensation, _, _ = experience
    assert issparse(agent.kernel_sensation)
    row = agent.representation.kernel_row[11]
    felt = sensation[row] / np.linalg.norm(sensation[row])
    np.testing.assert_allclose(agent.kernel_sensation[[11]].toarray()[0], felt, rtol=1e-5)


def test_another_unit_of_a_joint_changes_nothing_but_the_unit(agent, experience):
    q, sensation, _, _ = experience
    unit = np.array([1.0, 1000.0, 0.2, 5.0, 1.0], dtype=np.float32)
    other = Agent.learn(unit * q, sensation, num_targets=240, seed=0)
    ours, theirs = agent.representation, other.representation
    np.testing.assert_allclose(theirs.joint_scale * unit, ours.joint_scale, rtol=1e-3)
    np.testing.assert_array_equal(theirs.kernel_row, ours.kernel_row)
    np.testing.assert_allclose(theirs.set_distance, ours.set_distance, rtol=1e-3, atol=1e-4)
    start, goal = on_part(agent, 0, 2)
    here, there = agent.plan(start, goal), other.plan(start, goal)
    np.testing.assert_array_equal(there.nodes, here.nodes)
    np.testing.assert_allclose(there.waypoint_s, here.waypoint_s, rtol=1e-3)
    s = np.linspace(0.0, min(here.waypoint_s[-1], there.waypoint_s[-1]), 50)
    np.testing.assert_allclose(there.path(s) / unit, here.path(s), atol=1e-2)


@ONLY_PLACES
def test_two_hands_that_rarely_touch_at_once_are_separated():
    q, sensation, skin, _ = touch(["sphere", "tube", "cap"], 12_000, double=0.03, seed=1)
    agent = Agent.learn(q, sensation, num_targets=200)
    representation = agent.representation
    assert representation.num_parts == 3
    # A ninth of the second touches coincides with the first.
    assert 0.02 < representation.num_set_aside / representation.num_touches < 0.032
    # No target sensation mixes two touches.
    for kernel in range(200):
        assert len(np.unique(skin[representation.kernel_row[representation.members(kernel)]])) == 1
    both = sensation[:, :60].any(axis=1) & sensation[:, 60:120].any(axis=1)
    kernels = felt_kernels(representation, sensation[both][0])
    assert len(set(representation.part[kernels])) == 2
    assert agent.target_felt(sensation[both][0]) == kernels[0]


@ONLY_PLACES
def test_two_touches_that_are_the_rule_are_kept():
    q, sensation, _, _ = touch(["sphere"], 12_000, double=0.5)
    representation = learned(q, sensation, 200)
    assert representation.num_set_aside == 0
    assert representation.num_parts == 1


@ONLY_PLACES
def test_a_touch_of_a_hand_with_skin_counts_for_both_places():
    q, sensation, skin, place = touch(["sphere", "tube"], 16_000, hand="cap")
    agent = Agent.learn(q, sensation, num_targets=240)
    known = agent.representation
    assert known.num_parts == 3
    assert known.num_set_aside == 0
    of_receptor = known.target_sensations.argmax(axis=1) // 60
    of_part = [np.unique(of_receptor[known.part == part]).tolist() for part in range(3)]
    assert sorted(of_part) == [[0], [1], [2]]
    # A touch is a member of a kernel of the hand, and of one of what it pressed.
    rows = [known.kernel_row[known.members(kernel)] for kernel in range(240)]
    on = [np.concatenate([rows[k] for k in np.flatnonzero(of_receptor == n)]) for n in range(3)]
    assert not np.intersect1d(on[0], on[1]).size
    assert np.intersect1d(on[2], np.concatenate(on[:2])).size > 0.95 * len(q)
    # Each place is as the skin alone would tell it.
    for number in (0, 1):
        here = np.flatnonzero(of_receptor == number)
        assert (skin[on[number]] == number).all()
        assert np.median([np.linalg.norm(place[rows[k]].std(axis=0)) for k in here]) < 0.25
    both = felt_kernels(known, sensation[0])
    assert {2, skin[0]} == set(of_receptor[both])
    body = agent.recover("sensorimotor")
    holes = {of_part[n][0]: part.topology.betti for n, part in enumerate(body.parts)}
    assert holes == {0: (1, 0, 1), 1: (1, 1, 0), 2: (1, 0, 0)}


@ONLY_PLACES
def test_touches_that_run_from_skin_to_skin_join_them():
    # Two halves of one sphere, each with its own receptors.
    q, sensation, _, _ = touch(["sphere"], 12_000)
    order = np.argsort(receptors("sphere", 60)[:, 2])
    representation = learned(q, sensation[:, order], 100)
    assert representation.num_parts == 1
    assert representation.num_set_aside == 0


@ONLY_PLACES
@pytest.mark.parametrize("noise", ["multiplied", "dead", "added"])
def test_a_skin_with_flaws_is_one_part(noise):
    q, sensation, _, _ = touch(["sphere"], 20_000, num_receptors=100, width=0.5)
    rng = np.random.default_rng(0)
    if noise == "multiplied":
        sensation = sensation * rng.normal(1.0, 0.05, sensation.shape)
    elif noise == "dead":
        sensation = sensation * (rng.random(100) > 0.05)
    else:
        sensation = sensation + rng.normal(0.0, 0.01, sensation.shape)
        sensation = np.where(sensation > 0.06, sensation, 0.0)
    kept = sensation.any(axis=1)
    representation = learned(q[kept], np.maximum(sensation[kept], 0.0), 100)
    assert representation.num_parts == 1
    assert np.mean(representation.part == 0) == 1.0
    assert representation.num_set_aside / representation.num_touches < 0.001
