"""Bodies from few touches: what they feel like says where they lie."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hand_made_chains import an_arm, misfit, sample

from selftouch_drake.agent.body_model.chain import places
from selftouch_drake.agent.body_model.few import turning_alike
from selftouch_drake.agent.body_model.find import find_body_model
from selftouch_drake.agent.body_model.fit import (
    Bodies,
    Descent,
    Smooth,
    chain_way,
    descended,
    random_bodies,
)
from selftouch_drake.agent.body_model.model import JointKind
from selftouch_drake.agent.body_model.smoothness import (
    Sensed,
    SmoothChain,
    criterion,
    finished,
    spread,
    tangent,
    without_pitch,
)

NAMES = ["d", "c", "b", "a", "e"]


def found(q, sensation, seed=0, each=map):
    labels = np.asarray(sensation.argmax(axis=1)).ravel()
    kept, labels = np.unique(labels, return_inverse=True)
    part = np.zeros(len(kept), dtype=int)
    return find_body_model(
        q, sensation, labels, part, joint_names=NAMES[: q.shape[1]], seed=seed, each=each
    )


def test_the_precision_knows_no_origin_and_places_are_foretold():
    _, sensation, y, _ = sample(400)
    some, others = np.arange(200), np.arange(200, 400)
    sensed = Sensed.of(sensation)
    precision = sensed.some(some).precision()
    assert np.abs(precision.sum(axis=1)).max() < 1e-8 * np.abs(precision).max()
    assert np.linalg.eigvalsh(precision).min() > -1e-9 * np.abs(precision).max()
    expected = sensed.some(some).predicted(y[some], sensed.some(others))
    assert misfit(expected, y[others]) < 3
    # A label says less: the place of the nearest touch.
    nearest = sensed.covariance(sensed)[np.ix_(others, some)].argmax(axis=1)
    assert misfit(y[some][nearest], y[others]) > 2 * misfit(expected, y[others])


def test_no_similarity_changes_the_criterion():
    _, sensation, y, _ = sample(150)
    precision = Sensed.of(sensation).precision()
    turned = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    moved = 7 * y @ turned + [1, -2, 3]
    assert criterion(moved, precision) == pytest.approx(criterion(y, precision), abs=1e-6)
    mixed = y[np.random.default_rng(1).permutation(len(y))]
    assert criterion(mixed, precision) > criterion(y, precision) + 3


def test_the_compiled_search_has_the_same_criterion_and_goes_down():
    q, sensation, _, _ = sample(130)
    standard = (q - q.mean(axis=0)) / q.std(axis=0)
    single = np.ascontiguousarray(standard.T.astype(np.float32))
    rows = np.arange(len(q))
    precision = Sensed.of(sensation).precision()
    way = ((2, 1), (0, 1), (3, 1), (1, 1))
    body = random_bodies([[way]], 4, 1, np.random.default_rng(3))
    order = [joint for joint, _ in way]
    there = places(standard[:, order], body.twists[0, order], body.points[0, 0])
    group = Smooth(rows, precision)
    still = descended(single, [group], body, Descent(steps=1, rate=0.0, tail=0.0), 0)
    assert still.loss[0, 0] == pytest.approx(criterion(there, precision), abs=2e-3)

    # The step of least size goes along the gradient: all else is taken by finite differences.
    moved = descended(single, [group], body, Descent(steps=1, rate=1e-3, tail=0.0), 0)
    signs = np.sign(body.twists - moved.twists)[0, order]
    slopes = np.empty_like(signs)
    for joint in range(4):
        for entry in range(6):
            values = []
            for step in (1e-5, -1e-5):
                twists = body.twists[0, order].copy()
                twists[joint, entry] += step
                there = places(standard[:, order], twists, body.points[0, 0])
                values.append(criterion(there, precision))
            slopes[joint, entry] = (values[0] - values[1]) / 2e-5
    steep = np.abs(slopes) > 1e-2 * np.abs(slopes).max()
    assert np.array_equal(np.sign(slopes[steep]), signs[steep])


def test_a_search_that_holds_twists_ends_where_the_finish_does():
    q, sensation, _, _ = sample(100)
    scale = q.std(axis=0)
    standard = (q - q.mean(axis=0)) / scale
    single = np.ascontiguousarray(standard.T.astype(np.float32))
    precision = Sensed.of(sensation).precision()
    arm, point = an_arm()
    twists = arm * scale[:, None] + 0.1 * np.random.default_rng(4).standard_normal(arm.shape)
    way = chain_way(range(4))
    body = Bodies([[way]], twists[None], point[None, None], np.full((1, 1), np.inf))
    begin = SmoothChain(twists, point, np.inf)
    for unit in (scale, np.r_[scale[:3], np.nan], np.full(4, np.nan)):
        group = Smooth(np.arange(len(q)), precision, unit)
        ended = descended(single, [group], body, Descent(steps=1500, tail=0.0), 0)
        expected = finished(standard, precision, begin, unit=unit)
        assert ended.loss[0, 0] == pytest.approx(expected.criterion, abs=0.02)
        w, v = ended.twists[0, :, :3], ended.twists[0, :, 3:]
        assert np.abs((w * v).sum(axis=1)).max() < 1e-3
        far = (np.linalg.norm(w, axis=1) / unit)[np.isfinite(unit)]
        assert np.abs(np.diff(np.log(far))).max(initial=0) < 1e-3


def test_the_finish_is_no_screw_and_holds_what_slides():
    q, sensation, _, _ = sample(300, slides=[1])
    standard = (q - q.mean(axis=0)) / q.std(axis=0)
    twists, point = an_arm(slides=[1])
    precision = Sensed.of(sensation).precision()
    random = np.random.default_rng(2)
    begin = SmoothChain(
        twists * q.std(axis=0)[:, None] + 0.05 * random.standard_normal(twists.shape), point, np.inf
    )
    slides = np.array([False, True, False, False])
    begin.twists[1, :3] = 0
    chain = finished(standard, precision, begin, slides=slides)
    assert np.abs((chain.twists[:, :3] * chain.twists[:, 3:]).sum(axis=1)).max() < 1e-9
    assert np.array_equal(chain.twists[1, :3], np.zeros(3))
    there = places(standard, begin.twists, point)
    assert chain.criterion < criterion(there, precision) - 0.5
    np.testing.assert_allclose(without_pitch(chain.twists), chain.twists, atol=1e-12)
    # What no touch can tell has no spread, what slides does not turn.
    covariance = spread(standard, precision, chain, slides=slides)
    assert np.array_equal(covariance[6:9], np.zeros((3, len(covariance))))
    assert np.linalg.matrix_rank(covariance, tol=1e-9 * np.trace(covariance)) == 3 * 5 + 3 + 3 - 7


def test_joints_turn_alike_unless_touches_say_that_they_do_not():
    q, sensation, _, _ = sample(100)
    precision = Sensed.of(sensation).precision()
    twists, point = an_arm()
    other = np.array([1, 1.3, 1, 1])
    # A joint that reads in another unit stops the others only if that is not known.
    for factor, own, alike in ((np.ones(4), 0, True), (other, 0, False), (other, np.nan, True)):
        read = q * factor
        scale = read.std(axis=0)
        standard = (read - read.mean(axis=0)) / scale
        begin = SmoothChain(twists * (scale / factor)[:, None], point, np.inf)
        free = finished(standard, precision, begin)
        known = scale + np.array([0, own, 0, 0])
        chain, unit = turning_alike(standard, precision, free, known)
        assert (unit is not None) == alike
        if alike:
            far = np.linalg.norm(chain.twists[:, :3], axis=1) / scale
            same = np.isfinite(known)
            np.testing.assert_allclose(far[same], far[0], rtol=1e-9)
            # Each joint but one has a parameter less.
            still, fewer = np.zeros(4, dtype=bool), same.sum() - 1
            assert tangent(chain, still, unit).shape[1] == tangent(chain, still).shape[1] - fewer


#: Joints in another order, in other units.
ORDER, UNIT = [2, 0, 3, 1], np.array([57.3, 1, -100, 1])


@pytest.fixture(scope="module")
def of_few():
    """The model of 150 touches of an arm whose joints are shuffled."""
    q, sensation, _, _ = sample(150)
    return found(q[:, ORDER] * UNIT, sensation)


def test_a_hundred_and_fifty_touches_make_a_body(of_few):
    model, order, unit = of_few, ORDER, UNIT
    _, _, _, (all_q, all_y) = sample(150)
    assert model.accepted, model.reason
    assert "left out in turn" in model.reason
    place = model.place(all_q[:, order] * unit, np.zeros(len(all_q), dtype=int))
    assert misfit(place, all_y) < 2.0
    assert [order[joint] for joint in model.chain(int(model.toucher_link[0]))] == [0, 1, 2, 3]
    assert set(model.joint_kind.tolist()) == {JointKind.TURNS}
    turns = np.linalg.norm(model.twists[:, :3], axis=1) * np.abs(unit)
    sigma = np.linalg.norm(model.twist_sigma[:, :3], axis=1) * np.abs(unit)
    assert np.all(sigma > 0)
    assert np.all(np.abs(turns - 1) < np.maximum(4 * sigma, 0.02))
    assert np.isfinite(model.kernel_place).all()


def test_labels_alone_need_more():
    q, sensation, _, _ = sample(150)
    labels = np.asarray(sensation.argmax(axis=1)).ravel()
    kept, labels = np.unique(labels, return_inverse=True)
    part = np.zeros(len(kept), dtype=int)
    assert not find_body_model(q, None, labels, part, joint_names=NAMES[:4]).accepted


def test_a_slide_is_told_from_a_turn_by_few():
    q, sensation, _, (all_q, all_y) = sample(200, slides=[1])
    model = found(q, sensation)
    assert model.accepted, model.reason
    assert model.joint_kind.tolist() == [1, 2, 1, 1]
    assert np.array_equal(model.twists[1, :3], np.zeros(3))
    assert misfit(model.place(all_q, np.zeros(len(all_q), dtype=int)), all_y) < 1.5


@pytest.mark.parametrize("what", ["mixed", pytest.param("shuffled", marks=pytest.mark.slow)])
def test_no_chain_is_no_body(what):
    q, sensation, _, _ = sample(160)
    if what == "mixed":
        q = q + 0.3 * np.sin(2 * q[:, ::-1])
    else:
        q = np.random.default_rng(4).permutation(q)
    assert not found(q, sensation).accepted


def test_too_few_are_said_to_be_too_few():
    q, sensation, _, _ = sample(60)
    model = found(q[:39], sensation[:39])
    assert model.reason.startswith("39 touches of 4 moving joints are too few to look for a body")
    assert "(40 needed)" in model.reason
    # Joints that turn alike have three parameters less.
    model = found(q[:45] * UNIT, sensation[:45])
    assert not model.accepted
    assert "45 touches are too few for 16 parameters (48 needed)" in model.reason


def test_threads_change_nothing(of_few):
    q, sensation, _, _ = sample(150)
    with ThreadPoolExecutor(2) as pool:
        other = found(q[:, ORDER] * UNIT, sensation, each=pool.map)
    for name in ("twists", "twist_sigma", "kernel_place", "receptor_place", "held_out"):
        np.testing.assert_array_equal(getattr(of_few, name), getattr(other, name))
