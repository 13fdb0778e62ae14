"""The body model of a run, taken home: files, metres, mirror image, and what is refused."""

import csv
import dataclasses
import warnings

import numpy as np
import pytest
import trimesh
from commands import files_below, refused, selftouch
from modelled import true_model
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.model import UNUSED, JointKind, rejected
from selftouch_drake.evaluation.shape import kernel_truth
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World
from selftouch_drake.robot.skins import MovedReceptorsWarning
from selftouch_drake.run.artifacts import load_representation, save_body_model

#: The tables are read by programs of others.
JOINT_COLUMNS = ["joint", "kind", "scale", "offset", "lower", "upper", "sigma", "used"]
RECEPTOR_COLUMNS = ["name", "part", "x", "y", "z", "nx", "ny", "nz", "sigma"]
#: The arm of the cube: its links are 0.4 m long.
LENGTH = ("--length", "shoulder_pitch", "elbow_pitch", 0.4)


@pytest.fixture
def truth(small_run, cube_world):
    representation = load_representation(small_run)
    contacts = ExperienceReader(small_run.truth).take_contacts(representation.kernel_row)
    return kernel_truth(representation, contacts, cube_world.receptor_skin)


@pytest.fixture
def perfect(small_run, cube_world, truth):
    """What a perfect agent would find, in a unit of its own, and mirrored.

    60 of 100 receptors were met, each in the middle of a kernel.
    """
    representation = load_representation(small_run)
    model = true_model(cube_world, representation, truth)
    # Kernels lie where the centre of the toucher was, and not where the skin is.
    target = np.repeat(np.arange(60), np.diff(representation.kernel_offsets))
    centres = model.place(representation.kernel_q, target)
    place = np.array([centres[target == kernel].mean(axis=0) for kernel in range(60)])
    normal = place - place.mean(axis=0)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    unmet = np.full((40, 3), np.nan)
    return dataclasses.replace(
        model,
        kernel_place=place,
        kernel_normal=normal,
        receptor_part=np.repeat([0, -1], [60, 40]),
        receptor_place=np.concatenate([place, unmet]),
        receptor_normal=np.concatenate([normal, unmet]),
        receptor_sigma=np.repeat([0.01, np.nan], [60, 40]),
    )


@pytest.fixture
def run(small_run, perfect):
    save_body_model(small_run, perfect)
    return small_run


def table(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def toucher_places(file, q):
    """`(n, 3)` where a file has the toucher, seen from the skin, at readings in rad."""
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(file))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    names = [row["joint"] for row in table(file.with_name(f"{file.stem}_joints.csv"))]
    joints = [plant.GetJointByName(name) for name in names]
    found = []
    for row in q:
        for joint, angle in zip(joints, row, strict=True):
            joint.set_angle(context, angle)
        X_WT, X_WP = (
            plant.GetFrameByName(name).CalcPoseInWorld(context) for name in ("toucher_0", "part_0")
        )
        found.append((X_WP.inverse() @ X_WT).translation())
    return np.array(found)


def handedness(places, true):
    """Places without their mean, the same of the true ones, and the sign of the turn between."""
    a, b = places - places.mean(axis=0), true - true.mean(axis=0)
    turn = np.linalg.lstsq(a, b, rcond=None)[0]
    return a @ turn - b, turn


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("suffix", ["urdf", "sdf", "xml"])
def test_one_known_length_makes_it_the_robot_in_metres(run, cube_world, tmp_path, suffix, mirror):
    file = tmp_path / "home" / f"cube.{suffix}"
    done = selftouch("model", run.path, "--urdf", file, *LENGTH, *["--mirror"] * mirror)
    assert done.status == 0, done.stderr
    assert "Lengths are in metres" in done.stdout
    q = np.random.default_rng(0).uniform(-1, 1, size=(30, 6))
    X_WF = cube_world.robot.kinematics.poses(q)
    true = np.einsum("nji,nj->ni", X_WF[:, 0, :, :3], X_WF[:, 1, :, 3] - X_WF[:, 0, :, 3])
    rest, turn = handedness(toucher_places(file, q), true)
    np.testing.assert_allclose(rest, 0.0, atol=1e-9)
    # The perfect model is the mirror image.
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-7)
    assert np.sign(np.linalg.det(turn)) == (1 if mirror else -1)


