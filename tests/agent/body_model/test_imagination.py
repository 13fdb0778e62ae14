"""Plans over an imagined skin: a cube's arm whose body model is the true one."""

import dataclasses

import numpy as np
import pytest
from modelled import true_model
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body_model import own_parts
from selftouch_drake.agent.body_model.chain import derivatives, slopes
from selftouch_drake.agent.body_model.imagination import Imagination, Leg
from selftouch_drake.agent.body_model.lift import Lifter
from selftouch_drake.agent.body_model.model import independent
from selftouch_drake.agent.body_model.own_parts import OwnParts
from selftouch_drake.agent.body_model.reach import Reach
from selftouch_drake.agent.body_model.roadmap import Roadmap
from selftouch_drake.agent.body_model.surface import _smooth, evenly, touched_surfaces
from selftouch_drake.agent.body_model.taut import pulled_taut
from selftouch_drake.agent.memory import RehearsalMemory
from selftouch_drake.agent.practice import practise
from selftouch_drake.agent.practice.sliding import Slider
from selftouch_drake.agent.representation.touches import felt_kernels
from selftouch_drake.bodies.drake import DrakeBodies
from selftouch_drake.evaluation.shape import kernel_truth
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.quotient.smooth import KNOT_SPACING
from selftouch_drake.run.artifacts import load_representation, stored_sensations
from selftouch_drake.run.directory import RunDirectory


@pytest.fixture(scope="module")
def cube(finished_run, cube_world):
    """The representation of a small run of the cube, its true body model, and its sensations."""
    run = RunDirectory.open(finished_run)
    representation = load_representation(run)
    contacts = ExperienceReader(run.truth).take_contacts(representation.kernel_row)
    truth = kernel_truth(representation, contacts, cube_world.receptor_skin)
    model = true_model(cube_world, representation, truth)
    return representation, model, stored_sensations(run, representation)


@pytest.fixture(scope="module")
def imagination(cube):
    representation, model, sensation = cube
    return Imagination(model, representation, knot_spacing=KNOT_SPACING, kernel_sensation=sensation)


@pytest.fixture(scope="module")
def still(cube_world):
    return DrakeBodies(cube_world).still


def starts(representation, num, seed=0):
    """Random pairs of targets, and a configuration of the first."""
    random = np.random.default_rng(seed)
    for _ in range(num):
        start, goal = random.choice(representation.num_targets, 2, replace=False).tolist()
        members = representation.kernel_q[representation.members(start)]
        yield members[random.integers(len(members))].astype(float), start, goal


def test_slopes_are_those_of_the_derivatives():
    random = np.random.default_rng(0)
    q, twists = random.normal(size=(20, 5)), random.normal(size=(5, 6))
    twists[2, :3] = 0.0
    signs, point = np.array([-1.0, -1.0, 1.0, 1.0, 1.0]), random.normal(size=3)
    place, by_q, turn = slopes(q, twists, point, signs)
    expected_place, _, expected_turn, expected = derivatives(q, twists, point, signs)
    np.testing.assert_allclose(place, expected_place)
    np.testing.assert_allclose(by_q, expected)
    np.testing.assert_allclose(turn, expected_turn)


@pytest.mark.parametrize("shape", [np.zeros(5), [0.2, -0.1, 0.05, 0.0, 0.1]], ids=["point", "fist"])
def test_a_reach_is_where_the_model_has_the_toucher(cube, shape):
    representation, model, _ = cube
    normal = np.tile([0.0, 0.6, 0.8], (representation.num_targets, 1))
    model = dataclasses.replace(
        model, toucher_shape=np.atleast_2d(shape).astype(float), kernel_normal=normal
    )
    q = representation.kernel_q[:50].astype(float)
    found, by_q = Reach.of(model, 0, 0).places(q, normal[:50])
    np.testing.assert_allclose(found, model.place(q, np.zeros(50, dtype=int)), atol=1e-9)
    if not np.any(shape):
        more = q.copy()
        more[:, 1] += 1e-6
        moved = Reach.of(model, 0, 0).places(more, normal[:50])[0]
        np.testing.assert_allclose(by_q[:, :, 1], (moved - found) / 1e-6, atol=1e-4)


