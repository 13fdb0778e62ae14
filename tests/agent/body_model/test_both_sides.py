"""Bodies from touches that both skins feel, on a small body with two arms."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from two_sided import LAYOUT, LEFT, RIGHT, arm_places, axes, recordings, trunk_places

from selftouch_drake.agent.body_model.both_sides.descent import losses
from selftouch_drake.agent.body_model.both_sides.finer import finer, moved_over
from selftouch_drake.agent.body_model.both_sides.finish import Cost, finished
from selftouch_drake.agent.body_model.both_sides.grain import learned_skin
from selftouch_drake.agent.body_model.both_sides.judgement import (
    Found,
    axes_apart,
    compared,
    gap_between,
)
from selftouch_drake.agent.body_model.both_sides.limbs import limbs_of, relevance
from selftouch_drake.agent.body_model.both_sides.orders import (
    OrderEffort,
    distinct,
    found_orders,
    settled,
)
from selftouch_drake.agent.body_model.both_sides.pairs import paired, senses
from selftouch_drake.agent.body_model.both_sides.problem import Body, Population, Problem
from selftouch_drake.agent.body_model.both_sides.recordings import (
    Layout,
    folds_of_postures,
    same_posture,
)
from selftouch_drake.agent.body_model.both_sides.search import SIGMA, Effort, Problems, found
from selftouch_drake.agent.body_model.both_sides.start import any_turns, at_random, mirrored
from selftouch_drake.agent.body_model.both_sides.steady import Pair, agreed

SMALL = Effort(
    starts=20, carried=2, images=6, bundled=4, passes=1, redrawn=4, last_steps=100
)  # fmt: skip
SMALL_ORDERS = OrderEffort(
    starts=8, polished=6, images=6, redrawn=2, beam=3, rounds=2, stale=1
)  # fmt: skip
SWAPPED = [1, 0, 2]


def swapped() -> Layout:
    """Both arms with their first two joints exchanged."""
    limbs = {
        "right": [RIGHT[j] for j in SWAPPED],
        "left": [LEFT[j] for j in SWAPPED],
    }
    return dataclasses.replace(LAYOUT, limbs=limbs)


@pytest.fixture(scope="module")
def touches():
    return recordings(200)


@pytest.fixture(scope="module")
def problems(touches):
    return Problems.of(touches, LAYOUT)


@pytest.fixture(scope="module")
def body(problems):
    return problems.body


@pytest.fixture(scope="module")
def one(problems):
    return found(problems, 0, SMALL)


def true_row(body: Body) -> np.ndarray:
    """A row with the true axes, and the trunk where it is."""
    row = np.zeros(body.length, dtype=np.float32)
    body.axes(row)[:] = axes()
    skin = body.skins["trunk"]
    coefficients = np.linalg.lstsq(skin.basis, trunk_places()[skin.receptor], rcond=None)[0]
    body.coefficients(row, "trunk")[:] = coefficients
    return row


def test_slopes_are_those_of_the_loss(problems):
    whole = problems.whole
    random = np.random.default_rng(0)
    rows = at_random(problems.body, 1, random)
    orders = np.arange(6)[None]
    draws = whole._draws(random, 1, 50)[0]
    slopes, parts = np.empty_like(rows), np.empty((1, 3))

    def loss(changed):
        nothing = np.empty_like(changed)
        return losses(changed, orders, whole.data, draws, 0.5, nothing, parts)[0]

    losses(rows, orders, whole.data, draws, 0.5, slopes, parts)
    for at in random.choice(rows.shape[1], 40, replace=False):
        up, down = rows.copy(), rows.copy()
        up[0, at] += 1e-2
        down[0, at] -= 1e-2
        slope = (loss(up) - loss(down)) / (up[0, at] - down[0, at])
        assert slopes[0, at] == pytest.approx(slope, abs=2e-3, rel=2e-2)
    assert np.abs(slopes).max() > 0.05


def test_the_finish_has_the_slopes_of_its_cost(problems, one):
    cost = Cost(problems.whole, one.orders[0], SIGMA)
    random = np.random.default_rng(0)
    row = one.rows[0].astype(float)
    row = cost.normed(row + 1e-2 * random.normal(size=len(row)))
    _, gradient, _ = cost.expanded(row)
    for _ in range(3):
        way = random.normal(size=len(row))
        more, less = (cost.value(cost.normed(row + side * way)) for side in (1e-6, -1e-6))
        slope = (more - less) / 2e-6
        assert gradient @ way == pytest.approx(slope, rel=1e-3)


def test_the_finish_goes_down_from_a_body_that_was_moved(problems, body, one):
    random = np.random.default_rng(0)
    moved = one.rows + (0.1 * random.normal(size=one.rows.shape)).astype(np.float32)
    before = problems.whole.evaluated(moved, one.orders, SIGMA)
    after = finished(problems.whole, before, sigma=SIGMA)
    assert after.loss[0] < before.loss[0] - 1
    assert after.loss[0] < one.loss[0] + 0.2
    assert axes_apart((body, after.rows[0]), (body, true_row(body))).max() < 8


def test_finer_skins_say_better_where_touches_were(touches, problems, body, one):
    coarse = Found.best(body, one.best())
    same = moved_over(coarse, body)
    for skin in body.skins:
        np.testing.assert_allclose(
            body.places(same, skin), body.places(coarse.row, skin), atol=1e-2
        )
    fine = finer(coarse, touches, 30)
    assert fine.body.size("trunk") == 30
    orders = np.arange(6)[None]
    loss = Problem.of(fine.body, touches).evaluated(fine.row[None], orders, SIGMA).loss[0]
    assert loss < one.loss[0] - 1
    apart = axes_apart((fine.body, fine.row), (body, true_row(body)))
    assert apart.max() < 8


def moved_draft(body: Body, random: np.random.Generator, noise: float) -> Found:
    """The true body seen from elsewhere, its axes off at random."""
    row = true_row(body)
    body.axes(row)[:] += noise * random.normal(size=(6, 3))
    turn = Rotation.random(rng=random).as_matrix()
    for own in (body.axes(row), body.centres(row), body.coefficients(row, "trunk")):
        own[:] = own @ turn
    shift = random.normal(size=3)
    body.centres(row)[:] += shift
    body.coefficients(row, "trunk")[0] += shift
    return Found(body=body, row=row, order=np.arange(6))


def degrees_off(axes_of: np.ndarray) -> np.ndarray:
    true = axes() / np.linalg.norm(axes(), axis=1, keepdims=True)
    return np.degrees(np.arccos(np.clip((axes_of * true).sum(axis=1), -1, 1)))


def test_drafts_agree_on_joints_better_than_each(body):
    random = np.random.default_rng(0)
    here = Found(body=body, row=true_row(body), order=np.arange(6))
    drafts = [moved_draft(body, random, 0.08) for _ in range(20)]
    joints = agreed(here, drafts)
    assert degrees_off(joints.axes).mean() < 2
    assert np.median(joints.axes_off) == pytest.approx(0.08, rel=0.3)
    np.testing.assert_allclose(joints.centres, body.centres(here.row), atol=1e-3)


def test_limbs_of_a_pair_are_images_only_as_far_as_errors_explain_it(touches, body):
    random = np.random.default_rng(1)
    here = Found(body=body, row=true_row(body), order=np.arange(6))
    pair = Pair(first=RIGHT, second=LEFT, sense=senses(touches, LAYOUT, "right", "left"))
    drafts = [moved_draft(body, random, 0.08) for _ in range(5)]
    alone, both = (agreed(here, drafts, pairs).axes for pairs in ((), (pair,)))
    assert degrees_off(both).mean() < degrees_off(alone).mean()
    # With one joint the other way round they are no images, and drafts are sure.
    wrong = Pair(first=RIGHT, second=LEFT, sense=pair.sense * [1, 1, -1])
    sure = [moved_draft(body, random, 0.001) for _ in range(5)]
    assert degrees_off(agreed(here, sure, [wrong]).axes).max() < 0.2


def test_grain_is_the_distance_of_receptors_in_one_unit_for_all_skins(body):
    units = []
    for name, places in (("trunk", trunk_places()), ("right_skin", arm_places())):
        skin = body.skins[name]
        own = places[skin.receptor]
        true = np.linalg.norm(own[skin.near[:, 0]] - own[skin.near[:, 1]], axis=1)
        assert np.corrcoef(true, skin.spacing)[0, 1] > 0.6
        units.append(np.median(true / skin.spacing))
        assert skin.trust.sum() == pytest.approx(1)
    assert units[0] == pytest.approx(units[1], rel=0.15)


def test_axes_are_found_from_nothing_but_touches(body, one):
    assert axes_apart((body, one.rows[0]), (body, true_row(body))).max() < 8


def test_a_wrong_order_is_worse_and_rejected(touches, body, one):
    wrong = found(Problems.of(touches, swapped()), 0, SMALL)
    assert wrong.loss[0] > one.loss[0] + 1
    orders = np.stack([np.array([1, 0, 2, 4, 3, 5]), np.arange(6)])
    some = Population(
        rows=np.concatenate([wrong.rows, one.rows]), orders=orders,
        loss=np.concatenate([wrong.loss, one.loss]),
    )  # fmt: skip
    gap = gap_between(some, np.arange(6))
    assert gap < 0
    same = Found.best(body, some)
    assert not compared(same, same, gap).accepted


@pytest.mark.slow
def test_the_order_is_found_with_the_body(touches):
    problems = Problems.of(touches, swapped())
    some = found_orders(problems, 0, SMALL_ORDERS, SMALL)
    there, row = settled(problems.body, some.rows[0], some.orders[0])
    assert list(there.layout.limbs["right"]) == RIGHT
    assert list(there.layout.limbs["left"]) == LEFT
    assert axes_apart((there, row), (there, true_row(there))).max() < 8
    assert gap_between(some, np.arange(6)) > 1
    # Joint and column agree, and nothing else has changed.
    again = Problem.of(there, touches).evaluated(row[None], np.arange(6)[None], SIGMA)
    assert again.loss[0] == pytest.approx(some.loss[0], rel=1e-3)


def test_a_mirror_image_turned_and_scaled_has_the_same_axes(body, one):
    row = one.rows[0]
    turn = any_turns(1, np.random.default_rng(1))[0]
    other = row.copy()
    body.axes(other)[:] = body.axes(row) @ turn * np.sign(np.linalg.det(turn))
    body.centres(other)[:] = 2 * body.centres(row) @ turn + 1
    for end in body.ends:
        body.coefficients(other, end)[:] = 2 * body.coefficients(row, end) @ turn
        body.coefficients(other, end)[0] += 1
    assert axes_apart((body, row), (body, other)).max() < 0.1


def test_a_body_is_accepted_if_a_search_begun_anew_agrees(problems, body, one):
    first, again = (Found.best(body, some) for some in (one, found(problems, 1, SMALL)))
    verdict = compared(first, again, np.inf)
    assert verdict.accepted, verdict.reason
    another = again.row.copy()
    body.axes(another)[0] = [0, 0, 1]
    assert not compared(first, dataclasses.replace(again, row=another), np.inf).accepted
    assert not compared(first, again, 0.1).accepted
    other_order = again.order[::-1].copy()
    assert not compared(first, dataclasses.replace(again, order=other_order), 9.0).accepted


def test_joints_are_told_to_which_limb_they_belong(touches, body):
    matters = relevance(body.skins, touches)
    assert limbs_of(matters, touches, LAYOUT.holder) == {"right": RIGHT, "left": LEFT}


def test_two_limbs_that_carry_the_same_kinds_of_ends_have_as_many_joints(touches):
    tip = dataclasses.replace(touches[2], name="left_tip_on_trunk", above="left_tip")
    holder = {**LAYOUT.holder, "left_tip": "left"}
    matters = np.zeros((6, 4))
    matters[RIGHT, 0] = matters[LEFT, 1] = 1.0
    matters[LEFT[2]] = [0.1, -0.1, 0, 0]
    assert limbs_of(matters[:, :3], touches, LAYOUT.holder)["left"] == LEFT[:2]
    assert limbs_of(matters, [*touches, tip], holder) == {"right": RIGHT, "left": LEFT}


def read_as_mirror_images(touches):
    """The left skin's touches where the right one's are, the last joint in the other sense."""
    right, left = touches[:2]
    q = left.q.copy()
    q[:, LEFT] = right.q[: len(q), RIGHT] * [1, 1, -1]
    return [right, dataclasses.replace(left, q=q)]


def test_a_pair_and_its_counterparts_are_told_by_readings(touches):
    some = read_as_mirror_images(touches)
    shuffled = [LEFT[1], LEFT[2], LEFT[0]]
    holder = {end: limb for end, limb in LAYOUT.holder.items() if "tip" not in end}
    layout = Layout(limbs={"right": RIGHT, "left": shuffled}, holder=holder)
    told = paired(some, layout)
    assert told.mirrored == (("right", "left"),)
    assert told.limbs == {"right": RIGHT, "left": LEFT}
    assert senses(some, told, "right", "left").tolist() == [1, 1, -1]


def test_a_mirror_image_begins_as_touches_tell(touches, problems, one):
    # Both arms of this body are read alike, and a mirror image turns the other way round.
    told = dataclasses.replace(problems.image, sense=np.ones(6))
    some, _ = mirrored(problems.body, one, ("right", "left"), 40, np.random.default_rng(0), told)
    turned = [axes_apart((problems.body, row), (problems.body, one.rows[0])) for row in some.rows]
    near = np.array(turned)[:, LEFT].max(axis=1) < 30
    assert near.mean() > 0.5


def test_no_posture_is_in_two_folds():
    random = np.random.default_rng(0)
    postures = random.uniform(-1, 1, size=(40, 3))
    q = np.repeat(postures, 20, axis=0) + 1e-3 * random.normal(size=(800, 3))
    fold = folds_of_postures(q)
    assert len(np.unique(same_posture(q, 0.05))) == 40
    assert (fold.reshape(40, 20) == fold.reshape(40, 20)[:, :1]).all()
    assert (np.bincount(fold) == 160).all()


def test_distinct_orders_are_the_best_of_each():
    orders = np.array([[0, 1], [1, 0], [0, 1]])
    some = Population(rows=np.zeros((3, 1)), orders=orders, loss=np.array([3.0, 2.0, 1.0]))
    assert distinct(some, 5).loss.tolist() == [1.0, 2.0]


def test_too_few_touches_and_a_pair_that_is_never_apart_are_refused(touches):
    with pytest.raises(ValueError, match="only 0 receptors were felt 3 times or more: 5 are"):
        learned_skin(np.zeros((4, 6), dtype=bool))
    with pytest.raises(ValueError, match="no recording has only one of them"):
        Problems.of(touches[1:2], LAYOUT)
