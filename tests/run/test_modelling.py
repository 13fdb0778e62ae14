"""The body model of a run: found, kept, read back, scored, and refused when it is not sound."""

import dataclasses
import json
import subprocess
import sys

import numpy as np
import pytest
from commands import refused, selftouch
from modelled import found_by, true_model

import selftouch_drake.run
from selftouch_drake.agent.body_model.model import BodyModel, rejected
from selftouch_drake.evaluation.shape import kernel_truth
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.files import load_arrays, save_arrays
from selftouch_drake.run import load_agent, load_body_model, stages
from selftouch_drake.run.artifacts import load_representation, save_body_model, stored_sensations
from selftouch_drake.run.directory import MissingError, RunDirectory, RunError

#: Files that the body model leaves as they are.
OF_THE_PAPER = ("representation.npz", "touch_model.npz", "topology.npz", "body_distances.npz")


def of_the_paper(run):
    return {name: (run.path / name).read_bytes() for name in OF_THE_PAPER}


@pytest.fixture
def run(small_run):
    """A small run of the cube that has learned all but its body model."""
    small_run.body_model.unlink()
    return small_run


@pytest.fixture
def perfect(run, cube_world):
    """What a perfect agent would find."""
    representation = load_representation(run)
    contacts = ExperienceReader(run.truth).take_contacts(representation.kernel_row)
    return true_model(
        cube_world, representation, kernel_truth(representation, contacts, cube_world.receptor_skin)
    )


def never(**given):
    raise AssertionError("nobody asked for a model")


def test_learning_asks_for_a_model_of_what_was_learned(run, perfect, monkeypatch):
    asked = {}

    def find(**given):
        asked.update(given)
        given["progress"](0.5, "half of it")
        return perfect

    found_by(monkeypatch, find)
    before, reports = of_the_paper(run), []
    stages.learn(run, lambda fraction, doing: reports.append((fraction, doing)))
    representation = load_representation(run)
    assert asked["q"].dtype == float
    assert np.array_equal(asked["q"], representation.kernel_q)
    assert (asked["sensation"] != stored_sensations(run, representation)).nnz == 0
    for kernel in range(representation.num_targets):
        assert (asked["target"][representation.members(kernel)] == kernel).all()
    assert np.array_equal(asked["part"], representation.part)
    assert asked["joint_names"][:2] == ["shoulder_yaw", "shoulder_pitch"]
    assert asked["seed"] == run.experiment.seed
    assert list(asked["each"](len, ["a", "bc"])) == [1, 2]
    assert not asked["double"].any()
    assert (0.7, "half of it") in [(pytest.approx(f), doing) for f, doing in reports]
    fractions = [fraction for fraction, _ in reports]
    assert fractions == sorted(fractions)
    assert of_the_paper(run) == before
    found = load_body_model(run)
    assert found.accepted
    assert np.array_equal(found.twists, perfect.twists)
    metrics = run.metrics()
    assert metrics["body_model_accepted"] == 1.0
    assert metrics["body_model_wall_s"] >= 0.0


def test_interrupted_in_the_fit_a_run_is_whole_and_goes_on_there(run, perfect, monkeypatch):
    before = of_the_paper(run)

    def stopped(**given):
        raise KeyboardInterrupt

    found_by(monkeypatch, stopped)
    assert selftouch("learn", run.path).status == 130
    assert of_the_paper(run) == before
    assert not run.body_model.exists()
    assert load_agent(run).representation.num_targets == 60
    found_by(monkeypatch, lambda **given: perfect)
    monkeypatch.setattr(
        "selftouch_drake.agent.representation.learning.learn", lambda *_, **__: never()
    )
    assert selftouch("learn", run.path).status == 0
    assert of_the_paper(run) == before
    assert load_body_model(run).accepted


