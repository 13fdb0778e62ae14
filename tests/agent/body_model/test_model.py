import dataclasses
import re

import numpy as np
import pytest
from scipy.linalg import expm

from selftouch_drake.agent.body_model.model import (
    BASE,
    UNUSED,
    BodyModel,
    JointKind,
    VersionError,
    independent,
    rejected,
)
from selftouch_drake.agent.body_model.support import SHAPE_BASIS, bulge
from selftouch_drake.agent.body_model.twists import exponential

rng = np.random.default_rng(0)


def hat(twist):
    w, v = twist[:3], twist[3:]
    X = np.zeros((4, 4))
    X[:3, :3] = [[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]
    X[:3, 3] = v
    return X


def laid(parent, twists, part_link, toucher_link, toucher_place, **changed):
    """A model of a tree with one kernel for each part, laid by hand."""
    parent, num_parts, num_touchers = np.array(parent), len(part_link), len(toucher_link)
    names = tuple("abcdefgh"[: len(parent)])
    blank = rejected(
        "off", joint_names=names, kernel_part=np.arange(num_parts), num_rows=3, num_receptors=2
    )
    kind = np.where(parent == UNUSED, JointKind.UNUSED, JointKind.TURNS)
    known = {
        "joint_parent": parent,
        "twists": np.array(twists, dtype=float),
        "joint_kind": kind,
        "part_link": np.array(part_link),
        "toucher_link": np.array(toucher_link),
        "toucher_place": np.array(toucher_place, dtype=float),
        "toucher_shape": np.zeros((num_touchers, 5)),
        "covariance": independent(np.full((len(parent), 6), np.nan), num_touchers),
        "accepted_by_part": np.ones(num_parts, dtype=bool),
    }
    return dataclasses.replace(blank, **known | changed)


# A head on a turning trunk, and an arm of three joints on the trunk as well. Joints are stored in
# an order of their own, and one of them matters nowhere.
#   base - a - c (head, wears part 0);   base - a - f - b - e (hand);   base wears part 1;   d
PARENT = [BASE, 5, 0, UNUSED, 1, 0]
TWISTS = rng.normal(size=(6, 6))
TWISTS[1, :3] = 0.0  # slides
TWISTS[4, :3] *= 1e-9  # hardly turns
TREE = laid(PARENT, TWISTS, [2, BASE], [4], [[0.3, -0.2, 0.5]])


def by_expm(twists, q, link):
    """The pose of a link of the tree, joint by joint from the base on."""
    X = np.eye(4)
    while link != BASE:
        X = expm(hat(twists[link]) * q[link]) @ X
        link = PARENT[link]
    return X


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-7, 1e-3, 0.0299, 0.0301, 0.5, 3.1, 9.0])
def test_a_twist_of_any_size_has_scipys_exponential(size):
    twist = rng.normal(size=6)
    twist[:3] *= size / np.linalg.norm(twist[:3])
    for amount in (-1.0, 0.0, 1.0):
        X = exponential(twist, np.array([amount]))[0]
        assert np.abs(X - expm(hat(twist) * amount)).max() < 1e-13


def test_links_are_where_a_chain_of_exponentials_puts_them():
    q = rng.uniform(-3, 3, (20, 6))
    poses = TREE.link_poses(q)
    assert poses.shape == (20, 7, 4, 4)
    for row in range(20):
        for link in (0, 1, 2, 4, 5, BASE):
            assert np.abs(poses[row, link] - by_expm(TWISTS, q[row], link)).max() < 1e-12
    assert np.isnan(poses[:, 3]).all()


def test_places_are_seen_from_the_part_of_the_target():
    q = rng.uniform(-3, 3, (20, 6))
    target = np.arange(20) % 2
    tip = np.append(TREE.toucher_place[0], 1.0)
    places = TREE.place(q, target)
    for row in range(20):
        wearer = by_expm(TWISTS, q[row], [2, BASE][target[row]])
        expected = np.linalg.inv(wearer) @ by_expm(TWISTS, q[row], 4) @ tip
        assert np.abs(places[row] - expected[:3]).max() < 1e-12