def test_tables_hold_scales_limits_and_receptors(run, perfect, tmp_path):
    file = tmp_path / "cube.urdf"
    done = selftouch("model", run.path, "--urdf", file, *LENGTH, "--depth", 0.003)
    assert done.status == 0, done.stderr
    q = load_representation(run).kernel_q
    joints = table(tmp_path / "cube_joints.csv")
    assert list(joints[0]) == JOINT_COLUMNS
    assert [row["joint"] for row in joints] == list(perfect.joint_names)
    for column, row in enumerate(joints):
        assert (row["kind"], row["offset"], row["used"]) == ("turns", "0.0", "true")
        assert float(row["scale"]) == pytest.approx(1.0)
        assert float(row["sigma"]) == pytest.approx(0.001)
        assert float(row["lower"]) == pytest.approx(q[:, column].min())
        assert float(row["upper"]) == pytest.approx(q[:, column].max())
    rows = table(tmp_path / "cube_receptors.csv")
    assert list(rows[0]) == RECEPTOR_COLUMNS
    assert [row["name"] for row in rows] == [f"body[{n}]" for n in range(100)]
    assert set(rows[-1].values()) == {"body[99]", ""}
    found = np.array([[float(row[c]) for c in "xyz"] for row in rows[:60]])
    # They are on the surface, of which 60 corners tell little.
    expected = perfect.receptor_place[:60] / 3.7
    assert np.linalg.norm(found - expected, axis=1).max() < 0.03
    surface = trimesh.load_mesh(tmp_path / "cube_part_0.obj")
    normal = np.array([[float(row[c]) for c in ("nx", "ny", "nz")] for row in rows[:60]])
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0)
    near = cKDTree(surface.sample(200_000)).query(found)[0]
    assert np.median(near) < 0.003
    assert float(rows[0]["sigma"]) == pytest.approx(0.01 / 3.7)


@pytest.mark.parametrize("depth", [0.0, 0.01])
def test_a_known_distance_of_receptors_is_theirs_in_the_file(run, tmp_path, depth):
    file = tmp_path / "cube.urdf"
    known = ("--distance", "body[3]", 40, 0.35, "--depth", depth)
    assert selftouch("model", run.path, "--urdf", file, *known).status == 0
    rows = table(tmp_path / "cube_receptors.csv")
    first, second = ([float(rows[number][c]) for c in "xyz"] for number in (3, 40))
    assert np.linalg.norm(np.subtract(first, second)) == pytest.approx(0.35)


def test_without_a_length_the_unit_is_said_to_be_arbitrary(run, tmp_path):
    file = tmp_path / "cube.urdf"
    done = selftouch("model", run.path, "--urdf", file, "--urdf", file.with_suffix(".xml"))
    assert done.status == 0, done.stderr
    for text in (done.stdout, file.read_text(), file.with_suffix(".xml").read_text()):
        assert "engths are in an arbitrary unit" in text
        assert "masses, inertias, efforts and velocities are made up" in text.lower()


def test_only_accepted_parts_are_written_unless_asked(run, perfect, tmp_path):
    two = {
        "kernel_part": np.repeat([0, 1], 30),
        "part_link": np.array([-1, -1]),
        "accepted_by_part": np.array([False, True]),
        **{name: np.repeat(getattr(perfect, name), 2) for name in ("held_out", "inliers")},
        **{name: np.repeat(getattr(perfect, name), 2) for name in ("criterion", "num_touches")},
    }
    save_body_model(run, dataclasses.replace(perfect, **two))
    for more, expected in (((), {"part_1"}), (("--rejected",), {"part_0", "part_1"})):
        file = tmp_path / f"cube{len(more)}.urdf"
        assert selftouch("model", run.path, "--urdf", file, *more).status == 0
        text = file.read_text()
        assert {n for n in ("part_0", "part_1") if f'<link name="{n}"' in text} == expected


def test_unknown_joints_and_open_ones_are_kept_and_said(run, perfect, tmp_path):
    kind, parent = perfect.joint_kind.copy(), perfect.joint_parent.copy()
    order = np.argsort(parent)
    last = order[-1]
    kind[last], parent[last] = JointKind.UNUSED, UNUSED
    kind[order[0]] = JointKind.OPEN
    twists = perfect.twists.copy()
    twists[last] = 0.0
    above = perfect.joint_parent[last]
    less = dataclasses.replace(
        perfect, joint_kind=kind, joint_parent=parent, twists=twists,
        toucher_link=np.full(1, above), part_link=perfect.part_link,
    )  # fmt: skip
    save_body_model(run, less)
    file = tmp_path / "cube.urdf"
    assert selftouch("model", run.path, "--urdf", file).status == 0
    rows = {row["joint"]: row for row in table(tmp_path / "cube_joints.csv")}
    name, text = perfect.joint_names[last], file.read_text()
    assert (rows[name]["kind"], rows[name]["used"]) == ("unused", "false")
    assert f"{name} is of no use to the model" in text
    assert f"{perfect.joint_names[order[0]]} is open" in text
    assert text.count('type="revolute"') == 6


