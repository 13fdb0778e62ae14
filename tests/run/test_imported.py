"""Data that another robot recorded: imported, learned from, planned on and reported; no world."""

import csv
import html
import json
import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from modelled import found_by
from untrained import train_nothing

from benchmarks.shared.raw_skin import fibonacci, recorded
from selftouch_drake.agent.body_model.model import rejected
from selftouch_drake.cli import cli, exit_status
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.experiment import ExperimentError
from selftouch_drake.files import load_arrays
from selftouch_drake.run import imported, load_body_model, stages
from selftouch_drake.run import load_motion as from_python
from selftouch_drake.run.artifacts import load_motion
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.imported import imported_experiment, read_data
from selftouch_drake.run.naming import free_start
from selftouch_drake.show.page.report import far_apart
from selftouch_drake.show.run_data import RunData

ROOT = Path(__file__).parents[2]
NUM_ROWS, NUM_RECEPTORS, NUM_TARGETS = 20_000, 200, 150
SET = f"{{representation: {{num_targets: {NUM_TARGETS}, metric: sensorimotor}}}}"
SILENT = 7
#: Rows where neither touches nor their number matter.
NUM_LITTLE = 2000


@pytest.fixture(scope="module")
def recording():
    return recorded(NUM_ROWS, NUM_RECEPTORS)


@pytest.fixture(scope="module")
def data(recording, tmp_path_factory):
    """Two files with 7 joints and 200 eight-bit receptors, as a real robot writes them."""
    folder = tmp_path_factory.mktemp("data") / "my_robot"
    folder.mkdir()
    raw = recording.raw.copy()
    raw[:, SILENT] = 40
    q = recording.q.copy()
    q[11] = np.nan
    for number, rows in enumerate(np.array_split(np.arange(NUM_ROWS), 2)):
        table = {f"joint_{joint}": q[rows, joint] for joint in range(7)}
        table["taxels"] = pa.FixedSizeListArray.from_arrays(
            pa.array(raw[rows].reshape(-1)), NUM_RECEPTORS
        )
        table["timestamp"] = recording.time_s[rows]
        pq.write_table(pa.table(table), folder / f"part-{number}.parquet")
    return folder


@pytest.fixture(scope="module")
def little_data(recording, tmp_path_factory):
    """A file with the first rows of the recording."""
    path = tmp_path_factory.mktemp("data") / "little.npz"
    rows = slice(0, NUM_LITTLE)
    np.savez(path, q=recording.q[rows], touch=recording.raw[rows], time_s=recording.time_s[rows])
    return path


def selftouch(*words):
    return exit_status(lambda: cli.main(list(map(str, words)), standalone_mode=False))


def no_body_model(**given):
    return rejected(
        "rejected: 0.5 of the held-out touches agree.",
        joint_names=given["joint_names"],
        kernel_part=given["part"],
        num_rows=len(given["q"]),
        num_receptors=given["sensation"].shape[1],
    )


@pytest.fixture(scope="module")
def learned(data, tmp_path_factory):
    path = tmp_path_factory.mktemp("runs") / "run"
    assert selftouch("import", data, "--out", path, "--set", SET) == 0
    with pytest.MonkeyPatch.context() as patch:
        # To find none takes long; `test_joints_that_may_slide_are_no_body` does.
        found_by(patch, no_body_model)
        train_nothing(patch)
        assert selftouch("learn", path) == 0
    assert selftouch("plan", path, "--from", 3, "--to", 100) == 0
    return RunDirectory.open(path)


@pytest.fixture
def run(learned, tmp_path):
    shutil.copytree(learned.path, tmp_path / "run")
    return RunDirectory.open(tmp_path / "run")


