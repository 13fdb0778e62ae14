import dataclasses
import pickle
import warnings

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

from selftouch_drake.representation import QuotientLearner, component_labels


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
    # The first three joints are the point that is touched.
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
        return representation.kernel_q[members][order[: (len(order) + 1) // 2]]

    i, j = representation.edges[10]
    apart = np.linalg.norm(firm(i)[:, None] - firm(j)[None], axis=2)
    expected = (apart.min(axis=0).mean() + apart.min(axis=1).mean()) / 2
    assert representation.edge_cost[10] == pytest.approx(expected, rel=1e-4)


def test_two_fits_save_the_same_bytes(experience, learner, tmp_path):
    learner.representation_.save(tmp_path / "a.npz")
    clone(learner).fit(*experience).representation_.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_another_seed_gives_other_kernels(experience, learner):
    other = clone(learner).set_params(random_state=4).fit(*experience)
    assert not np.array_equal(other.representation_.kernel_row, learner.representation_.kernel_row)


def test_double_precision_learns_the_same(experience, learner):
    sensation, q = (array.astype(float) for array in experience)
    again = clone(learner).fit(sensation, q).representation_
    np.testing.assert_array_equal(again.kernel_row, learner.representation_.kernel_row)
    assert again.kernel_q.dtype == np.float32


def test_progress_rises_to_one(experience):
    told = []
    QuotientLearner(20).fit(
        *experience, progress=lambda fraction, stage: told.append((fraction, stage))
    )
    fractions = [fraction for fraction, _ in told]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert list(dict.fromkeys(stage for _, stage in told)) == [
        "target sensations",
        "set distances",
        "quotient graph",
    ]


def test_scikit_learn_manners(learner, experience):
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
        ({"num_targets": 1}, {}, "num_targets=1: give a whole number, 2 or more."),
        ({"num_targets": 2.5}, {}, "num_targets=2.5: give a whole number, 2 or more."),
        ({"max_kernel_size": 0}, {}, "max_kernel_size=0: give a whole number, 1 or more."),
        ({"num_neighbours": True}, {}, "num_neighbours=True: give a whole number, 1 or more."),
        (
            {"set_distance": "cosine"},
            {},
            "set_distance='cosine': choose one of minimum, quantile, mean_nearest, hausdorff.",
        ),
        (
            {},
            {"sensation": lambda s: s[:0], "q": lambda q: q[:0]},
            "sensation has 0 rows: babble until the finger touches the body.",
        ),
        (
            {},
            {"sensation": lambda s: s[:, 0]},
            "sensation has shape (500,): give sensations as (rows, receptors).",
        ),
        (
            {},
            {"sensation": lambda s: changed(s, (4, 2), np.nan)},
            "sensation row 4 holds NaN or infinity: drop such rows (1).",
        ),
        (
            {},
            {"sensation": lambda s: changed(s, (4, 2), np.inf)},
            "sensation row 4 holds NaN or infinity: drop such rows (1).",
        ),
        (
            {},
            {"sensation": lambda s: changed(s, (4, 2), -0.5)},
            "sensation holds -0.5, below 0: give pressures, the sensors' offset removed.",
        ),
        (
            {},
            {"sensation": lambda s: changed(s, [8, 9], 0.0)},
            "sensation row 8 is null: keep only rows that touch (2 do not).",
        ),
        (
            {},
            {"sensation": lambda s: np.ones_like(s)},
            "num_targets=50, but the experience holds only 1 distinct sensations: ask for at most "
            "1 targets, or babble longer.",
        ),
        (
            {},
            {"sensation": lambda s: s.astype(str)},
            "sensation holds <U32: give real numbers.",
        ),
        (
            {},
            {"q": lambda q: q[:, 0]},
            "q has shape (500,): give motor configurations as (rows, joints).",
        ),
        (
            {},
            {"q": lambda q: q[1:]},
            "q has 499 rows and sensation 500: give one motor configuration for each sensation.",
        ),
        (
            {},
            {"q": lambda q: changed(q, 3, np.nan)},
            "q row 3 holds NaN or infinity: drop such rows (1).",
        ),
        (
            {"num_targets": 501},
            {},
            "num_targets=501, but there are only 500 sensations: babble longer, or ask for fewer "
            "targets.",
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
    with pytest.raises(ValueError, match="receptors") as error:
        learner.predict(experience[0][:, :29])
    assert str(error.value) == (
        "sensation has 29 receptors, but 30 were learned from: give sensations of the same skin."
    )


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