def test_the_export_is_an_experiment_that_is_touched_where_the_body_was(run, tmp_path):
    file = tmp_path / "again.urdf"
    # In a soft skin the centre of the finger sinks below the surface.
    known = (*LENGTH, "--mirror", "--depth", 0.014)
    done = selftouch("model", run.path, "--urdf", file, *known)
    assert done.status == 0, done.stderr
    assert f"experiment: {tmp_path / 'again_experiment.yaml'}" in done.stdout.splitlines()
    shown = selftouch("robot", tmp_path / "again_experiment.yaml")
    assert shown.status == 0, shown.stderr
    assert "toucher_0  on again::toucher_0  touches part_0" in shown.stdout
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MovedReceptorsWarning)
        again = World(load_experiment(tmp_path / "again_experiment.yaml"))
    assert again.robot.num_joints == 6
    q = load_representation(run).kernel_q
    # 60 places are the corners of a coarse cube.
    assert len(again.probe.felt_rows(q)[0]) > 0.5 * len(q)
    rng = np.random.default_rng(0)
    anywhere = rng.uniform(*again.robot.babbled_range, size=(5000, 6))
    assert len(again.probe.felt_rows(anywhere)[0]) < 0.1 * len(anywhere)


def test_there_is_no_experiment_without_metres_and_depth(run, tmp_path):
    for number, known in enumerate([(), LENGTH]):
        file = tmp_path / f"cube_{number}.urdf"
        done = selftouch("model", run.path, "--urdf", file, *known)
        assert done.status == 0, done.stderr
        assert list(tmp_path.glob("*.yaml")) == []


def refusals():
    yield ("--urdf", "cube.obj"), "--urdf is cube.obj, of an unknown format; end it in .urdf"
    yield ("--length", "a", "b", 0.1), "--length is given without --urdf"
    yield ("--depth", 0.1), "--depth is given without --urdf"
    yield ("--mirror",), "--mirror is given without --urdf"
    for words, text in [
        ((*LENGTH, "--distance", "0", "1", 0.1), "--length and --distance are both given"),
        (("--depth", 0.01), "--depth is 0.01 m, but no length of the body is known"),
        (("--length", "shoulder_pich", "elbow_pitch", 0.4), "did you mean shoulder_pitch?"),
        (("--length", "wrist_x", "wrist_y", 0.4), "the axes of wrist_x and wrist_y meet"),
        (("--length", "shoulder_pitch", "elbow_pitch", 0), "0 m; give a positive number"),
        (("--distance", "0", "body[99]", 0.4), "receptor body[99] was never met"),
    ]:
        yield ("--urdf", "cube.urdf", *words), text


@pytest.mark.parametrize(("words", "text"), list(refusals()))
def test_what_does_not_fit_is_refused_and_nothing_is_written(
    run, tmp_path, monkeypatch, words, text
):
    folder = tmp_path / "empty"
    folder.mkdir()
    monkeypatch.chdir(folder)
    assert text in refused("model", run.path, *words)
    assert files_below(folder) == {}


@pytest.mark.parametrize("reason", ["off", "nothing fits"])
def test_a_model_that_is_none_is_refused(run, perfect, tmp_path, reason):
    nothing = rejected(
        reason, joint_names=perfect.joint_names, kernel_part=perfect.kernel_part,
        num_rows=len(perfect.kernel_toucher), num_receptors=100,
    )  # fmt: skip
    save_body_model(run, nothing)
    file = tmp_path / "cube.urdf"
    line = refused("model", run.path, "--urdf", file, "--rejected")
    assert ("is off" if reason == "off" else "rejected: nothing fits") in line
    assert not file.exists()


def test_a_rejected_model_is_refused_unless_asked(run, perfect, tmp_path):
    no = dataclasses.replace(
        perfect, accepted_by_part=np.array([False]), reason="rejected: too few touches."
    )
    save_body_model(run, no)
    file = tmp_path / "cube.urdf"
    line = refused("model", run.path, "--urdf", file)
    assert "was not accepted (rejected: too few touches" in line
    assert "give --rejected" in line
    assert not file.exists()
    assert selftouch("model", run.path, "--urdf", file, "--rejected").status == 0
    assert "rejected: too few touches" in file.read_text()