def test_what_was_found_is_reported(data, tmp_path, capfd):
    assert selftouch("import", data, "--out", tmp_path / "run", "--set", SET) == 0
    out = capfd.readouterr().out
    assert f"rows: {NUM_ROWS:,}, of which 1 are incomplete and " in out
    assert "joints: 7 (joint_0, joint_1, joint_2, joint_3, joint_4, joint_5, joint_6)" in out
    assert "readings rise with pressure" in out
    assert out.endswith(f"run: {tmp_path / 'run'}\nnext: selftouch learn {tmp_path / 'run'}\n")
    assert "spikes: each reading is the median of three in time" in out
    assert "receptors that never read anything: 1 (taxels[7])" in out
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert metrics["import_num_rows"] == NUM_ROWS
    assert metrics["import_num_incomplete"] == 1
    assert metrics["import_silent_receptors"] == ["taxels[7]"]
    left_out = sum(metrics[f"import_num_{name}"] for name in ("incomplete", "null", "fading"))
    assert metrics["babbling_num_samples"] == NUM_ROWS - left_out
    calibration = load_arrays(tmp_path / "run" / "calibration.npz")
    assert calibration["threshold"].shape == (NUM_RECEPTORS,)
    assert calibration["level"].shape == (len(calibration["row"]), NUM_RECEPTORS)


def test_where_nothing_was_felt_is_kept_thinly(learned, data, monkeypatch):
    free = load_arrays(learned.free)
    found = read_data(data)
    touching = np.ones(len(found.recording.q), dtype=bool)
    touching[found.felt.null] = False
    last = np.flatnonzero(~touching[:-1] & touching[1:])
    first = np.flatnonzero(touching[:-1] & ~touching[1:]) + 1
    middle = NUM_ROWS // 2 - 1  # between the two files, one row short
    beside = np.setdiff1d(np.union1d(last, first), [middle - 1, middle])
    near = free["q"][free["next_to_touch"]]
    assert free["q"].dtype == np.float32
    assert {*map(bytes, found.recording.q[beside].astype(np.float32))} <= {*map(bytes, near)}
    assert len(beside) <= len(near) <= len(beside) + 2
    null = {*map(bytes, found.recording.q[found.felt.null].astype(np.float32))}
    assert {*map(bytes, free["q"])} <= null
    assert len(free["q"]) == len(found.felt.null)
    monkeypatch.setattr(imported, "_MOST_FREE", 100)
    few = imported.free_rows(found, seed=0)
    assert (len(few["q"]), few["next_to_touch"].sum()) == (100, 50)


