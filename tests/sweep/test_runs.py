import json
import shutil
import warnings

import pytest
from modelled import found_by

from selftouch_drake.agent.body_model.model import rejected
from selftouch_drake.run import stages
from selftouch_drake.run.artifacts import load_body_model, load_representation
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.executors import InTurn
from selftouch_drake.sweep.design import load_sweep
from selftouch_drake.sweep.directory import SweepDirectory, run_name
from selftouch_drake.sweep.runs import RunWarning, run_sweep
from selftouch_drake.sweep.table import gather, metric_columns, read_table, varied_fields


@pytest.fixture(scope="module")
def finished(sweep, tmp_path_factory):
    """The directory of a finished sweep, the number of runs of each stage, and failed runs."""
    directory = SweepDirectory.create(tmp_path_factory.mktemp("out") / "sweep", sweep)
    did = []
    with pytest.MonkeyPatch.context() as patch:
        for name in ("babble", "learn", "evaluate"):
            original = getattr(stages, name)

            def counted(*args, name=name, original=original):
                did.append(name)
                return original(*args)

            patch.setattr(stages, name, counted)
        fractions = []
        failed = run_sweep(
            sweep, directory, InTurn(), lambda fraction, _: fractions.append(fraction)
        )
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    return directory, did, failed


def test_shared_stages_are_computed_once(finished, sweep):
    directory, did, _ = finished
    # One experience, and one whose skin cannot be; two representations; three runs to score.
    assert sorted(did) == ["babble"] * 2 + ["evaluate"] * 3 + ["learn"] * 2
    runs = [directory.run(e) for e in sweep.experiments[:3]]
    shards = [(run.experience / "part-00000.parquet").stat().st_ino for run in runs]
    assert shards[0] == shards[1] == shards[2]
    learned = [run.representation.stat().st_ino for run in runs]
    assert learned[0] != learned[1] == learned[2]


def test_every_run_is_a_run_like_any_other(finished, sweep):
    directory, *_ = finished
    for experiment in sweep.experiments[:3]:
        run = RunDirectory.open(directory.run(experiment).path)
        assert run.experiment == experiment
        assert stages.has_babbled(run)
        assert stages.has_learned(run)
        assert stages.has_evaluated(run)
        assert run.metrics()["representation_num_targets"] == experiment.representation.num_targets
        assert load_representation(run).num_targets == experiment.representation.num_targets


@pytest.mark.slow
def test_runs_with_and_without_a_body_model_share_what_they_learn(
    common_text, tmp_path, monkeypatch
):
    text = common_text + "cases:\n"
    for setting in ("auto", "off", "auto"):
        gap = 0.2 if text.count("auto") else 0.1
        text += (
            f"  - {{representation: {{num_targets: 50, metric: motor, body_model: {setting}}}, "
            f"planning: {{knot_spacing: {gap}}}}}\n"
        )
    file = tmp_path / "models.yaml"
    file.write_text(text)
    asked = []

    def find(**given):
        asked.append(given["part"])
        return rejected(
            "rejected: nothing fits.",
            joint_names=given["joint_names"],
            kernel_part=given["part"],
            num_rows=len(given["q"]),
            num_receptors=given["sensation"].shape[1],
        )

    found_by(monkeypatch, find)
    sweep = load_sweep(file)
    directory = SweepDirectory.create(tmp_path / "sweep", sweep)
    assert run_sweep(sweep, directory, InTurn()) == {}
    runs = [RunDirectory.open(directory.run(each).path) for each in sweep.experiments]
    assert len(asked) == 1, "runs that ask the same question share the answer"
    assert len({run.representation.stat().st_ino for run in runs}) == 1
    reasons = [load_body_model(run).reason for run in runs]
    assert sorted(reasons) == ["off"] + ["rejected: nothing fits."] * 2
    for run, reason in zip(runs, reasons, strict=True):
        assert ("body_model_accepted" in run.metrics()) == (reason != "off")
        assert run.joint_names()[0] == "shoulder_yaw"


def test_an_impossible_run_is_reported_and_the_others_go_on(finished, sweep):
    _, _, failed = finished
    assert list(failed) == [run_name(sweep.experiments[3])]
    assert failed[run_name(sweep.experiments[3])].startswith("skins.body.thickness is 0.4 m")


def test_a_finished_sweep_is_not_done_again(finished, sweep):
    directory, *_ = finished
    before = {p: p.stat().st_mtime_ns for p in directory.path.rglob("*.parquet")}
    before |= {p: p.stat().st_mtime_ns for p in directory.path.rglob("metrics.json")}
    again = run_sweep(sweep, SweepDirectory.create(directory.path, sweep), InTurn())
    assert len(again) == 1
    assert {p: p.stat().st_mtime_ns for p in before} == before


def test_the_table_holds_what_varied_and_every_figure(finished, sweep):
    directory, _, failed = finished
    table = gather(sweep, directory, failed)
    assert read_table(directory.table).equals(table)
    assert varied_fields(table) == [
        "representation.num_targets",
        "representation.metric",
        "planning.knot_spacing",
        "skins.body.thickness",
    ]
    rows = table.to_pylist()
    assert [row["representation.num_targets"] for row in rows] == [50, 60, 60, 300]
    assert [row["error"] is None for row in rows] == [True, True, True, False]
    assert rows[3]["shape_rms_fraction"] is None
    for row, experiment in zip(rows[:3], sweep.experiments[:3], strict=True):
        metrics = json.loads((directory.run(experiment).path / "metrics.json").read_text())
        assert row["run"] == run_name(experiment)
        assert row["babbling_num_steps"] == metrics["babbling_num_steps"]
        assert row["shape_rms_fraction"] == metrics["shape_rms_fraction"]
        assert row["topology_betti"] == metrics["topology_betti"]
    assert "shape_rms_fraction_by_metric.motor" in metric_columns(table)


def test_a_run_with_damaged_figures_is_reported_in_the_table(finished, sweep, tmp_path):
    directory = SweepDirectory(shutil.copytree(finished[0].path, tmp_path / "sweep"))
    damaged = directory.run(sweep.experiments[0]).path / "metrics.json"
    damaged.write_text("{")
    first, second, *_ = gather(sweep, directory, {}).to_pylist()
    assert first["error"] == f"{damaged} is damaged; delete it and evaluate again"
    assert first["shape_rms_fraction"] is None
    assert second["error"] is None
    assert second["shape_rms_fraction"] > 0


def test_a_warning_carries_the_name_of_its_run(sweep, tmp_path, monkeypatch):
    def doubt(stage, runs):
        if stage != "babble":
            return
        warnings.warn("never touched", RunWarning, stacklevel=1)
        warnings.warn("of another package", DeprecationWarning, stacklevel=1)

    monkeypatch.setattr("selftouch_drake.sweep.sharing._do_once", doubt)
    directory = SweepDirectory.create(tmp_path / "sweep", sweep)
    with pytest.warns(RunWarning) as caught:
        run_sweep(sweep, directory, InTurn())
    names = {run_name(experiment) for experiment in sweep.experiments}
    texts = [str(one.message) for one in caught]
    assert texts
    assert all(text.removesuffix(": never touched") in names for text in texts)