def test_joints_on_the_common_way_cancel_exactly():
    q = rng.uniform(-3, 3, (20, 6))
    other = q.copy()
    other[:, [0, 3]] = rng.uniform(-3, 3, (20, 2))  # the trunk, and the joint that is unused
    head = np.zeros(20, dtype=int)
    assert np.array_equal(TREE.place(q, head), TREE.place(other, head))
    assert not np.allclose(TREE.place(q, head + 1), TREE.place(other, head + 1))


def test_of_two_touchers_the_nearer_one_is_meant():
    model = laid([BASE], [[0, 0, 1, 0, 0, 0]], [BASE], [0, 0], [[1, 0, 0], [0, 2, 0]])
    q = np.array([[0.0], [0.0]])
    assert np.isnan(model.place(q, np.zeros(2, dtype=int))).all()
    for near, found in (([0.9, 0, 0], [1, 0, 0]), ([0, 1.9, 0], [0, 2, 0])):
        at = dataclasses.replace(model, kernel_place=np.array([near], dtype=float))
        assert at.place(q, np.zeros(2, dtype=int)) == pytest.approx(np.array([found, found]))


def test_a_fist_touches_where_its_surface_faces_the_skin():
    shape, normal = 0.02 * rng.normal(size=(1, 5)), np.array([[0.6, 0.0, 0.8]])
    place = [[0.3, 0.1, -0.2]]
    fist = laid([BASE], TWISTS[:1], [BASE], [0], place, toucher_shape=shape, kernel_normal=normal)
    point = dataclasses.replace(fist, toucher_shape=np.zeros((1, 5)))
    q, target = rng.uniform(-3, 3, (5, 1)), np.zeros(5, dtype=int)
    # The ellipsoid-like surface x(u) = grad (h(u) |u|) is farthest along u where it touches.
    for row in range(5):
        R = by_expm(TWISTS, np.append(q[row], np.zeros(5)), 0)[:3, :3]
        around = rng.normal(size=(20000, 3))
        around /= np.linalg.norm(around, axis=1, keepdims=True)
        surface = bulge(shape[0], around) + around
        u = -R.T @ normal[0]
        touch = (fist.place(q, target) - point.place(q, target))[row]
        depth = (R.T @ touch + u) @ u
        assert depth >= (surface @ u).max() - 1e-12
        assert depth == pytest.approx((surface @ u).max(), abs=1e-3)


