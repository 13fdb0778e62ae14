"""Runs and experiments that commands refuse to open."""

import contextlib
import shutil

from commands import SMALL, files_below, refused

from selftouch_drake.resources import MODELS


def test_wrong_yaml_is_refused(tmp_path):
    message = "--set is not YAML: expected ',' or ']', but got '<stream end>'"
    assert refused("run", "cube", "--out", tmp_path / "run", "--set", "[1") == message
    assert not (tmp_path / "run").exists()


def test_unknown_experiment_is_refused(tmp_path):
    message = "experiment 'cubes' is neither shipped nor a file; did you mean cube?"
    with contextlib.chdir(tmp_path):
        assert refused("run", "cubes") == message
    assert list(tmp_path.iterdir()) == []


def test_a_run_is_no_experiment(finished_run):
    assert refused("run", finished_run) == (
        f"experiment '{finished_run}' is a run: `selftouch learn {finished_run}` and `selftouch "
        f"report {finished_run}` take it; to go on with its babbling, give "
        f"{finished_run / 'experiment.yaml'} --out {finished_run}"
    )


def test_a_model_of_a_robot_is_no_experiment(tmp_path):
    model = tmp_path / "arm.urdf"
    model.write_text('<robot name="arm">\n\t<link name="base"/>\n</robot>\n')
    assert refused("robot", model) == (
        f"experiment '{model}' is the model of a robot; write an experiment whose robot.directives "
        "add it: `selftouch experiments --show cube` prints one"
    )


def test_folder_that_is_not_a_run_is_refused(tmp_path):
    for verb in ("learn", "evaluate", "report"):
        assert refused(verb, tmp_path) == (
            f"{tmp_path} is not a run: it has no experiment.yaml; make one with `selftouch run`"
        )


def test_half_finished_run_is_refused(tmp_path, finished_run):
    run = tmp_path / "run"
    run.mkdir()
    shutil.copy(finished_run / "experiment.yaml", run)
    assert refused("learn", run).startswith(
        f"{run} is half-finished: babbling has not come to its end"
    )
    assert refused("plan", run, "--from", 0, "--to", 1) == (
        f"{run} has learned nothing yet; run `selftouch learn {run}`"
    )


def test_run_of_another_version_is_refused(tmp_path, finished_run):
    run = tmp_path / "run"
    run.mkdir()
    # What is below the first line is not read: the first version had other fields.
    (run / "experiment.yaml").write_text("# A run of selftouch_drake, format 1\nbody: {}\n")
    assert refused("learn", run) == (
        f"{run} was made by another version (format 1, this is 2); "
        "run the experiment again with another --out"
    )


def test_other_experiment_in_the_same_folder_is_refused(finished_run):
    before = files_below(finished_run)
    assert refused("run", "torus", "--out", finished_run, "--set", SMALL) == (
        f"{finished_run} was begun with name 'cube', not 'torus'; choose another --out"
    )
    assert files_below(finished_run) == before


def test_an_edited_model_is_named_by_what_comes_after(tmp_path, finished_run):
    """A run with the user's own models, as after `selftouch run mine.yaml`."""
    models, run = tmp_path / "models", tmp_path / "run"
    shutil.copytree(MODELS, models)
    shutil.copytree(finished_run, run)
    for name in ("experiment.yaml", "models.json"):
        text = (run / name).read_text().replace(str(MODELS.resolve()), str(models))
        (run / name).write_text(text)
    arm = models / "arm.sdf"
    arm.write_text(arm.read_text().replace("0.40", "0.41", 1))
    for verb in (["execute", "--from", 0, "--to", 1], ["learn"], ["report"]):
        assert refused(verb[0], run, *verb[1:]) == (
            f"{arm} has changed since {run} was begun; restore it, or run the experiment again "
            "with another --out"
        )
