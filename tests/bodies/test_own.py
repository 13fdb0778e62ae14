"""A class of the user's own as the body of an experiment."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from fenced import blocks

from selftouch_drake.agent.body import BodyError
from selftouch_drake.bodies.own import open_body, open_reference
from selftouch_drake.experiment import (
    ExperimentError,
    dump_experiment,
    experiment_from_fields,
    load_experiment,
)
from selftouch_drake.run.fingerprint import experience_fingerprint, model_digests

TOYS = Path(__file__).with_name("toys.py")


def written(folder, python, **fields):
    """An experiment's file with a body of its own beside it."""
    (folder / "toys.py").write_bytes(TOYS.read_bytes())
    file = folder / "mine.yaml"
    file.write_text(yaml.safe_dump({"python": python, **fields}))
    return file


def in_file(folder, text, kind="Mine", **fields):
    (folder / "mine.py").write_text(text)
    python = {"file": "mine.py", "class": kind, **fields}
    (folder / "mine.yaml").write_text(yaml.safe_dump({"python": python}))
    return load_experiment(folder / "mine.yaml")


def test_a_class_in_a_file_beside_the_experiment_is_the_body(tmp_path):
    python = {"file": "toys.py", "class": "Flat", "arguments": {"jumps": False}, "timeout_s": 3}
    experiment = load_experiment(written(tmp_path, python))
    assert experiment.body_from == "python"
    with open_body(experiment) as body:
        assert body.joint_names == ("x", "y", "press")
        assert body.jumps is False
        assert body.feel(np.full((2, 3), 0.3)).sensation.shape == (2, 16)


def test_the_experiment_of_a_run_is_the_same_from_anywhere(tmp_path):
    python = {"file": "toys.py", "class": "Flat"}
    experiment = load_experiment(written(tmp_path, python))
    text = dump_experiment(experiment)
    assert "class: Flat" in text
    assert "skins" not in text
    assert "gymnasium" not in text
    assert experiment_from_fields(yaml.safe_load(text)) == experiment


def test_arguments_are_left_as_they_are(tmp_path):
    python = {"file": "toys.py", "class": "Flat", "arguments": {"file": "a.txt", "mesh": "b.obj"}}
    experiment = load_experiment(written(tmp_path, python))
    assert experiment.python.arguments == {"file": "a.txt", "mesh": "b.obj"}


def test_the_content_of_the_file_decides_the_experience_and_its_place_does_not(tmp_path):
    def fingerprint(folder, more="", **arguments):
        folder.mkdir()
        python = {"file": "toys.py", "class": "Flat", "arguments": arguments}
        experiment = load_experiment(written(folder, python))
        (folder / "toys.py").write_text(TOYS.read_text() + more)
        return experience_fingerprint(experiment, model_digests(experiment))

    first = fingerprint(tmp_path / "a")
    assert fingerprint(tmp_path / "b") == first
    assert fingerprint(tmp_path / "c", "\n#") != first
    assert fingerprint(tmp_path / "d", jumps=False) != first


@pytest.mark.parametrize(
    ("fields", "line"),
    [
        (
            {"python": {"file": "a.py"}},
            "python.class is missing; `selftouch experiments --show cube` is an example",
        ),
        (
            {"python": {"file": "a.py", "class": "My Robot"}},
            "python.class is 'My Robot'; give the name of a class",
        ),
        (
            {"python": {"file": "a.py", "clas": "Mine"}},
            "unknown key python.clas; did you mean class?",
        ),
        (
            {"python": {"file": "a.py", "class": "M"}, "robot": {"directives": "a.dmd.yaml"}},
            "robot is RobotSettings(directives='a.dmd.yaml', packages={}, joints=None, "
            "collision_depth=0.005); the body comes from python: leave one of the two out",
        ),
        (
            {
                "python": {"file": "a.py", "class": "M"},
                "gymnasium": {"env": "E-v0", "joints": "q", "touch": "s"},
            },
            "the body comes from python: leave one of the two out",
        ),
    ],
)
def test_one_field_says_what_the_body_is(fields, line):
    with pytest.raises(ExperimentError) as error:
        experiment_from_fields(fields)
    assert str(error.value).endswith(line)


@pytest.mark.parametrize(
    ("text", "fields", "line"),
    [
        ("class Mine:", {}, "mine.py cannot be run: IndentationError: expected an indented block"),
        ("import nowhere", {}, "cannot be run: ModuleNotFoundError: No module named 'nowhere'"),
        ("class Mien: ...", {}, "mine.py has no class 'Mine'; did you mean Mien?"),
        ("Mine = 3", {}, "mine.py has no class 'Mine'; it has none"),
        (
            "class Mine:\n def __init__(self, port): ...",
            {"arguments": {"prot": 3}},
            "arguments of Mine are {'prot': 3}: missing a required argument: 'port'; it takes ",
        ),
        (
            "class Mine:\n def __init__(self): raise OSError('no such device')",
            {},
            "Mine() raised OSError: no such device (line 2 of ",
        ),
        ("class Mine: ...", {}, "Mine has no method feel; write one, as "),
    ],
)
def test_a_file_that_makes_no_body_says_why(tmp_path, text, fields, line):
    with pytest.raises(BodyError) as error:
        open_body(in_file(tmp_path, text, **fields))
    assert line in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there_says_so(tmp_path):
    experiment = load_experiment(written(tmp_path, {"file": "toy.py", "class": "Flat"}))
    for call in (open_body, model_digests):
        with pytest.raises(BodyError, match=r"toy.py' does not exist; give the path of a Python"):
            call(experiment)


def test_a_body_by_file_and_class():
    with open_reference(f"{TOYS}:Flat") as body:
        assert body.num_receptors == 16
    with pytest.raises(BodyError, match=r"^'runs/cube' names no body; give a file and a class: "):
        open_reference("runs/cube")


def test_a_body_that_is_refused_is_closed(tmp_path):
    text = f"""
class Mine:
    def close(self):
        open({str(tmp_path / "closed")!r}, "w").close()
"""
    with pytest.raises(BodyError):
        open_body(in_file(tmp_path, text))
    assert (tmp_path / "closed").exists()


def test_the_experiments_of_the_page_are_valid():
    page = Path(__file__).parents[2] / "docs" / "own_body.md"
    own, env = (yaml.safe_load(text) for text in blocks(page.read_text(encoding="utf-8"), "yaml"))
    assert experiment_from_fields(own).body_from == "python"
    assert experiment_from_fields(env).body_from == "gymnasium"