def test_a_run_that_lacks_its_model_is_finished_by_run(run, perfect, monkeypatch):
    found_by(monkeypatch, lambda **given: perfect)
    monkeypatch.setattr("selftouch_drake.show.outputs.write_report", lambda run, *_, **__: "drawn")
    file = run.path / "experiment.yaml"
    file.write_text(file.read_text().replace("shape_metrics: null", "shape_metrics: []"))
    done = selftouch("run", run.path / "experiment.yaml", "--out", run.path, "--workers", 1)
    assert done.status == 0, done.stderr
    assert load_body_model(run).accepted
    # What was evaluated without it is evaluated again.
    metrics = run.metrics()
    assert 0.1 < metrics["body_model_place_error_percent"] < 1.5
    worst = metrics["body_model_place_error_worst_percent"]
    assert worst == metrics["body_model_place_error_percent"]
    assert metrics["body_model_kernel_error_percent"] > 0.0
    assert "body_model_place_error_percent_by_skin" not in metrics
    assert "body model: accepted: 6 joints turn; 97% of the held-out touches" in done.stdout


def test_touches_that_were_added_since_are_learned_first(run, perfect, monkeypatch):
    # The shape of the body does not matter here, and this metric trains no networks.
    file = run.path / "experiment.yaml"
    file.write_text(file.read_text().replace("metric: learned", "metric: sensorimotor"))
    run = RunDirectory.open(run.path)
    added = run.path / "added"
    added.mkdir()
    shard = run.experience / "part-00000.parquet"
    (added / shard.name).write_bytes(shard.read_bytes())
    found_by(monkeypatch, lambda **given: no_model(len(given["q"]), given["part"]))
    stages.learn(run)
    assert load_representation(run).num_touches == 2500


def no_model(num_rows, part):
    return rejected(
        "nothing fits",
        joint_names=[f"joint_{number}" for number in range(6)],
        kernel_part=part,
        num_rows=num_rows,
        num_receptors=100,
    )


def test_without_a_model_all_else_is_the_same_to_the_byte(run, monkeypatch):
    before = of_the_paper(run)
    found_by(monkeypatch, never)
    off = with_setting(run, "off")
    stages.learn(off)
    assert of_the_paper(off) == before
    model = load_body_model(off)
    assert (model.accepted, model.reason) == (False, "off")
    assert not [name for name in off.metrics() if name.startswith("body_model")]
    done = selftouch("model", off.path)
    assert done.status == 0
    assert done.stdout == (
        "body model: off\n"
        "The agent was not asked for a body model: representation.body_model is off.\n"
    )


def with_setting(run, setting):
    file = run.path / "experiment.yaml"
    file.write_text(file.read_text().replace("body_model: auto", f"body_model: {setting}"))
    return RunDirectory.open(run.path)


def test_an_answer_that_was_not_asked_for_is_no_answer(run, monkeypatch):
    """A run whose setting was changed by hand learns the model anew, and nothing else."""
    found_by(monkeypatch, never)
    stages.learn(with_setting(run, "off"))
    asked = with_setting(run, "off")
    file = run.path / "experiment.yaml"
    file.write_text(file.read_text().replace("body_model: off", "body_model: auto"))
    asked = RunDirectory.open(run.path)
    assert stages.has_learned(asked)
    assert not stages.has_modelled(asked)
    with pytest.raises(RunError, match="belongs to another experiment or version; run `selftouch"):
        load_body_model(asked)


def test_a_model_that_is_not_there_is_named_with_the_remedy(run):
    line = refused("model", run.path)
    assert line == (
        f"{run.path} has no body model yet; run `selftouch learn {run.path}`, which adds it"
    )
    with pytest.raises(MissingError, match="has no body model yet"):
        load_body_model(run)
    run.representation.unlink()
    assert refused("model", run.path) == (
        f"{run.path} has learned nothing yet; run `selftouch learn {run.path}`"
    )
    assert refused("evaluate", run.path).startswith(f"{run.path} has learned nothing yet")