def test_ways_over_the_skin_are_short_and_stay_on_it(cube):
    representation, model, _ = cube
    (surface,) = touched_surfaces(model, representation)
    first, last = surface.node[[0, -1]]
    way = surface.way(first, last, 50)
    on_it, normal = surface.projected(way[1:-1])
    assert np.linalg.norm(way[1:-1] - on_it, axis=1).max() < 0.05 * surface.spacing
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0)
    # Normals look away from the middle of a cube.
    away = on_it - surface.node.mean(axis=0)
    assert (np.einsum("na,na->n", away, normal) > 0).all()
    length = np.linalg.norm(np.diff(way, axis=0), axis=1)
    assert np.ptp(length) < 0.1 * length.mean()
    straight = np.linalg.norm(last - first)
    assert straight <= length.sum() < 2.1 * straight
    apart = dataclasses.replace(surface, graph=csr_array(surface.graph.shape))
    assert apart.way(first, last, 50) is None


def test_a_place_beyond_the_touches_is_not_on_the_skin(cube):
    representation, model, _ = cube
    (surface,) = touched_surfaces(model, representation)
    flat = np.stack([*map(np.ravel, np.mgrid[:20, :20] / 2.0), np.zeros(400)], axis=1)
    patch = dataclasses.replace(
        surface, spacing=1.0, node=flat, normal=np.tile([0.0, 0.0, 1.0], (400, 1))
    )
    within = np.random.default_rng(0).uniform([0, 0, -0.1], [9.5, 9.5, 0.1], (500, 3))
    assert patch.beyond(within).max() == 0.0
    far = patch.beyond(np.array([[11.5, 5.0, 0.0], [5.0, -3.0, 0.1], [9.6, 5.0, 0.0]]))
    assert far == pytest.approx([2.0, 3.0, 0.0], abs=0.7)


def test_a_bent_surface_is_not_cut_short():
    random = np.random.default_rng(0)
    ball = random.standard_normal((800, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    near = cKDTree(ball).query(ball, k=10)[1]
    node, normal = _smooth(ball, near, np.zeros_like(ball), 0.5)
    middle = ball[near].mean(axis=1)
    below = 1 - np.einsum("ma,ma->m", middle, normal).mean()
    assert below > 0.005
    assert abs(np.linalg.norm(node, axis=1).mean() - 1) < 0.6 * below
    assert np.einsum("ma,ma->m", node, normal).min() > 0.9


def test_points_are_spread_evenly():
    way = evenly(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 3.0]]), 5)
    np.testing.assert_allclose(way, [[0, 0], [1, 0], [1, 1], [1, 2], [1, 3]])


def test_imagined_plans_keep_contact_though_nobody_followed_them(cube, imagination, still):
    representation, _, _ = cube
    contact, reached, errors = [], [], []
    for q, start, goal in starts(representation, 8):
        plan = imagination.plan(q, start, [goal])
        assert plan.is_imagined
        assert (plan.nodes[0], plan.goal) == (start, goal)
        np.testing.assert_allclose(plan.path(0.0), q, atol=1e-12)
        s = np.linspace(0.0, plan.waypoint_s[-1], 100)
        path = plan.path(s)
        assert (path >= representation.kernel_q.min(axis=0) - 1e-6).all()
        assert (path <= representation.kernel_q.max(axis=0) + 1e-6).all()
        felt = still.feel(path).sensation
        contact.append(felt.any(axis=1)[plan.touching(s)].mean())
        reached.append(goal in felt_kernels(representation, felt[-1]))
        predicted = imagination.predict(plan, s)
        known = felt.any(axis=1) & predicted.sensation.any(axis=1)
        unit = felt[known] / np.linalg.norm(felt[known], axis=1, keepdims=True)
        errors.append(1.0 - np.mean(np.sum(unit * predicted.sensation[known], axis=1)))
    # Sixty kernels of ten centimetres know a cube's edges but roughly.
    assert np.mean(contact) > 0.9
    assert np.mean(reached) >= 6 / 8
    assert np.mean(errors) < 0.05


