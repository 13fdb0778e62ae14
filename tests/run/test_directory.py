import dataclasses
import json
import os
import shutil

import numpy as np
import pytest

from selftouch_drake.experiment import ExperimentError, load_experiment
from selftouch_drake.resources import MODELS
from selftouch_drake.run.directory import RUN_FORMAT, RunDirectory, RunError


@pytest.fixture
def run(tmp_path):
    return RunDirectory.create(tmp_path / "run", load_experiment("cube"))


def _content(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_a_new_run_holds_its_resolved_experiment(run):
    assert sorted(map(str, _content(run.path))) == ["experiment.yaml", "models.json"]
    text = (run.path / "experiment.yaml").read_text()
    assert text.startswith(f"# A run of selftouch_drake, format {RUN_FORMAT}\n")
    assert "hydroelastic_modulus: 30000.0" in text
    opened = RunDirectory.open(run.path)
    assert opened == run
    assert opened.experiment == load_experiment("cube")


def test_folders_above_a_run_are_made(tmp_path):
    RunDirectory.create(tmp_path / "a" / "b" / "run", load_experiment("cube"))
    assert RunDirectory.open(tmp_path / "a" / "b" / "run").metrics() == {}


def test_an_empty_folder_becomes_a_run(tmp_path):
    RunDirectory.create(tmp_path, load_experiment("cube"))
    assert RunDirectory.open(tmp_path).experiment.name == "cube"


def test_the_same_experiment_resumes_its_run(run):
    run.add_metrics({"babbling_num_samples": 5})
    before = _content(run.path)
    resumed = RunDirectory.create(run.path, load_experiment("cube"))
    assert resumed.metrics() == {"babbling_num_samples": 5}
    assert _content(run.path) == before


@pytest.mark.parametrize(
    ("overrides", "difference"),
    [
        ({"seed": 1}, "seed 0, not 1"),
        ({"skins": {"body": {"num_receptors": 50}}}, "skins.body.num_receptors 100, not 50"),
        (
            {"skins": {"body": {"surface": {"shape": "cube", "side": 0.4}}}},
            "skins.body.surface.side 0.44, not 0.4",
        ),
        (
            {"touching": {"fingertip_0": {"radius": 0.02}}},
            "touching.fingertip_0.radius 0.01, not 0.02",
        ),
        (
            {"robot": {"directives": "package://selftouch_drake/two_fingers.dmd.yaml"}},
            "robot.directives 'package://selftouch_drake/one_finger.dmd.yaml', not "
            "'package://selftouch_drake/two_fingers.dmd.yaml'",
        ),
    ],
)
def test_another_experiment_is_refused_by_the_field_that_differs(run, overrides, difference):
    before = _content(run.path)
    with pytest.raises(RunError) as error:
        RunDirectory.create(run.path, load_experiment("cube", overrides))
    assert str(error.value) == f"{run.path} was begun with {difference}; choose another --out"
    assert _content(run.path) == before


def test_another_order_of_skins_is_refused(tmp_path):
    experiment = load_experiment("two_arms")
    RunDirectory.create(tmp_path / "run", experiment)
    other = dict(reversed(experiment.skins.items()))
    experiment = dataclasses.replace(experiment, skins=other)
    with pytest.raises(RunError, match=r"was begun with the order of skins \['body', 'left_for"):
        RunDirectory.create(tmp_path / "run", experiment)


def test_another_shape_is_refused(run):
    with pytest.raises(RunError, match="was begun with name 'cube', not 'torus'; choose another"):
        RunDirectory.create(run.path, load_experiment("torus"))


@pytest.mark.parametrize("version", [1, 999])
def test_a_run_of_another_version_is_refused(run, version):
    file = run.path / "experiment.yaml"
    lines = file.read_text().splitlines(keepends=True)
    file.write_text("".join([f"# A run of selftouch_drake, format {version}\n", *lines[1:]]))
    expected = (
        f"{run.path} was made by another version (format {version}, this is {RUN_FORMAT}); "
        "run the experiment again with another --out"
    )
    for attempt in (
        lambda: RunDirectory.open(run.path),
        lambda: RunDirectory.create(run.path, load_experiment("cube")),
    ):
        with pytest.raises(RunError) as error:
            attempt()
        assert str(error.value) == expected


@pytest.mark.parametrize("content", [b"", b"name: cube\n", b"\xff\xfe\x00", b"# A run of another"])
def test_an_experiment_that_is_not_of_a_run_is_refused(tmp_path, content):
    file = tmp_path / "experiment.yaml"
    file.write_bytes(content)
    with pytest.raises(RunError) as error:
        RunDirectory.create(tmp_path, load_experiment("cube"))
    assert str(error.value) == f"{file} does not belong to a run; choose the directory of a run"
    assert file.read_bytes() == content


@pytest.mark.parametrize("damage", ["seed: [\n", "sed: 3\n", "skins: 3\n"])
def test_a_run_whose_experiment_is_damaged_is_refused(run, damage):
    file = run.path / "experiment.yaml"
    file.write_text(file.read_text() + damage)
    with pytest.raises(ExperimentError):
        RunDirectory.open(run.path)


def test_a_folder_that_is_not_a_run_is_refused_and_kept(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(RunError) as error:
        RunDirectory.open(tmp_path)
    assert str(error.value) == (
        f"{tmp_path} is not a run: it has no experiment.yaml; make one with `selftouch run`"
    )
    with pytest.raises(RunError) as error:
        RunDirectory.create(tmp_path, load_experiment("cube"))
    assert str(error.value) == f"{tmp_path} is neither a run nor empty; choose another --out"
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_start_that_was_killed_can_be_made_again(tmp_path):
    experiment = load_experiment("cube")
    orphan = tmp_path / ".experiment.yaml.4711.part"
    orphan.write_text("name: cu")
    (tmp_path / "models.json").write_text("{}")
    with RunDirectory.create(tmp_path, experiment).writing():
        assert not orphan.exists()
    assert RunDirectory.open(tmp_path).experiment == experiment


def test_a_file_is_not_a_run(tmp_path):
    file = tmp_path / "file"
    file.write_text("something")
    with pytest.raises(RunError, match=r"is not a run: it has no experiment\.yaml"):
        RunDirectory.open(file)
    with pytest.raises(RunError, match="is neither a run nor empty; choose another --out"):
        RunDirectory.create(file, load_experiment("cube"))
    assert file.read_text() == "something"


def test_a_path_that_is_not_there_is_not_a_run(tmp_path):
    with pytest.raises(RunError, match=r"is not a run: it has no experiment\.yaml"):
        RunDirectory.open(tmp_path / "nothing")


def test_figures_are_added_replaced_and_dropped(run):
    assert run.metrics() == {}
    run.add_metrics({"babbling_num_samples": 5, "topology_betti": [1, 0, 1]})
    run.add_metrics({"babbling_num_samples": 6, "shape_rms_fraction": 0.0123456789012345})
    assert run.metrics() == {
        "babbling_num_samples": 6,
        "topology_betti": [1, 0, 1],
        "shape_rms_fraction": 0.0123456789012345,
    }
    run.drop_metrics(["topology_betti", "shape_rms_fraction"])
    assert run.metrics() == {"babbling_num_samples": 6}


def test_metrics_are_plain_however_they_were_computed(run):
    run.add_metrics(
        {
            "shape_trusted": np.bool_(True),
            "babbling_touches_by_skin": {"body": np.int64(3)},
            "graph_component_sizes": np.array([40, 10]),
            "babbling_force_max_N": np.float32(0.5),
        }
    )
    found = run.metrics()
    assert found["shape_trusted"] is True
    assert found["babbling_touches_by_skin"] == {"body": 3}
    assert found["graph_component_sizes"] == [40, 10]
    assert found["babbling_force_max_N"] == 0.5


@pytest.mark.parametrize("content", [b"", b'{"a": 1', b"[1, 2]", b"\xff\xfe", b"[" * 100_000])
def test_damaged_figures_are_reported_and_kept(run, content):
    file = run.path / "metrics.json"
    file.write_bytes(content)
    for attempt in (
        run.metrics,
        lambda: run.add_metrics({"a": 1}),
        lambda: run.drop_metrics(["a"]),
    ):
        with pytest.raises(RunError) as error:
            attempt()
        assert str(error.value) == f"{file} is damaged; delete it and evaluate again"
    assert file.read_bytes() == content


def test_the_fingerprint_is_of_what_decides_the_experience(run, tmp_path):
    def fingerprint(**overrides):
        experiment = load_experiment("cube", overrides)
        return RunDirectory(tmp_path, experiment).fingerprint()

    same = [
        {},
        {"name": "another"},
        {"representation": {"num_targets": 100}},
        {"evaluation": {"num_pairs": 3}},
        {"planning": {"knot_spacing": 0.2}},
        {"joints": {"offset": 0.01}},
    ]
    other = [
        {"seed": 1},
        {"skins": {"body": {"surface": {"shape": "cube", "side": 0.4}}}},
        {"skins": {"body": {"num_receptors": 50}}},
        {"skins": {"body": {"unevenness": 0.5}}},
        {"skins": {"body": {"imperfections": {"dead": 0.05}}}},
        {"touching": {"fingertip_0": {"radius": 0.011}}},
        {"robot": {"collision_depth": 0.01}},
        {"robot": {"joints": ["shoulder_yaw"]}},
        {"robot": {"directives": "package://selftouch_drake/two_fingers.dmd.yaml"}},
        {"joints": {"noise": 0.01}},
        {"babbling": {"step_size": 0.1}},
    ]
    assert {fingerprint(**overrides) for overrides in same} == {run.fingerprint()}
    prints = {fingerprint(**overrides) for overrides in other}
    assert len(prints) == len(other)
    assert run.fingerprint() not in prints
    stiff = {"execution": {"stiffness": 1000.0}}
    assert fingerprint(**stiff) == fingerprint()
    dynamic = {"babbling": {"mode": "dynamic"}}
    assert fingerprint(**stiff, **dynamic) != fingerprint(**dynamic)
    of_plans = {"max_tries": 3, "max_velocity": 0.5, "max_acceleration": 2.0}
    assert fingerprint(execution=of_plans, **dynamic) == fingerprint(**dynamic)


def test_the_order_of_skins_counts(tmp_path):
    experiment = load_experiment("two_arms")
    before = RunDirectory(tmp_path, experiment).fingerprint()
    other = dict(reversed(experiment.skins.items()))
    experiment = dataclasses.replace(experiment, skins=other)
    assert RunDirectory(tmp_path, experiment).fingerprint() != before


def test_the_fingerprint_of_a_mesh_is_that_of_its_content(tmp_path):
    def fingerprint(path, content):
        path.write_text(content)
        mesh = {"skins": {"body": {"surface": {"mesh": str(path)}}}}
        return RunDirectory(tmp_path, load_experiment("cube", mesh)).fingerprint()

    one = fingerprint(tmp_path / "one.obj", "a mesh")
    assert fingerprint(tmp_path / "moved.obj", "a mesh") == one
    assert fingerprint(tmp_path / "one.obj", "another mesh") != one


def test_meshes_that_change_places_are_another_robot(tmp_path):
    files = [tmp_path / "one.obj", tmp_path / "other.obj"]
    for file in files:
        file.write_text(file.name)

    def fingerprint(one, other):
        worn = [{"link": "body", "surface": {"mesh": str(mesh)}} for mesh in (one, other)]
        skins = dict(zip(("body", "second"), worn, strict=True))
        experiment = load_experiment("cube", {"skins": skins})
        return RunDirectory(tmp_path, experiment).fingerprint()

    assert fingerprint(*files) != fingerprint(*files[::-1])


@pytest.fixture
def models(tmp_path):
    """A copy of the shipped models, and an experiment that uses it."""
    folder = tmp_path / "models"
    shutil.copytree(MODELS, folder)
    for file in folder.glob("*.dmd.yaml"):
        file.write_text(file.read_text().replace("package://selftouch_drake/", "package://mine/"))
    robot = {"directives": "package://mine/one_finger.dmd.yaml", "packages": {"mine": str(folder)}}
    return folder, load_experiment("cube", {"robot": robot})


def test_models_count_by_content_and_not_by_place(models, tmp_path):
    folder, experiment = models
    before = RunDirectory(tmp_path, experiment).fingerprint()
    folder.rename(tmp_path / "moved")
    robot = dataclasses.replace(experiment.robot, packages={"mine": str(tmp_path / "moved")})
    experiment = dataclasses.replace(experiment, robot=robot)
    assert RunDirectory(tmp_path, experiment).fingerprint() == before
    arm = tmp_path / "moved" / "arm.sdf"
    arm.write_text(arm.read_text().replace("<!--", "<!-- ", 1))
    assert RunDirectory(tmp_path, experiment).fingerprint() != before


@pytest.mark.parametrize("name", ["arm.sdf", "one_finger.dmd.yaml", "one_finger.sdf"])
def test_a_model_that_was_edited_is_named(models, tmp_path, name):
    folder, experiment = models
    run = RunDirectory.create(tmp_path / "run", experiment)
    file = folder / name
    whole = file.read_bytes()
    file.write_bytes(whole + b"\n")
    for attempt in (
        lambda: RunDirectory.open(run.path),
        lambda: RunDirectory.create(run.path, experiment),
        run.require_models,
    ):
        with pytest.raises(RunError) as error:
            attempt()
        assert str(error.value) == (
            f"{file} has changed since {run.path} was begun; restore it, or run the experiment "
            "again with another --out"
        )
    file.write_bytes(whole)
    assert RunDirectory.open(run.path) == run
    run.require_models()


def test_without_its_models_a_run_opens_and_keeps_its_fingerprint(models, tmp_path):
    folder, experiment = models
    run = RunDirectory.create(tmp_path / "run", experiment)
    run.add_metrics({"babbling_num_samples": 5})
    before = run.fingerprint()
    shutil.rmtree(folder)
    opened = RunDirectory.open(run.path)
    assert opened.fingerprint() == before
    assert opened.metrics() == {"babbling_num_samples": 5}
    with pytest.raises(ValueError, match=r"robot\.packages\.mine"):
        opened.require_models()


def test_other_models_elsewhere_are_refused(models, tmp_path):
    """A run on a machine with another version of the package."""
    folder, experiment = models
    run = RunDirectory.create(tmp_path / "run", experiment)
    file = run.path / "models.json"
    digests = json.loads(file.read_text())
    elsewhere = {path.replace(str(folder), "/elsewhere"): d for path, d in digests.items()}
    file.write_text(json.dumps(elsewhere))
    run = RunDirectory.open(run.path)
    run.require_models()
    (folder / "arm.sdf").write_bytes((folder / "arm.sdf").read_bytes() + b"\n")
    with pytest.raises(RunError, match=r"arm\.sdf has changed since .* was begun; restore it"):
        RunDirectory.open(run.path).require_models()


@pytest.mark.parametrize("content", [b"", b"[1]", b'{"a": 1}', b"\xff", b"[" * 100_000])
def test_damaged_digests_are_named(run, content):
    file = run.path / "models.json"
    file.write_bytes(content)
    with pytest.raises(RunError) as error:
        RunDirectory.open(run.path)
    assert str(error.value) == (f"{file} is damaged; run the experiment again with another --out")


def test_paths_are_those_of_the_contract(run):
    names = [run.experience, run.truth, run.skin, run.representation, run.plan(3, 12)]
    names += [run.figures, run.babbling, run.playback, run.report]
    assert [str(p.relative_to(run.path)).replace(os.sep, "/") for p in names] == [
        "experience",
        "truth",
        "skin.npz",
        "representation.npz",
        "plans/3-12.npz",
        "figures",
        "babbling.html",
        "playback.html",
        "report.html",
    ]