def test_what_touched_can_be_chosen(recording, tmp_path, capfd):
    rows = slice(0, 12_000)
    finger = np.where(np.arange(12_000) // 3000 % 2, "left", "right")
    path = tmp_path / "a.npz"
    np.savez(path, q=recording.q[rows], touch=recording.raw[rows], finger=finger)
    overrides = ("--set", "{representation: {num_targets: 50}}")
    assert selftouch("import", path, "--out", tmp_path / "both", *overrides) == 0
    out = capfd.readouterr().out
    assert (
        "column finger holds 2 (left, right): if it says what touches, choose one by --rows" in out
    )
    options = ("--rows", "finger=left", "--filter", "none")
    assert selftouch("import", path, "--out", tmp_path / "left", *options, *overrides) == 0
    out = capfd.readouterr().out
    assert "rows: 6,000, of which 0 are incomplete" in out
    assert "spikes" not in out


def test_a_simulators_log_and_an_archive_give_the_same_touches(tmp_path, capfd):
    """A log in pyCub's format, with lists in columns; and an archive of transposed arrays."""
    made = recorded(4000, 60)
    names = ["r_elbow", "r_roll", "r_wrist", "r_yaw", "l_elbow", "l_roll", "l_yaw"]
    lines = [f"timestamp;steps_done;{';'.join(names)};torso;head"]
    for step, (time_s, q, raw) in enumerate(zip(made.time_s, made.q, made.raw, strict=True)):
        parts = [",".join(map(str, part.tolist())) for part in (raw[:40], raw[40:])]
        lines.append(";".join([str(time_s), str(step), *map(repr, q.tolist()), *parts]))
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    arrays = {"q": made.q.T, "touch": made.raw.T, "time_s": made.time_s}
    np.savez(tmp_path / "log.npz", **arrays, joint_names=np.array(names))
    columns = ("--q", "r_*,l_*", "--sensation", "torso,head")
    for file, options in (("log.csv", columns), ("log.npz", ())):
        settings = ("--out", tmp_path / file[4:], "--set", SET.replace("150", "50"))
        assert selftouch("import", tmp_path / file, *options, *settings) == 0
        out = capfd.readouterr().out
        assert f"joints: 7 ({', '.join(names)})" in out
        assert "receptors: 60 (" in out
    one, other = (RunDirectory.open(tmp_path / kind).experiment for kind in ("csv", "npz"))
    assert one.imported.content == other.imported.content
    assert one.imported.max_velocity == other.imported.max_velocity


def test_touches_are_stored_as_those_of_any_run(learned):
    reader = ExperienceReader(learned.experience)
    assert reader.num_rows == learned.experiment.babbling.num_samples
    assert reader.read("sensation").shape[1] == NUM_RECEPTORS
    assert reader.read("sensation").any(axis=1).all()
    assert reader.read("q").shape[1] == 7
    assert not learned.truth.exists()


def test_the_body_is_recovered_from_raw_readings(learned):
    metrics = learned.metrics()
    assert metrics["topology_betti"] == [1, 0, 1]
    assert metrics["intrinsic_dimension"] == pytest.approx(2.0, abs=0.25)
    assert metrics["topology_margin"] > 2


def test_a_good_shape_is_trusted(tmp_path):
    """A ball, a finger without error, and a joint that does nothing."""
    rng = np.random.default_rng(0)
    place = rng.normal(size=(6000, 3))
    place /= np.linalg.norm(place, axis=1, keepdims=True)
    apart = np.linalg.norm(place[:, None] - fibonacci(100), axis=2)
    data, path = tmp_path / "ball.npz", tmp_path / "run"
    q = np.hstack([place, rng.uniform(-0.1, 0.1, (6000, 1))])
    np.savez(data, q=q, touch=np.clip(1.0 - apart / 0.7, 0.0, None))
    settings = ("--out", path, "--set", SET.replace("metric", "body_model: off, metric"))
    assert selftouch("import", data, "--offset", 0, "--threshold", 0, *settings) == 0
    assert selftouch("learn", path) == 0
    metrics = RunDirectory.open(path).metrics()
    assert metrics["shape_trusted"] is True
    assert 0.0 < metrics["shape_expected_error"] < 0.04
    assert metrics["topology_betti"] == [1, 0, 1]


def test_a_plan_is_a_joint_trajectory(learned, recording):
    motion = load_arrays(learned.plan(3, 100))
    with learned.plan(3, 100).with_suffix(".csv").open() as file:
        header, *rows = csv.reader(file)
    joints = [f"joint_{joint}" for joint in range(7)]
    assert header == ["time_s", *joints, *(f"{joint}_velocity" for joint in joints)]
    table = np.array(rows, dtype=float)
    np.testing.assert_allclose(table[:, 0], motion["time_s"], atol=1e-6)
    np.testing.assert_allclose(table[:, 1:8], motion["q"], atol=1e-6)
    np.testing.assert_allclose(table[:, 8:], motion["v"], atol=1e-6)
    assert np.abs(table[[0, -1], 8:]).max() < 1e-6
    assert 0.0 < motion["plan_novelty"] < 20.0
    # Not faster than it was recorded.
    fastest = np.quantile(np.abs(np.diff(recording.q, axis=0)) * 50, 0.99, axis=0)
    assert learned.experiment.imported.max_velocity == pytest.approx(fastest, rel=0.02)
    assert (np.abs(motion["v"]) <= 1.001 * fastest).all()


def test_a_plan_from_any_posture_is_a_joint_trajectory_too(run, monkeypatch):
    planned = SimpleNamespace(motion=load_motion(run, 3, 100))
    pilot = SimpleNamespace(plan_from=lambda q_start, goal: planned)
    monkeypatch.setattr(stages, "run_bodies", lambda run: None)
    monkeypatch.setattr(stages, "pilot_in", lambda *known: pilot)
    stages.plan(run, 100, q_start=np.zeros(7))
    one, other = (run.plan(at, 100).with_suffix(".csv") for at in (3, free_start(np.zeros(7))))
    assert one.read_bytes() == other.read_bytes()


def test_its_motions_are_loaded_from_python(run):
    stored = from_python(run.path, 3, 100)
    np.testing.assert_array_equal(stored.q, load_motion(run, 3, 100).q)
    assert not run.plan(3, 40).exists()
    new = from_python(run.path, 3, 40)
    assert new.plan.nodes[[0, -1]].tolist() == [3, 40]
    assert new.q.shape == (len(new.time_s), 7)
    assert not run.plan(3, 40).exists(), "a new plan is not stored"


def test_the_report_says_what_there_is(run):
    assert selftouch("report", run.path) == 0
    page = run.report.read_text()
    text = " ".join(re.sub("<[^>]+>", " ", page).split())
    assert "Another robot recorded its 7 joints (joint_0, joint_1" in text
    assert "taxels[7]" in text
    assert "was imported, without a robot" not in page
    for title in ("Against the truth", "Predicted and felt", "practises", "under dynamics"):
        assert title not in text, title
    assert len(set(far_apart(RunData(run)))) == 2
    assert not run.babbling.exists(), "nothing of it babbled in Drake"
    assert "babbling.html" not in page
    assert "selftouch evaluate" not in page
    assert load_body_model(run.path).reason in html.unescape(text)
    drawn = {path.stem for path in run.figures.glob("*.png")}
    assert drawn == {"found_numbers", "found_receptors", "quotient_graph", "persistence"}


@pytest.mark.slow
def test_joints_that_may_slide_are_no_body(run):
    """Each place has one posture of the joints that matter: that they slide proves nothing."""
    run.body_model.unlink()
    assert selftouch("learn", run.path) == 0
    assert not load_body_model(run.path).accepted


PLAN = ("--from", 3, "--to", 100)


@pytest.mark.parametrize(
    "words",
    [
        ("execute", "RUN", *PLAN),
        ("execute", "RUN", *PLAN, "--rehearse", 2),
        ("evaluate", "RUN"),
        ("babble", "RUN/experiment.yaml", "--out", "RUN"),
        ("run", "RUN/experiment.yaml", "--out", "RUN"),
        ("robot", "RUN/experiment.yaml"),
        ("robot", "RUN"),
    ],
    ids=lambda words: words[0],
)
def test_what_needs_a_world_says_so(words, learned, capfd):
    words = [str(word).replace("RUN", str(learned.path)) for word in words]
    assert selftouch(*words) == 2
    assert capfd.readouterr().err.strip() == (
        "selftouch: my_robot was imported, without a robot to simulate: use learn, plan and "
        "report, and execute its plans on the robot that recorded it, or give that robot as a "
        "body, with --body"
    )


@pytest.mark.parametrize("words", [("record", "RUN", *PLAN), ("play", "RUN")])
def test_what_shows_a_robot_says_what_can_be_done_instead(words, learned, capfd):
    words = [str(word).replace("RUN", str(learned.path)) for word in words]
    assert selftouch(*words) == 2
    path = learned.path
    assert capfd.readouterr().err.strip() == (
        "selftouch: my_robot was imported, without a robot to simulate, so there is nothing to "
        f"{words[0]}: `selftouch report {path}` draws the body that it recovered, `selftouch live "
        f"{path}` lets the agent live through the recording, and `selftouch plan {path} --from 0 "
        "--to 1` writes a joint trajectory for the robot"
    )


def test_a_free_start_needs_a_world(learned, capfd):
    assert selftouch("plan", learned.path, "--from-q", "0,0,0,0,0,0,0", "--to", 3) == 2
    assert "--from-q needs a body" in capfd.readouterr().err


def test_the_same_data_resume_an_import(data, run, capfd):
    before = ExperienceReader(run.experience).read("sensation")
    shard = next(iter(sorted(run.experience.glob("*.parquet"))))
    shard.unlink()
    assert selftouch("learn", run.path) == 2
    assert f"with `selftouch import {data} --out {run.path}`" in capfd.readouterr().err
    assert selftouch("import", data, "--out", run.path, "--set", SET) == 0
    np.testing.assert_array_equal(ExperienceReader(run.experience).read("sensation"), before)
    assert selftouch("import", data, "--out", run.path, "--set", SET, "--threshold", 30) == 2
    assert "was begun with" in capfd.readouterr().err


def test_an_import_that_did_not_come_to_its_end_is_no_experience(data, tmp_path):
    experiment = imported_experiment(
        read_data(data), overrides={"representation": {"num_targets": NUM_TARGETS}}
    )
    run = RunDirectory.create(tmp_path / "run", experiment)
    assert not stages.has_babbled(run)
    with pytest.raises(ValueError, match="the import has not come to its end; resume it with"):
        stages.learn(run)


def test_an_imported_experiment_is_read_back(learned):
    assert RunDirectory.open(learned.path).experiment == learned.experiment
    text = (learned.path / "experiment.yaml").read_text()
    assert "directives" not in text
    assert learned.experiment.num_receptors == NUM_RECEPTORS


def test_limits_can_be_set(little_data, tmp_path):
    options = ("--max-velocity", 0.5, "--max-acceleration", 2.0, "--set", SET)
    assert selftouch("import", little_data, "--out", tmp_path / "run", *options) == 0
    imported = RunDirectory.open(tmp_path / "run").experiment.imported
    assert imported.max_velocity == [0.5] * 7
    assert imported.max_acceleration == [2.0] * 7


def test_limits_without_time_are_the_default(tmp_path):
    rng = np.random.default_rng(0)
    np.savez(tmp_path / "a.npz", q=rng.normal(size=(200, 2)), touch=rng.random((200, 5)))
    data = read_data(tmp_path / "a.npz", offset=0.0, threshold=0.0)
    imported = imported_experiment(data, overrides={"representation": {"num_targets": 50}}).imported
    assert imported.max_velocity == [1.0, 1.0]
    assert imported.max_acceleration == [5.0, 5.0]


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            {"representation": {"num_targets": 300}},
            "representation.num_targets is 300; give at most the number of touches, 200",
        ),
        (
            {"robot": {"directives": "a.dmd.yaml"}},
            "robot is RobotSettings(directives='a.dmd.yaml', packages={}, joints=None, "
            "collision_depth=0.005); imported experience has no robot: leave it out",
        ),
        (
            {"babbling": {"num_samples": 5}},
            "babbling comes from the imported data; leave it out of --set",
        ),
    ],
)
def test_fields_that_cannot_be_set_are_refused(overrides, message, tmp_path):
    rng = np.random.default_rng(0)
    np.savez(tmp_path / "a.npz", q=rng.normal(size=(200, 2)), touch=rng.random((200, 5)))
    data = read_data(tmp_path / "a.npz", offset=0.0, threshold=0.0)
    with pytest.raises(ExperimentError, match=r"\w") as error:
        imported_experiment(data, overrides={"representation": {"num_targets": 50}} | overrides)
    assert str(error.value) == message