def test_a_plan_says_what_may_go_wrong(cube, imagination, monkeypatch):
    leg = Leg(x=np.zeros((2, 6)), node=np.zeros(2, dtype=int))
    assert leg.good
    assert not leg.doubts
    worse = dataclasses.replace(leg, error=0.2, deep=0.1)
    assert worse.doubts == ("contact may be lost", "own parts may run into each other")
    assert not worse.good
    representation, _, _ = cube
    q, start, goal = next(starts(representation, 1))
    assert imagination.plan(q, start, [goal]).doubts == ()
    monkeypatch.setattr(Imagination, "_deep", lambda *_: 0.1)
    doubts = imagination.plan(q, start, [goal, start]).doubts
    assert doubts == ("own parts may run into each other",)


def test_pressure_makes_touches_stronger(cube, imagination, still):
    representation, _, _ = cube
    strength = np.zeros(2)
    for q, start, goal in starts(representation, 8):
        # Deeper than firm touches a hollow body is felt less: the tip is through its skin.
        for number, pressure in enumerate((-0.1, 0.0)):
            plan = imagination.plan(q, start, [goal], pressure=pressure)
            s = np.linspace(0.3, 1.0, 50) * plan.waypoint_s[-1]
            strength[number] += still.feel(plan.path(s)).sensation.sum()
    assert strength[1] > 1.1 * strength[0]


def test_several_goals_are_passed_in_order_and_a_goal_that_is_felt_needs_no_plan(cube, imagination):
    representation, _, _ = cube
    q, start, goal = next(starts(representation, 1, seed=3))
    other = (goal + 7) % representation.num_targets
    nodes = imagination.plan(q, start, [goal, other]).nodes.tolist()
    assert (nodes[0], nodes[-1]) == (start, other)
    assert goal in nodes[1:-1]
    assert imagination.plan(q, start, [start]) is None


def test_from_the_air_it_lands_and_slides(imagination, still):
    q = next(q for q in np.random.default_rng(1).normal(size=(50, 6)) if _apart(still, q))
    plan = imagination.plan(q, None, [5], limits=(np.full(6, -4.0), np.full(6, 4.0)))
    assert plan.nodes[0] == -1
    assert plan.in_air[0]
    assert not plan.in_air[-1] or len(plan.in_air) == 1
    np.testing.assert_allclose(plan.path(0.0), q, atol=1e-12)
    assert still.feel(plan.path(plan.waypoint_s[-1:])).sensation.any()


def _apart(still, q):
    return not still.feel(q[None]).sensation.any()


def test_on_a_part_whose_model_was_rejected_nothing_is_imagined(cube):
    representation, model, _ = cube
    rejected = dataclasses.replace(model, accepted_by_part=np.zeros(1, dtype=bool))
    assert Agent.of(representation, body_model=rejected).imagination is None
    paper = Agent.of(representation)
    q, start, goal = next(starts(representation, 1))
    expected = paper.plan(start, goal, q_start=q)
    found = Agent.of(representation, body_model=rejected).plan(start, goal, q_start=q)
    np.testing.assert_array_equal(found.waypoints_q, expected.waypoints_q)
    assert not expected.is_imagined


def test_the_agent_imagines_where_it_has_a_model_and_can_do_without(cube):
    representation, model, _ = cube
    agent = Agent.of(representation, body_model=model)
    q, start, goal = next(starts(representation, 1))
    assert agent.plan(start, goal, q_start=q).is_imagined
    assert not agent.without_model().plan(start, goal, q_start=q).is_imagined
    assert not agent.plan(start, goal, q_start=q, lift_off=True).is_imagined
    with pytest.raises(ValueError, match=r"^target 99 is out of range"):
        agent.plan(start, 99, q_start=q)
    wiser = agent.recalling(agent.memory.pressing())
    assert wiser.imagination is agent.imagination
    deeper = wiser.plan(start, goal, q_start=q)
    assert not np.array_equal(deeper.waypoints_q, agent.plan(start, goal, q_start=q).waypoints_q)


def test_practice_checks_an_imagined_plan_and_leaves_it(cube, still):
    representation, model, _ = cube
    agent = Agent.of(representation, body_model=model)
    slider = Slider(still, representation.joint_scale)
    kept = 0
    for q, start, goal in starts(representation, 4, seed=5):
        found = practise(agent, slider, [start, goal], q_start=q)
        kept += found.plan is found.unpractised
        assert found.agent.body_model is model
    assert kept >= 2


