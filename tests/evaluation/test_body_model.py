import dataclasses

import numpy as np
import pytest
from modelled import UNKNOWN, true_model

from selftouch_drake.agent.body_model.model import UNUSED, JointKind
from selftouch_drake.evaluation.body_model import (
    Similarity,
    angles_between,
    contacts_of_rows,
    found_axes,
    onto_robot,
    place_errors,
    summary,
    true_axes,
)
from selftouch_drake.evaluation.shape import KernelTruth, kernel_truth
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.robot import World
from selftouch_drake.run.artifacts import load_representation
from selftouch_drake.run.directory import RunDirectory

rng = np.random.default_rng(0)


@pytest.fixture(scope="module")
def cube(finished_run, cube_world):
    """World, representation, contacts and truth of the small run of the cube."""
    run = RunDirectory.open(finished_run)
    representation = load_representation(run)
    contacts = ExperienceReader(run.truth).take_contacts(representation.kernel_row)
    truth = kernel_truth(representation, contacts, cube_world.receptor_skin)
    return cube_world, representation, contacts, truth


def test_a_similarity_is_found_again():
    places = rng.normal(size=(20, 3))
    found = Similarity.fitted(places, UNKNOWN(places))
    assert found.scale == pytest.approx(UNKNOWN.scale)
    assert found.rotation == pytest.approx(UNKNOWN.rotation)
    assert found.shift == pytest.approx(UNKNOWN.shift)
    assert found.mirrors
    assert not Similarity.fitted(places, 2.0 * places).mirrors
    with pytest.raises(ValueError, match=r"^3 places fix no similarity; give 4$"):
        Similarity.fitted(places[:3], places[:3])


def test_the_true_model_imagines_where_the_finger_touches(cube):
    _, representation, contacts, truth = cube
    model = true_model(*cube[:2], truth)
    (error,) = place_errors(model, representation, contacts, truth).values()
    # A fingertip of a centimetre, on a cube with a diagonal of 76.
    assert 0.1 < error.place < 1.5
    assert error.kernel < error.place
    assert error.share_known == 1.0
    assert error.part == 0


def test_the_error_is_in_percent_of_the_skin(cube):
    world, representation, contacts, truth = cube
    model = true_model(world, representation, truth)
    true = contacts_of_rows(representation, contacts, truth)
    sizes = np.diff(representation.kernel_offsets)
    target = np.repeat(np.arange(len(sizes)), sizes)
    off = rng.normal(size=true.shape)

    class Imagined:
        kernel_part, accepted_by_part = model.kernel_part, model.accepted_by_part

        @staticmethod
        def place(q, of):
            assert np.array_equal(of, target)
            return UNKNOWN(true + 0.02 * off)

    (error,) = place_errors(Imagined, representation, contacts, truth).values()
    extent = np.linalg.norm(np.ptp(true, axis=0))
    assert error.place == pytest.approx(100 * 0.02 * np.sqrt(3) / extent, rel=0.02)
    assert error.kernel == pytest.approx(error.place / np.sqrt(np.median(sizes)), rel=0.3)


def test_a_wrong_model_is_seen_to_be_wrong(cube):
    world, representation, contacts, truth = cube
    right = true_model(world, representation, truth)
    bent = dataclasses.replace(right, twists=right.twists + 0.1 * rng.normal(size=(6, 6)))
    good, bad = (place_errors(m, representation, contacts, truth)[0].place for m in (right, bent))
    assert bad > 3 * good


def test_a_rejected_part_has_no_score(cube):
    world, representation, contacts, truth = cube
    model = true_model(world, representation, truth, accepted_by_part=np.zeros(1, dtype=bool))
    assert place_errors(model, representation, contacts, truth) == {}
    assert summary({}, ["body"]) == {}
    assert onto_robot(model, truth, np.zeros((1, 3, 4)), np.zeros(6)) is None


