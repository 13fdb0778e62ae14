import dataclasses
import pickle
import warnings

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.utils.estimator_checks import parametrize_with_checks

from selftouch_drake.agent.representation.estimator import QuotientLearner
from selftouch_drake.agent.representation.learning import learn
from selftouch_drake.quotient.graph import DisconnectedWarning
from selftouch_drake.quotient.paths import component_labels


def test_kernels_hold_rows_of_the_experience_that_feel_alike(experience, learner, representation):
    sensation, q = experience
    label = learner.predict(sensation)
    np.testing.assert_array_equal(q[representation.kernel_row], representation.kernel_q)
    strength = np.linalg.norm(sensation[representation.kernel_row], axis=1)
    np.testing.assert_allclose(representation.kernel_strength, strength, rtol=1e-5)
    for kernel in range(representation.num_targets):
        rows = representation.kernel_row[representation.members(kernel)]
        assert (label[rows] == kernel).all()
        assert len(rows) == min(40, np.sum(label == kernel))
        assert len(rows) > 0


def test_kernel_error_is_the_cosine_distance_to_the_target(experience, representation):
    sensation, _ = experience
    members = representation.members(7)
    felt = sensation[representation.kernel_row[members]]
    felt = felt / np.linalg.norm(felt, axis=1, keepdims=True)
    expected = 1 - felt @ representation.target_sensations[7]
    np.testing.assert_allclose(representation.kernel_error[members], expected, atol=1e-6)


def test_the_graph_is_connected_and_near(experience, representation):
    i, j = representation.edges.T
    assert (i < j).all()
    assert (np.diff(i * 1000 + j) > 0).all()
    assert component_labels(representation.edges, 120).max() == 0
    # The first three joints are the place touched.
    place = np.array(
        [representation.kernel_q[representation.members(k), :3].mean(0) for k in range(120)]
    )
    # 120 kernels lie 0.35 apart on a sphere of radius 1.
    assert np.linalg.norm(place[i] - place[j], axis=1).max() < 1.2
    assert (representation.edge_cost > 0).all()


def test_edge_cost_is_between_firm_configurations(experience, representation):
    def firm(kernel):
        members = representation.members(kernel)
        order = np.argsort(-representation.kernel_strength[members])
        return representation.kernel_sets.x[members][order[: (len(order) + 1) // 2]]

    i, j = representation.edges[10]
    apart = np.linalg.norm(firm(i)[:, None] - firm(j)[None], axis=2)
    expected = (apart.min(axis=0).mean() + apart.min(axis=1).mean()) / 2
    assert representation.edge_cost[10] == pytest.approx(expected, rel=1e-4)


def same_bytes(one, other):
    here, there = one.to_arrays(), other.to_arrays()
    return all(here[name].tobytes() == there[name].tobytes() for name in here)


def test_two_fits_give_the_same_bytes(experience, learner):
    assert same_bytes(learner.representation_, clone(learner).fit(*experience).representation_)


def test_another_seed_gives_other_kernels(experience, learner):
    other = clone(learner).set_params(random_state=4).fit(*experience)
    assert not np.array_equal(other.representation_.kernel_row, learner.representation_.kernel_row)


def test_double_precision_learns_the_same(experience, learner):
    sensation, q = (array.astype(float) for array in experience)
    again = clone(learner).fit(sensation, q).representation_
    np.testing.assert_array_equal(again.kernel_row, learner.representation_.kernel_row)
    assert again.kernel_q.dtype == np.float32


def test_progress_rises_to_one(experience):
    reports = []
    learn(
        lambda: [experience],
        num_targets=20,
        max_kernel_size=1000,
        progress=lambda fraction, stage: reports.append((fraction, stage)),
    )
    fractions = [fraction for fraction, _ in reports]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert list(dict.fromkeys(stage for _, stage in reports)) == [
        "target sensations",
        "motor kernels",
        "joints that matter",
        "set distances",
        "quotient graph",
    ]


OWN_WORDS = "refused, with a remedy instead of scikit-learn's words"
DOES_NOT_APPLY = {
    "check_fit_score_takes_y": "the second argument is q, the paper's name",
    "check_dtype_object": "columns of Python objects are refused",
    "check_estimators_dtypes": "its float32 data hold a null sensation",
    "check_fit2d_1feature": "its data hold a null sensation",
    "check_positive_only_tag_during_fit": OWN_WORDS,
    "check_complex_data": OWN_WORDS,
    "check_estimators_empty_data_messages": OWN_WORDS,
    "check_fit2d_1sample": OWN_WORDS,
    "check_fit2d_predict1d": OWN_WORDS,
    "check_requires_y_none": OWN_WORDS,
}


@parametrize_with_checks(
    [QuotientLearner(num_targets=3)], expected_failed_checks=lambda estimator: DOES_NOT_APPLY
)
def test_scikit_learn_checks(estimator, check):
    check(estimator)


def cut(arrays, *cuts):
    return lambda: zip(*(np.split(array, cuts) for array in arrays), strict=True)


@pytest.mark.parametrize("cuts", [(1, 2, 50), (0, 3000, 3000), tuple(range(7, 6000, 701))])
def test_batches_of_any_size_give_the_same_bytes(cuts, experience, learner, monkeypatch):
    # A small reservoir and small blocks, so that both passes drop rows and split batches.
    room = "selftouch_drake.agent.representation"
    monkeypatch.setattr(f"{room}.sorting.MAX_ROWS", 900)
    monkeypatch.setattr(f"{room}.batches._BLOCK", 512)
    monkeypatch.setattr(f"{room}.reservoir._LEAST_WAITING", 1000)
    whole, fitted = (
        clone(learner).fit_batches(batches) for batches in (cut(experience), cut(experience, *cuts))
    )
    assert same_bytes(whole.representation_, fitted.representation_)
    assert fitted.representation_.kernel_row.max() > 5000


def test_experience_that_changes_between_readings_is_refused(experience):
    readings = iter([cut(experience)(), cut([array[:4000] for array in experience])()])
    with pytest.raises(ValueError, match="batches") as error:
        QuotientLearner(20).fit_batches(lambda: next(readings))
    assert str(error.value) == (
        "batches gave 6000 rows, then 4000: give the same experience each time"
    )


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        (
            "sensation",
            lambda s: s[:, :29],
            "sensation row 4000 has 29 receptors, earlier rows have 30: give experience of one "
            "robot",
        ),
        (
            "q",
            lambda q: q[:, :4],
            "q row 4000 has 4 joints, earlier rows have 5: give experience of one robot",
        ),
        (
            "sensation",
            lambda s: changed(s, (7, 2), np.nan),
            "sensation row 4007 holds NaN or infinity: drop such rows (1)",
        ),
        (
            "sensation",
            lambda s: changed(s, 5, 0.0),
            "sensation row 4005 is null: keep only rows that touch (1 do not)",
        ),
        ("q", lambda q: changed(q, 3, np.inf), "q row 4003 holds NaN or infinity: drop such"),
    ],
)
def test_a_batch_that_does_not_belong_is_named(experience, name, change, message):
    first, second = (dict(zip(("sensation", "q"), b, strict=True)) for b in cut(experience, 4000)())
    second[name] = change(second[name])
    with pytest.raises(ValueError, match=r"row") as error:
        QuotientLearner(20).fit_batches(lambda: [tuple(first.values()), tuple(second.values())])
    assert str(error.value).startswith(message)


