"""The online learner ends up with the same knowledge as the offline learner."""

import numpy as np
import pytest
from skins import touch

from selftouch_drake.agent.lifelong import learner as module
from selftouch_drake.agent.lifelong.learner import OnlineLearner
from selftouch_drake.agent.representation.estimator import QuotientLearner

pytestmark = pytest.mark.filterwarnings("ignore:the quotient graph fell")
#: Where only what is remembered is asked for.
ONLY_TOUCHES = pytest.mark.usefixtures("without_networks")


def lived(q, sensation, *, chunk=250, num_targets=60, **settings):
    learner = OnlineLearner(num_targets, **settings)
    for start in range(0, len(q), chunk):
        learner.take(q[start : start + chunk], sensation[start : start + chunk])
    return learner


def arrays_equal(one, other):
    first, second = one.to_arrays(), other.to_arrays()
    return all(np.array_equal(first[n], second[n], equal_nan=True) for n in first)


def edge_lengths(representation, place):
    """True lengths of the edges, between the mean places of kernels."""
    middle = np.array(
        [
            place[representation.kernel_row[representation.members(k)]].mean(axis=0)
            for k in range(representation.num_targets)
        ]
    )
    return np.linalg.norm(np.subtract(*middle[representation.edges.T]), axis=1)


def test_it_knows_what_the_offline_learner_knows():
    q, sensation, _, place = touch(["sphere"], 4000)
    learner = OnlineLearner(60)
    for start in range(0, 4000, 200):
        learner.take(q[start : start + 200], sensation[start : start + 200])
        done = start + 200
        if done in (1200, 2400, 4000):
            now = learner.representation
            offline = QuotientLearner(60).fit(sensation[:done], q[:done]).representation_
            assert now.num_targets == 60
            assert now.num_touches == done
            assert np.median(edge_lengths(now, place)) < 1.1 * np.median(
                edge_lengths(offline, place)
            )
            assert edge_lengths(now, place).max() < 1.3 * edge_lengths(offline, place).max()


@pytest.mark.slow
@ONLY_TOUCHES
def test_touches_of_a_hand_with_skin_are_remembered_for_either_side():
    q, sensation, skin, place = touch(["sphere", "tube"], 6000, hand="cap")
    learner = lived(q, sensation, num_targets=120, max_kernel_size=60)
    known = learner.representation
    assert known.num_parts == 3
    assert known.num_touches == 6000
    of_receptor = known.target_sensations.argmax(axis=1) // 60
    assert [len(np.unique(of_receptor[known.part == part])) for part in range(3)] == [1, 1, 1]
    for kernel in np.flatnonzero(of_receptor < 2):
        rows = known.kernel_row[known.members(kernel)]
        assert np.mean(skin[rows] == of_receptor[kernel]) > 0.95
        off = np.abs(place[rows] - np.median(place[rows], axis=0))
        assert np.linalg.norm(np.median(off, axis=0)) < 0.4
    row = known.kernel_row[7]
    felt = sensation[row] / np.linalg.norm(sensation[row])
    np.testing.assert_allclose(learner.kernel_sensation[[7]].toarray()[0], felt, rtol=1e-5)


def test_the_same_chunks_give_the_same_bytes_whenever_it_is_asked():
    q, sensation, *_ = touch(["sphere"], 2000)
    one, other = OnlineLearner(60), OnlineLearner(60)
    for start in range(0, 2000, 100):
        for learner in (one, other):
            learner.take(q[start : start + 100], sensation[start : start + 100])
    assert arrays_equal(one.representation, other.representation)
    assert (one.kernel_sensation != other.kernel_sensation).nnz == 0


@ONLY_TOUCHES
def test_what_was_felt_belongs_to_the_configurations():
    q, sensation, *_ = touch(["sphere"], 1000)
    learner = lived(q, sensation)
    representation = learner.representation
    felt = sensation[representation.kernel_row]
    np.testing.assert_allclose(
        learner.kernel_sensation.toarray(),
        felt / np.linalg.norm(felt, axis=1, keepdims=True),
        atol=1e-6,
    )
    np.testing.assert_allclose(representation.kernel_q, q[representation.kernel_row], atol=1e-6)


@ONLY_TOUCHES
def test_new_places_get_targets_and_old_targets_keep_their_numbers():
    q, sensation, _, place = touch(["sphere"], 4000)
    north = place[:, 2] > 0
    learner = lived(q[north], sensation[north], chunk=100, num_targets=40)
    before = learner.representation.target_sensations
    south = np.flatnonzero(~north)[:200]
    learner.take(q[south], sensation[south])
    after = learner.representation.target_sensations
    alike = np.einsum("ks,ks->k", before, after)
    assert np.sum(alike < 0.3) > 5, "targets moved to where sensations are new"
    assert np.median(np.sort(alike)[-20:]) > 0.8, "others are where they were"
    felt = (sensation[south] / np.linalg.norm(sensation[south], axis=1, keepdims=True)) @ after.T
    assert np.quantile(felt.max(axis=1), 0.1) > 0.5


@ONLY_TOUCHES
def test_the_work_for_a_touch_does_not_grow(monkeypatch):
    """Number of touches used to choose targets, and of measured kernels, in a long life."""
    q, sensation, *_ = touch(["sphere"], 9_000, num_receptors=20)
    work = []
    counts = {
        "assign": lambda rows, _: len(rows),
        "set_distances": lambda *_, changed: changed.sum(),
    }
    for name, count in counts.items():
        real = getattr(module, name)

        def counted(*given, real=real, count=count, **named):
            work[-1] += count(*given, **named)
            return real(*given, **named)

        monkeypatch.setattr(module, name, counted)
    learner = OnlineLearner(30, 40)
    for start in range(0, len(q), 200):
        work.append(0)
        learner.take(q[start : start + 200], sensation[start : start + 200])
        assert learner.representation.num_rows <= 30 * 40
    # From 1200 touches on all that it may remember is remembered.
    assert np.sum(work[-15:]) <= np.sum(work[6:21])


def test_too_few_touches_are_refused():
    q, sensation, *_ = touch(["sphere"], 50)
    with pytest.raises(ValueError, match="50 touches are too few to learn from"):
        _ = lived(q, sensation).representation