def test_touches_of_two_places_at_once_have_no_place_of_their_own(cube, hand):
    _, representation, *_ = cube
    truth = KernelTruth(
        skin=np.zeros(representation.num_targets, dtype=int),
        positions=np.zeros((representation.num_targets, 3)),
        spread=np.zeros(representation.num_targets),
        share_single=1.0,
    )
    hand.touch((0, 0, [1.0, 2.0, 3.0])).touch((0, 0, [1.0, 0, 0]), (0, 1, [2.0, 0, 0]))
    hand.touch((1, 0, [5.0, 0, 0])).touch((0, 0, [4.0, 0, 0]), (1, 0, [2.0, 0, 0]))
    hand.touch_all(np.zeros((representation.num_rows - 4, 3)))
    found = contacts_of_rows(representation, hand.contacts(), truth)
    assert found[:1].tolist() == [[1.0, 2.0, 3.0]]
    assert np.isnan(found[1:3]).all()
    assert found[3].tolist() == [4.0, 0.0, 0.0]


@pytest.mark.parametrize("kind", ["cube", "gantry", "two_arms"])
def test_axes_of_the_true_model_are_those_of_the_robot(kind, robot_of):
    world, representation, truth, X_WL, q = robot_of(kind)
    model = true_model(world, representation, truth)
    onto = onto_robot(model, truth, X_WL, q)
    assert onto.scale == pytest.approx(1 / UNKNOWN.scale)
    true, found = true_axes(world.robot.kinematics, q), found_axes(model, q).moved(onto)
    assert angles_between(found, true) == pytest.approx(0.0, abs=1e-4)
    # A place on the axis of a joint that turns is on the axis.
    off = np.cross(found.place - true.place, true.direction)[world.robot.turns]
    assert np.abs(off).max() < 1e-9


def test_an_axis_that_is_off_by_some_degrees_is(robot_of):
    world, representation, truth, X_WL, q = robot_of("cube")
    model = true_model(world, representation, truth)
    twists, kind, parent = model.twists.copy(), model.joint_kind.copy(), model.joint_parent.copy()
    w = twists[5, :3]
    aside = np.cross(w, [1.0, 0.0, 0.0])
    aside *= np.linalg.norm(w) / np.linalg.norm(aside)
    twists[5, :3] = np.cos(0.1) * w + np.sin(0.1) * aside
    model = dataclasses.replace(model, twists=twists)
    true = true_axes(world.robot.kinematics, q)
    onto = onto_robot(model, truth, X_WL, q)
    off = angles_between(found_axes(model, q).moved(onto), true)
    assert off[5] == pytest.approx(np.degrees(0.1), abs=1e-6)
    assert off[:5] == pytest.approx(0.0, abs=1e-4)
    # A joint that matters nowhere has no axis.
    parent[5], kind[5] = UNUSED, JointKind.UNUSED
    model = dataclasses.replace(
        model, joint_parent=parent, joint_kind=kind, toucher_link=np.array([4])
    )
    assert np.isnan(found_axes(model, q).direction[5]).all()


def test_metrics_of_several_skins_name_the_worst(cube):
    world, representation, contacts, truth = cube
    model = true_model(world, representation, truth)
    error = place_errors(model, representation, contacts, truth)[0]
    errors = {0: error, 2: dataclasses.replace(error, place=9.0, kernel=7.0)}
    found = summary(errors, ["torso", "head", "hand"])
    assert found["body_model_place_error_percent"] == pytest.approx((error.place + 9.0) / 2)
    assert found["body_model_place_error_worst_percent"] == 9.0
    assert found["body_model_kernel_error_percent"] == pytest.approx((error.kernel + 7.0) / 2)
    assert found["body_model_place_error_percent_by_skin"] == {"torso": error.place, "hand": 9.0}


@pytest.fixture
def robot_of():
    """A robot in some posture, and kernels that are laid on its skins by hand."""

    def made(kind):
        from selftouch_drake.experiment import load_experiment

        world = World(load_experiment(kind))
        fields = [skin.fields for skin in world.skins]
        skin = np.repeat(np.arange(len(fields)), 20)
        positions = np.concatenate([f.vertices[:: len(f.vertices) // 20][:20] for f in fields])
        truth = KernelTruth(
            skin=skin, positions=positions, spread=np.zeros(len(skin)), share_single=1.0
        )

        class Laid:
            part, num_targets, num_rows = skin, len(skin), 5
            target_sensations = np.zeros((len(skin), 3))

        q = rng.uniform(-1, 1, world.robot.num_joints)
        return world, Laid, truth, world.robot.skin_positions(q[None])[0], q

    return made