def test_what_practice_finds_wrong_is_pressed_more_then_planned_as_the_paper_does(cube, still):
    representation, model, _ = cube
    slider = Slider(still, representation.joint_scale)
    q, start, goal = next(starts(representation, 1, seed=5))
    # A finger that is far from where the model has it; it still knows ways over that skin, and does
    # not only lift off and land, which no error of the model spoils.
    wrong = dataclasses.replace(model, toucher_place=model.toucher_place + 1.0)
    agent = Agent.of(representation, body_model=wrong)
    imagined = agent.plan(start, goal, q_start=q)
    assert imagined.is_imagined
    assert not imagined.in_air.any()
    found = practise(agent, slider, [start, goal], q_start=q)
    paper = practise(agent.without_model(), slider, [start, goal], q_start=q)
    assert found.agent.body_model is wrong
    np.testing.assert_array_equal(found.plan.waypoints_q, paper.plan.waypoints_q)
    np.testing.assert_array_equal(found.agent.memory.link_penalty, paper.agent.memory.link_penalty)


def test_after_a_loss_imagined_plans_press_more_up_to_a_limit(cube):
    representation, model, _ = cube
    memory = Agent.of(representation, body_model=model).memory
    pressures = [memory.pressure]
    for _ in range(4):
        memory = memory.pressing()
        pressures.append(memory.pressure)
    assert pressures == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.3])
    assert memory.same_as(memory.pressing())
    again = RehearsalMemory.restored(memory.to_arrays(), representation)
    assert again.pressure == memory.pressure
    with pytest.raises(ValueError, match=r"^pressure is 7, expected 0 to 0.3$"):
        RehearsalMemory.restored(memory.to_arrays() | {"pressure": np.array(7.0)}, representation)
    older = {key: value for key, value in memory.to_arrays().items() if key != "pressure"}
    assert RehearsalMemory.restored(older, representation).pressure == 0.0