def line_of_skin(along):
    return np.exp(-np.square(along[:, None] - np.linspace(0, 1, 12)) / 0.01)


def test_components_of_one_part_and_what_joined_them_are_reported():
    # One skin, touched at both ends from distant configurations, and not in between.
    rng = np.random.default_rng(0)
    there = rng.integers(0, 2, 4000)
    along = rng.uniform(0, 0.3, 4000) + 0.7 * there
    q = np.stack([along + 9 * there, rng.uniform(0, 0.1, 4000)], axis=1)
    with pytest.warns(DisconnectedWarning):
        learned = learn(lambda: [(line_of_skin(along), q)], num_targets=40, max_kernel_size=1000)
    representation = learned.representation
    end = representation.target_sensations.argmax(axis=1) > 5
    assert representation.part.tolist() == [0] * 40
    assert len(set(zip(learned.component, end, strict=True))) == 2
    ((i, j),) = learned.bridges
    assert end[i] != end[j]
    assert [i, j] in representation.edges.tolist()


def test_two_skins_are_two_parts_that_no_edge_joins():
    rng = np.random.default_rng(0)
    there = rng.random(4000) < 0.3
    along = rng.uniform(0, 1, 4000)
    near = line_of_skin(along)
    sensation = np.hstack([near * ~there[:, None], near * there[:, None]])
    q = np.stack([along + there, rng.uniform(0, 0.1, 4000)], axis=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        learned = learn(lambda: [(sensation, q)], num_targets=60, max_kernel_size=1000)
    representation = learned.representation
    skin = representation.target_sensations[:, 12:].any(axis=1)
    assert len(set(zip(representation.part, skin, strict=True))) == 2
    sizes = np.bincount(representation.part)
    assert sizes[0] >= sizes[1]
    assert representation.num_parts == 2
    i, j = representation.edges.T
    assert (skin[i] == skin[j]).all()
    assert learned.bridges.shape == (0, 2)
    assert representation.num_set_aside == 0


def test_a_connected_graph_has_no_bridges(experience):
    learned = learn(lambda: [experience], num_targets=120, max_kernel_size=40)
    assert learned.component.tolist() == [0] * 120
    assert learned.bridges.shape == (0, 2)


def test_random_state_may_be_a_generator(experience):
    fits = [
        QuotientLearner(20, 9, random_state=np.random.RandomState(seed)).fit(*experience)
        for seed in (5, 5, 6)
    ]
    rows = [fit.representation_.kernel_row.tolist() for fit in fits]
    assert rows[0] == rows[1] != rows[2]


def test_scikit_learn_conventions(learner, experience):
    assert clone(learner).get_params() == learner.get_params()
    fresh = QuotientLearner()
    assert not [name for name in vars(fresh) if name.endswith("_")]
    assert fresh.set_params(num_targets=7).num_targets == 7
    assert fresh.fit(*(array[:100] for array in experience)) is fresh
    assert fresh.n_features_in_ == 30
    again = pickle.loads(pickle.dumps(learner))
    np.testing.assert_array_equal(
        again.predict(experience[0][:9]), learner.predict(experience[0][:9])
    )
    with pytest.raises(NotFittedError):
        QuotientLearner().predict(experience[0])


def test_fit_does_not_change_what_it_is_given(experience):
    copies = [array.copy() for array in experience]
    QuotientLearner(10).fit(*experience)
    for array, copy in zip(experience, copies, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_as_many_targets_as_rows():
    sensation, q = np.eye(6), np.arange(6.0)[:, None]
    representation = QuotientLearner(6).fit(sensation, q).representation_
    assert np.diff(representation.kernel_offsets).tolist() == [1] * 6


def changed(array, index, value):
    array = array.copy()
    array[index] = value
    return array


@pytest.mark.parametrize(
    ("parameters", "change", "message"),
    [
        ({"num_targets": 1}, {}, "num_targets is 1: give a whole number, 2 or more"),
        ({"num_targets": 2.5}, {}, "num_targets is 2.5: give a whole number, 2 or more"),
        ({"max_kernel_size": 0}, {}, "max_kernel_size is 0: give a whole number, 1 or more"),
        ({"random_state": -1}, {}, "seed is -1: give a whole number, 0 or more"),
        (
            {},
            {"sensation": lambda s: s[:0], "q": lambda q: q[:0]},
            "sensation has 0 rows: babble until the finger touches the body",
        ),
        (
            {},
            {"sensation": lambda s: s[:, 0]},
            "sensation has shape (500,): give sensations as (rows, receptors)",
        ),
        (
            {},
            {"sensation": lambda s: changed(s, (4, 2), np.nan)},
            "sensation row 4 holds NaN or infinity: drop such rows (1)",
        ),
        (
            {},
            {"sensation": lambda s: changed(s, (4, 2), np.inf)},
            "sensation row 4 holds NaN or infinity: drop such rows (1)",
        ),
        (
            {},
            {"sensation": lambda s: changed(s, (4, 2), -0.5)},
            "sensation holds -0.5, a negative reading: give pressures, without the receptors' "
            "offset",
        ),
        (
            {},
            {"sensation": lambda s: changed(s, [8, 9], 0.0)},
            "sensation row 8 is null: keep only rows that touch (2 do not)",
        ),
        (
            {},
            {"sensation": lambda s: np.ones_like(s)},
            "sensation is the same in every row: record touches at more places",
        ),
        (
            {},
            {"sensation": lambda s: np.repeat(s[:20], 25, axis=0)},
            "num_targets is 50, but the experience holds only 20 distinct sensations: give at "
            "most 20, or babble longer",
        ),
        (
            {},
            {"sensation": lambda s: s.astype(str)},
            "sensation holds <U32: give real numbers, not sparse",
        ),
        (
            {},
            {"q": lambda q: q[:, 0]},
            "q has shape (500,): give motor configurations as (rows, joints)",
        ),
        (
            {},
            {"q": lambda q: q[1:]},
            "q has 499 rows and sensation 500: give one motor configuration for each sensation",
        ),
        (
            {},
            {"q": lambda q: changed(q, 3, np.nan)},
            "q row 3 holds NaN or infinity: drop such rows (1)",
        ),
        (
            {"num_targets": 501},
            {},
            "num_targets is 501, but there are only 500 sensations: give a smaller number, or "
            "babble longer",
        ),
    ],
)
def test_what_cannot_be_learned_from_is_refused(experience, parameters, change, message):
    arrays = {"sensation": experience[0][:500], "q": experience[1][:500]}
    for name, alter in change.items():
        arrays[name] = alter(arrays[name])
    with pytest.raises(ValueError, match=r".") as error:
        QuotientLearner(**{"num_targets": 50, **parameters}).fit(**arrays)
    assert str(error.value) == message


def test_predict_refuses_another_skin(learner, experience):
    with pytest.raises(ValueError, match=r"has 29 features, but .* is expecting 30 features"):
        learner.predict(experience[0][:, :29])


def test_learning_is_silent(experience, capfd):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        QuotientLearner(60).fit(*experience)
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err == ""


def test_the_representation_is_frozen(representation):
    with pytest.raises(dataclasses.FrozenInstanceError):
        representation.edges = np.zeros((0, 2))