@pytest.mark.parametrize("command", ["model", "evaluate", "report"])
def test_a_damaged_model_is_refused_in_one_line(command, run, perfect):
    save_body_model(run, perfect)
    whole = run.body_model.read_bytes()
    for damaged in (b"", bytes(range(256)) * 9, whole[: len(whole) // 2], run.skin.read_bytes()):
        run.body_model.write_bytes(damaged)
        assert str(run.body_model) in refused(command, run.path)
        assert run.body_model.read_bytes() == damaged


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"version": 0}, "{} was made by another version of this program; {}"),
        ({"twists": np.zeros((6, 5))}, "{} is not a body model: twists has shape (6, 5), expected"),
        ({"made_for": "other"}, "{} belongs to another experiment or version; {}"),
        (
            {"kernel_part": np.zeros(59, int), **dict.fromkeys(("kernel_place", "kernel_normal"))},
            "{} has 59 targets over 100 receptors, the experiment 60 over 100; {}",
        ),
    ],
)
def test_an_old_or_foreign_model_is_refused_in_one_line(changed, message, run, perfect):
    save_body_model(run, perfect)
    changed = {k: np.zeros((59, 3)) if v is None else np.array(v) for k, v in changed.items()}
    save_arrays(run.body_model, load_arrays(run.body_model) | changed)
    remedy = f"run `selftouch learn {run.path}`"
    assert refused("model", run.path).startswith(message.format(run.body_model, remedy))
    assert not stages.has_modelled(run)


def test_a_model_is_printed_as_tables(run, perfect):
    sigma = perfect.twist_sigma.copy()
    sigma[5] = np.nan
    group = perfect.order_group.copy()
    group[3:5] = 0
    save_body_model(run, dataclasses.replace(perfect, twist_sigma=sigma, order_group=group))
    done = selftouch("model", run.path)
    assert done.status == 0
    text = " ".join(done.stdout.split())
    assert text.startswith(
        "body model: accepted Assumed: rigid links on joints that turn or slide. Tested on touches "
        "that the fit did not see. Held-out touches agree."
    )
    assert "base (wears part 0)" in text
    assert "└─ shoulder_yaw > shoulder_pitch > elbow_pitch > wrist_x > wrist_y > wrist_z (" in text
    assert "97.0%" in text
    assert "Touch cannot tell: one length" in text


def test_names_of_joints_are_kept_by_who_builds_the_robot(run, finished_run):
    names = json.loads((finished_run / "joints.json").read_text())
    assert names[0] == "shoulder_yaw"
    run.joints.write_text("{")
    assert refused("learn", run.path) == (
        f"{run.joints} is damaged; delete it, and the joints get numbers"
    )


def test_an_older_run_looks_the_names_up(run, perfect, monkeypatch):
    run.joints.unlink()
    asked = []
    found_by(monkeypatch, lambda **given: asked.append(given["joint_names"]) or perfect)
    stages.learn(run)
    assert asked[0][0] == "shoulder_yaw"


def test_a_run_may_be_named_by_its_path(run, perfect):
    save_body_model(run, perfect)
    for named in (run, run.path, str(run.path)):
        assert load_body_model(named).accepted
        assert load_agent(named).representation.num_targets == 60
    with pytest.raises(AttributeError, match="there is no 'load_truth'; known are"):
        selftouch_drake.run.load_truth  # noqa: B018 - it is missing
    assert {"load_agent", "load_body_model"} <= set(selftouch_drake.run.__all__)


def test_the_package_of_runs_imports_nothing_by_itself():
    program = "import sys, selftouch_drake.run; print('numpy' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert told.stdout.strip() == "False"


def test_a_model_is_the_same_after_a_night(run, perfect):
    save_body_model(run, perfect)
    found = load_body_model(run)
    q, target = np.random.default_rng(0).uniform(-1, 1, (50, 6)), np.arange(50)
    assert isinstance(found, BodyModel)
    assert np.array_equal(found.place(q, target), perfect.place(q, target))
    assert found.joint_names == perfect.joint_names