def test_a_roadmap_joins_lived_postures_by_steps_on_the_skin(cube, still):
    representation, model, _ = cube
    (surface,) = touched_surfaces(model, representation)
    x = representation.scaled(representation.kernel_q[surface.row]).astype(float)
    lifter = Lifter(
        surface=surface,
        scale=representation.joint_scale,
        lower=x.min(axis=0),
        upper=x.max(axis=0),
    )
    roadmap = Roadmap(lifter, x[surface.firm], np.random.default_rng(0))
    way = roadmap.way(x[0], x[-5:])
    assert np.array_equal(way[0], x[0])
    off = lifter.centres(way[1:])
    assert np.linalg.norm(off - surface.projected(off)[0], axis=1).max() < 0.2 * surface.spacing
    assert np.linalg.norm(np.diff(way, axis=0), axis=1).max() < 1.0
    # Where own parts would be too deep it goes another way, if there is one.
    middle = way[len(way) // 2]

    def near_middle(x):
        return np.linalg.norm(x - middle, axis=1) < 0.3

    assert near_middle(way).any()
    assert not near_middle(roadmap.way(x[0], x[-5:], near_middle)).any()
    assert roadmap.way(x[0], x[-5:], lambda x: np.ones(len(x), dtype=bool)) is not None
    # What it tried it remembers: the same way again.
    assert np.array_equal(roadmap.way(x[0], x[-5:]), way)
    # A posture far from all that was lived has no step to the others.
    assert roadmap.way(x[0] + 9.0, x[-5:]) is None


def test_a_motion_pulled_taut_is_shorter_on_the_skin_and_stays_on_it(cube):
    representation, model, _ = cube
    (surface,) = touched_surfaces(model, representation)
    lifter = lifter_of(surface, representation)
    x = representation.scaled(representation.kernel_q[surface.row[surface.firm]]).astype(float)
    # By way of a touch elsewhere.
    far = np.linalg.norm(x - x[0], axis=1).argmax()
    there = evenly(surface.way(*lifter.centres(x[[0, far]]), 40), 40)
    back = surface.way(there[-1], lifter.centres(x[:1])[0] + 2.0 * surface.spacing, 40)
    wandering = lifter.followed(x[0], lifter.over(np.concatenate([there, back[1:]])))
    taut = pulled_taut(lifter, wandering, surface.projected(back[-1:])[0][0])

    def length(x):
        at = lifter.centres(x)
        return np.linalg.norm(np.diff(at, axis=0), axis=1).sum()

    assert length(taut) < 0.7 * length(wandering)
    assert np.array_equal(taut[0], wandering[0])
    at = lifter.centres(taut[1:])
    assert np.linalg.norm(at - surface.projected(at)[0], axis=1).max() < 0.1 * surface.spacing
    assert np.linalg.norm(at[-1] - surface.projected(back[-1:])[0][0]) < 0.3 * surface.spacing


def test_following_a_way_puts_each_posture_near_the_one_before(cube):
    representation, model, _ = cube
    (surface,) = touched_surfaces(model, representation)
    lifter = lifter_of(surface, representation)
    x = representation.scaled(representation.kernel_q[surface.row[0]]).astype(float)
    way = lifter.over(surface.way(lifter.centres(x[None])[0], surface.node[-1], 30))
    followed = [x]
    for place, normal in zip(way.place[1:], way.normal[1:], strict=True):
        followed.append(lifter.put(followed[-1][None], place[None], normal[None], steps=3)[0])
    np.testing.assert_allclose(lifter.followed(x, way), followed, atol=1e-12)


def test_own_parts_may_be_as_deep_in_each_other_as_they_have_been(cube, monkeypatch):
    representation, model, _ = cube
    surfaces = touched_surfaces(model, representation)
    # What always touches says nothing about own parts.
    q = representation.kernel_q[:5].astype(float)
    own = OwnParts.of(model, representation, surfaces)
    assert np.isneginf(own.excess(q)).all()
    assert not own.pushes(q, 9.0)[0].any()
    monkeypatch.setattr(own_parts, "_ALWAYS", 1.0)
    own = OwnParts.of(model, representation, surfaces)
    (surface,) = surfaces
    past = representation.kernel_q[::7].astype(float)
    assert own.excess(past).max() <= 0.01
    # The fingertip far below the skin.
    lifter = lifter_of(surface, representation)
    x = representation.scaled(past[:20]).astype(float)
    at, normal = surface.projected(lifter.centres(x))
    deep = lifter.put(x, at - 1.2 * surface.spacing * normal, normal)
    assert np.median(own.excess(deep / representation.joint_scale)) > 0.3
    away = lifter.put(x, at + 1.0 * surface.spacing * normal, normal)
    assert own.excess(away / representation.joint_scale).max() < 0.0


def test_own_parts_push_each_other_away(cube, monkeypatch):
    representation, model, _ = cube
    monkeypatch.setattr(own_parts, "_ALWAYS", 1.0)
    surfaces = touched_surfaces(model, representation)
    own, lifter = OwnParts.of(model, representation, surfaces), lifter_of(*surfaces, representation)
    q = representation.kernel_q[::40].astype(float)
    margin = 0.4
    cost, slope, square = own.pushes(q, margin)
    assert (cost > 0).any()
    assert np.array_equal(cost > 0, own.excess(q) > -margin)
    # Those that come near on a motion push as all do, and far from the skin none does.
    assert np.array_equal(own.near(q).pushes(q, margin)[0], cost)
    none = far_away(own).near(q)
    assert not none.pushes(q, margin)[0].any()
    assert np.isneginf(none.excess(q)).all()
    for joint in range(q.shape[1]):
        step = np.zeros(q.shape[1])
        step[joint] = 1e-6
        change = own.pushes(q + step, margin)[0] - own.pushes(q - step, margin)[0]
        # Corners of the field, and another ball that becomes the worst, have two slopes.
        off = np.abs(change / 4e-6 - slope[:, joint])
        assert np.quantile(off, 0.9) < 1e-4 * max(1.0, np.abs(slope[:, joint]).max())
    assert np.allclose(square, square.transpose(0, 2, 1))
    # A motion that goes too deep is pushed out of there, and stays at the skin.
    x = representation.scaled(q[np.argmax(cost)])[None] + np.zeros((20, 1))
    (surface,) = surfaces
    place = surface.projected(lifter.centres(x))[0]
    way = lifter.over(place)
    way = dataclasses.replace(way, place=place - 0.8 * surface.spacing * way.normal, across=0.2)
    free, pushed = lifter.smoothed(x, way), lifter.smoothed(x, way, own)

    def deepest(motion):
        return own.excess(motion[1:] / representation.joint_scale).max()

    assert deepest(pushed) < deepest(free) - 0.05


def far_away(own):
    """Own parts whose balls are far from where they were."""
    balls, around = own.meetings.balls.copy(), own.meetings.around.copy()
    balls[:, 0] = around[:, 0] = 1e3
    return dataclasses.replace(own, meetings=own.meetings._replace(balls=balls, around=around))


def lifter_of(surface, representation):
    return Lifter(
        surface=surface,
        scale=representation.joint_scale,
        lower=np.full(6, -50.0),
        upper=np.full(6, 50.0),
    )


def with_touchers(model, link):
    """A model whose toucher is several, each on a link and at the place of the first."""
    number = len(link)
    touched = np.arange(len(model.kernel_toucher)) % number
    return dataclasses.replace(
        model,
        toucher_link=np.array(link),
        toucher_place=np.repeat(model.toucher_place, number, axis=0),
        toucher_shape=np.repeat(model.toucher_shape, number, axis=0),
        kernel_toucher=np.where(model.kernel_toucher < 0, -1, touched),
        covariance=independent(model.twist_sigma, number),
    )


def hand_of_three(cube):
    """Imagination of a model whose fingertip is three points, each of a third of the touches."""
    representation, model, sensation = cube
    hand = with_touchers(model, [int(model.toucher_link[0])] * 3)
    return Imagination(hand, representation, knot_spacing=KNOT_SPACING, kernel_sensation=sensation)


def test_three_points_of_a_link_are_one_hand(cube):
    _, model, _ = cube
    hand = with_touchers(model, [4, 2, 5, 4, 5, 4]).hand_of_toucher
    assert hand[0] == hand[3] == hand[5]
    assert len(set(hand.tolist())) == 4


def test_a_hand_ends_where_its_goal_was_felt_and_keeps_contact(cube, still):
    representation, _, _ = cube
    imagination = hand_of_three(cube)
    for q, start, goal in starts(representation, 5):
        plan = imagination.plan(q, start, [goal])
        s = np.linspace(0.0, 1.0, 60) * plan.waypoint_s[-1]
        if not plan.in_air.any():
            assert "a hand that is no point may be too deep, or too high" in plan.doubts
            assert still.feel(plan.path(s)).sensation.any(axis=1).mean() > 0.98
        own = representation.kernel_q[representation.members(goal)]
        assert np.abs(own - plan.path(s[-1:])).max(axis=1).min() < 1e-3


def test_a_hand_is_pressed_as_deep_as_it_is_asked_to(cube):
    representation, _, _ = cube
    imagination = hand_of_three(cube)
    hand = imagination._hand(imagination._lifter(imagination.surfaces[0]))
    for q, start, goal in starts(representation, 3):
        for pressure in (0.0, 0.1):
            plan = imagination.plan(q, start, [goal], pressure=pressure)
            x = representation.scaled(plan.path(np.linspace(0.3, 0.8, 30) * plan.waypoint_s[-1]))
            np.testing.assert_allclose(hand.above(x)[0].mean(), -pressure, atol=0.03)


def test_a_hand_is_as_high_as_in_touches_in_like_poses(cube):
    representation, _, _ = cube
    imagination = hand_of_three(cube)
    skin = imagination._lifter(imagination.surfaces[0])
    hand = imagination._hand(skin)
    x = representation.scaled(representation.kernel_q[::50]).astype(float)
    high, above_deep = hand.above(x)
    assert np.abs(np.median(high)) < 0.1
    assert above_deep.mean() > 0.0
    at, normal = skin.surface.projected(skin.centres(x))
    deeper = hand.above(skin.put(x, at - 0.5 * skin.surface.spacing * normal, normal))
    assert np.median(deeper[0]) < -0.3
    assert np.median(deeper[1]) < 0.0


def test_without_kernels_that_are_known_there_is_no_surface(cube):
    representation, model, _ = cube
    lost = dataclasses.replace(model, kernel_place=np.full_like(model.kernel_place, np.nan))
    assert touched_surfaces(lost, representation) == []
    assert touched_surfaces(model, representation)[0].kernel_at(
        model.kernel_place[:3]
    ).tolist() == [
        0,
        1,
        2,
    ]