def test_mistakes_leave_no_run(little_data, tmp_path, capfd):
    for words, message in (
        ((tmp_path / "nowhere",), "nowhere does not exist; give a file or a folder"),
        ((little_data, "--q", "angle_*"), "--q is 'angle_*'; "),
        ((little_data, "--threshold", "300"), f"nothing is felt in {NUM_LITTLE} rows: "),
        ((little_data, "--set", "{skins: 3}"), "skins is 3; give a mapping by name"),
        ((little_data, "--max-velocity", "0"), "imported.max_velocity[0] is 0.0"),
    ):
        assert selftouch("import", *words, "--out", tmp_path / "run") == 2
        said = capfd.readouterr().err
        assert message in said
        assert "Traceback" not in said
        assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_the_program_of_the_page_works(recording, tmp_path, monkeypatch):
    page = (ROOT / "docs" / "real_robots.md").read_text(encoding="utf-8")
    program, _ = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    monkeypatch.chdir(tmp_path)
    np.savez("recording.npz", q=recording.q, taxels=recording.raw, time_s=recording.time_s)
    names: dict = {}
    exec(compile(program, "docs/real_robots.md", "exec"), names)
    assert names["agent"].recover("sensorimotor").parts[0].topology.betti == (1, 0, 1)
    assert load_arrays(Path("trajectory.npz"))["q"].shape[1] == 7