def test_a_place_names_a_target_of_its_part():
    model = laid([BASE], TWISTS[:1], [BASE, BASE], [0], [[1, 0, 0]])
    place = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
    model = dataclasses.replace(model, kernel_place=place)
    assert [model.target_at(part, [0.0, 0.0, 0.0]) for part in (0, 1)] == [0, 1]
    with pytest.raises(ValueError, match="part is 2; the model has parts 0 to 1"):
        model.target_at(2, [0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"place is \[nan, 0.0, 0.0\]; give three finite numbers"):
        model.target_at(0, [np.nan, 0.0, 0.0])
    rejected = dataclasses.replace(model, accepted_by_part=np.zeros(2, dtype=bool))
    with pytest.raises(ValueError, match="part is 0, of which the agent has no model: off"):
        rejected.target_at(0, [0.0, 0.0, 0.0])


def test_a_bulge_has_no_size_of_its_own_and_is_even():
    assert np.abs(np.trace(SHAPE_BASIS, axis1=1, axis2=2)).max() < 1e-15
    u = rng.normal(size=(50_000, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    found = bulge(np.array([0.1, -0.2, 0.3, 0.1, 0.2]), u)
    assert np.sum(found * u, axis=1).mean() == pytest.approx(0.0, abs=0.005)
    assert bulge(np.ones(5), -u) == pytest.approx(-bulge(np.ones(5), u))
    assert not bulge(np.ones(5), np.full((1, 3), np.nan)).any()


def test_a_model_is_the_same_after_a_night_as_arrays():
    loaded = BodyModel.from_arrays(TREE.to_arrays() | {"stamp": np.array("x")})
    for field in dataclasses.fields(BodyModel):
        ours, theirs = getattr(TREE, field.name), getattr(loaded, field.name)
        if isinstance(ours, np.ndarray):
            assert np.array_equal(ours, theirs, equal_nan=ours.dtype.kind == "f")
            assert ours.dtype == theirs.dtype
        else:
            assert ours == theirs
            assert type(ours) is type(theirs)


def test_a_rejected_model_knows_nothing_and_says_why():
    model = rejected(
        "off", joint_names=("a", "b"), kernel_part=np.array([0, 0, 1]), num_rows=7, num_receptors=4
    )
    assert not model.accepted
    assert model.reason == "off"
    assert model.accepted_by_part.tolist() == [False, False]
    assert np.isnan(model.place(np.zeros((3, 2)), np.arange(3))).all()
    assert np.isnan(model.receptors().place).all()
    assert np.isnan(model.link_poses(np.zeros((1, 2)))[:, :-1]).all()


def test_it_is_accepted_if_every_part_is():
    assert TREE.accepted
    half = dataclasses.replace(TREE, accepted_by_part=np.array([True, False]))
    assert not half.accepted


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"twists": np.zeros((6, 5))}, "twists has shape (6, 5), expected (6, 6)"),
        ({"joint_parent": np.array([-1, 5, 0, -2, 1, 6])}, "joint_parent has 6, expected -2 to 5"),
        (
            {"joint_parent": np.array([-1, 4, 0, -2, 1, 0])},
            "joint_parent has a ring through joint b",
        ),
        ({"joint_parent": np.array([-1, 3, 0, -2, 1, 0])}, "joint b stands on d, which is unused"),
        (
            {"joint_parent": np.full(6, -1)},
            "joint_kind is 0 for exactly the joints whose joint_parent is -2",
        ),
        ({"part_link": np.array([3, -1])}, "part_link names joint d, which is unused"),
        ({"toucher_link": np.array([3])}, "toucher_link names joint d, which is unused"),
        ({"toucher_place": np.zeros((2, 3))}, "toucher_place has shape (2, 3), expected (1, 3)"),
        ({"kernel_part": np.array([0, 2])}, "kernel_part has 2, expected 0 to 1"),
        ({"kernel_toucher": np.array([0, 1, 0])}, "kernel_toucher has 1, expected -1 to 0"),
        ({"kernel_toucher": np.zeros(3)}, "kernel_toucher must hold whole numbers"),
        ({"accepted_by_part": np.ones(2)}, "accepted_by_part must hold booleans"),
        ({"joint_names": tuple("aacdef")}, "joint_names are a, a, c, d, e, f: give each once"),
        ({"twists": np.full((6, 6), np.nan)}, "twists must hold finite numbers for joints in use"),
        ({"toucher_place": np.full((1, 3), np.nan)}, "toucher_place must hold finite numbers"),
    ],
)
def test_invalid_models_are_refused(changed, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        dataclasses.replace(TREE, **changed)


@pytest.mark.parametrize(
    ("q", "target", "message"),
    [
        (np.zeros((2, 5)), [0, 1], "q has shape (2, 5), expected (any, 6)"),
        (
            np.zeros((2, 6)),
            [0],
            "target is int64 (1,); give 2 whole numbers, one for each row of q",
        ),
        (np.zeros((2, 6)), [0, 2], "target must name target sensations 0 to 1"),
    ],
)
def test_invalid_questions_are_refused(q, target, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        TREE.place(q, np.array(target))


def test_arrays_of_another_version_are_refused_by_their_version():
    arrays = TREE.to_arrays() | {"version": np.array(0)}
    del arrays["twists"]
    with pytest.raises(VersionError, match=r"^version is 0, expected 1$"):
        BodyModel.from_arrays(arrays)
    with pytest.raises(ValueError, match=r"^twists is missing$"):
        BodyModel.from_arrays(arrays | {"version": np.array(1)})
    with pytest.raises(ValueError, match=r"^joint_names is float64 \(6, 6\), expected texts in a"):
        BodyModel.from_arrays(TREE.to_arrays() | {"joint_names": TWISTS})
