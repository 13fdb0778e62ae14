"""Files that the documentation names exist, and its programs run."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from fenced import blocks

from selftouch_drake.cli import cli
from selftouch_drake.experience import ExperienceReader
from selftouch_drake.experiment import (
    experiment_from_fields,
    load_experiment,
    load_skins,
    parse_overrides,
    shipped_experiments,
)
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.naming import default_path
from selftouch_drake.sweep import load_sweep

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
# Files of the repository that pages name.
NAMED = re.compile(r"`((?:tests|docs|benchmarks|notebooks|experiments|sweeps)/[\w./-]+)`")
# Their programs need more than a run, and have tests of their own.
TESTED_ELSEWHERE = ("drake_users.md", "gymnasium.md", "real_robots.md", "sensor.md")


def blocks_of(page: Path, *languages: str) -> list[str]:
    return blocks(page.read_text(encoding="utf-8"), *languages)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_names_only_files_that_are_there(page):
    text = page.read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)#]+)\)", text) if "://" not in link]
    missing = [link for link in links if not (page.parent / link).exists()]
    missing += [name for name in NAMED.findall(text) if not (ROOT / name).exists()]
    assert missing == []


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a small run of the cube, as after `selftouch run cube`."""
    folder = tmp_path_factory.mktemp("docs")
    small = {"babbling": {"num_samples": 3000}, "representation": {"metric": "sensorimotor"}}
    babble = ["babble", "cube", "--out", "runs/cube", "--set", yaml.safe_dump(small)]
    for words in (babble, ["learn", "runs/cube"]):
        run_python(["-m", "selftouch_drake.cli", *words], cwd=folder)
    touches = ExperienceReader(folder / "runs" / "cube" / "experience")
    arrays = {name: touches.read(name) for name in ("q", "sensation")}
    np.savez(folder / "recording.npz", **arrays)
    return folder


def run_python(arguments: list[str], *, cwd: Path) -> None:
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if blocks_of(page, "python") and page.name not in TESTED_ELSEWHERE],
    ids=lambda page: page.name,
)
def test_the_programs_of_a_page_run(page, folder):
    run_python(["-c", "".join(blocks_of(page, "python"))], cwd=folder)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_commands_of_a_page_are_understood(page):
    for line in "".join(blocks_of(page, "")).splitlines():
        words = shlex.split(line, comments=True)
        if words[:1] != ["selftouch"] or len(words) < 2 or words[1].startswith("-"):
            continue
        name, *arguments = words[1:]
        context = cli.commands[name].make_context(name, arguments)
        given = context.params
        if given.get("experiment") in shipped_experiments():
            load_experiment(given["experiment"], parse_overrides(given["overrides"]))


HELP = cli.get_help(cli.make_context("selftouch", ["experiments"]))


@pytest.mark.parametrize(
    "text",
    [HELP, *(page.read_text(encoding="utf-8") for page in PAGES)],
    ids=["help", *(page.name for page in PAGES)],
)
def test_commands_that_make_a_run_work_one_after_another(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = [line.strip() for line in text.splitlines()]
    for line in lines:
        words = shlex.split(line, comments=True) if line.startswith("selftouch ") else []
        if words[1:2] not in (["run"], ["babble"]):
            continue
        # In `--help`, what follows two spaces says what the line does.
        words = shlex.split(line.split("   ")[0], comments=True)
        given = cli.commands[words[1]].make_context(words[1], words[2:]).params
        if given["experiment"] not in shipped_experiments():
            continue
        changes = parse_overrides(given["overrides"])
        experiment = load_experiment(given["experiment"], changes)
        RunDirectory.create(given["out"] or default_path(experiment.name, changes), experiment)


@pytest.mark.parametrize(
    "number", range(len(blocks_of(ROOT / "docs" / "drake_users.md", "python")))
)
def test_a_program_for_drake_users_runs(number):
    program = blocks_of(ROOT / "docs" / "drake_users.md", "python")[number]
    exec(compile(program, f"program {number} of drake_users.md", "exec"), {})


def test_the_skins_beside_directives_are_valid(tmp_path):
    (text,) = blocks_of(ROOT / "docs" / "drake_users.md", "yaml")
    (tmp_path / "skins.yaml").write_text(text, encoding="utf-8")
    assert list(load_skins(tmp_path / "skins.yaml")) == ["forearm"]


def test_the_experiment_that_is_shown_is_valid():
    (text,) = blocks_of(ROOT / "docs" / "robots.md", "yaml")
    assert experiment_from_fields(yaml.safe_load(text)).num_receptors == 140


def test_the_sweep_that_is_shown_is_valid(tmp_path):
    (text,) = blocks_of(ROOT / "docs" / "sweeps.md", "yaml")
    own = (ROOT / "experiments" / "cube.yaml").read_text(encoding="utf-8")
    (tmp_path / "my_robot.yaml").write_text(own, encoding="utf-8")
    (tmp_path / "my_sweep.yaml").write_text(text, encoding="utf-8")
    sweep = load_sweep(tmp_path / "my_sweep.yaml")
    # Of two experiments and three seeds: the grid, in which the defaults are, two other shares of
    # dead receptors, one case.
    assert len(sweep.experiments) == 2 * 3 * (4 + 2 + 1)


def test_the_names_of_the_glossary_are_in_the_code():
    package = ROOT / "selftouch_drake"
    code = "\n".join(path.read_text(encoding="utf-8") for path in package.rglob("*.py"))
    known = {*re.findall(r"\w+", code), *(path.stem for path in package.rglob("*"))}
    for line in (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").splitlines():
        for name in re.findall(r"`([^`]+)`", line):
            # Placeholders are in capitals.
            words = {word for word in re.findall(r"[A-Za-z_]\w{2,}", name) if not word.isupper()}
            assert words <= known, name
