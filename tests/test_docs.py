"""Files, commands and options that the documentation names exist, and its programs run."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np
import pytest
import yaml
from fenced import blocks

from selftouch_drake.cli import cli
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.experiment import experiment_from_fields, load_experiment
from selftouch_drake.experiment.loading import load_skins
from selftouch_drake.resources import EXPERIMENTS, shipped
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.naming import default_path
from selftouch_drake.sweep.design import load_sweep

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
TEXTS = {page: page.read_text(encoding="utf-8") for page in PAGES}
#: README and pages together; what nobody reads helps nobody.
MOST_WORDS = 32_000
# Files of the repository that pages name.
NAMED = re.compile(r"`((?:tests|docs|benchmarks|notebooks|experiments|sweeps)/[\w./-]+)`")
LINK = re.compile(r"\]\(([^)#\s]*)(?:#([^)\s]+))?\)")
# Commands in fenced blocks and between backticks, which may be broken over lines.
COMMAND = re.compile(r"^(?:selftouch|python) .*|`((?:selftouch|python) [^`]+)`", re.MULTILINE)


def anchors(text: str) -> set[str]:
    """The anchors of a page's headings, as the site makes them."""
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    words = [re.sub(r"[^\w\s-]", "", heading.lower()).strip() for heading in headings]
    return {re.sub(r"[\s-]+", "-", heading) for heading in words}


def commands(page: Path, program: str) -> list[list[str]]:
    """The words of every command of a page that starts with `program`."""
    found = []
    for match in COMMAND.finditer(TEXTS[page]):
        words = shlex.split(match[1] or match[0], comments=True)
        if words[0] == program:
            found.append(words[1:])
    return found


def test_the_documentation_stays_short():
    assert sum(len(text.split()) for text in TEXTS.values()) <= MOST_WORDS


def test_pages_name_only_files_and_headings_that_are_there():
    missing = []
    for page, text in TEXTS.items():
        missing += [name for name in NAMED.findall(text) if not (ROOT / name).exists()]
        for path, anchor in LINK.findall(text):
            if "://" in path:
                continue
            target = page.parent / path if path else page
            if not target.exists():
                missing.append(f"{page.name}: {path}")
            elif anchor and anchor not in anchors(target.read_text(encoding="utf-8")):
                missing.append(f"{page.name}: {path}#{anchor}")
    assert missing == []


def test_every_table_is_named():
    text = "".join(TEXTS.values())
    tables = [path.name for path in (DOCS / "data").glob("*.csv")]
    assert [name for name in tables if f"docs/data/{name}" not in text] == []


def test_every_picture_is_shown():
    text = "".join(TEXTS.values())
    pictures = [path.name for path in (DOCS / "images").iterdir() if path.suffix != ".json"]
    assert [name for name in pictures if f"images/{name})" not in text] == []


def test_benchmarks_that_are_named_have_the_options_that_are_named():
    wrong = []
    for page in PAGES:
        for file, *words in commands(page, "python"):
            if not (ROOT / file).is_file():
                wrong.append(f"{page.name}: {file}")
                continue
            code = (ROOT / file).read_text(encoding="utf-8")
            options = [word for word in words if word.startswith("--") and f'"{word}"' not in code]
            wrong += [f"{page.name}: {file} {option}" for option in options]
    assert wrong == []


def test_commands_are_understood():
    wrong = []
    for page in PAGES:
        for name, *arguments in commands(page, "selftouch"):
            if name.startswith("-"):
                continue
            try:
                given = cli.commands[name].make_context(name, arguments).params
                if given.get("experiment") in shipped(EXPERIMENTS):
                    load_experiment(given["experiment"], given["overrides"])
            except click.MissingParameter:
                continue  # the name of a command alone, in a sentence
            except (KeyError, ValueError, click.ClickException) as error:
                wrong.append(f"{page.name}: {name} {arguments}: {error}")
    assert wrong == []


def test_commands_that_make_a_run_work_one_after_another(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # In `--help`, what follows two spaces says what the line does.
    shown = cli.get_help(cli.make_context("selftouch", ["experiments"]))
    lines = [line.strip().split("   ")[0] for line in shown.splitlines()]
    for page in [None, *PAGES]:
        lines = lines if page is None else "".join(blocks(TEXTS[page], "")).splitlines()
        for line in lines:
            words = shlex.split(line, comments=True) if line.startswith("selftouch ") else []
            if words[1:2] not in (["run"], ["babble"]):
                continue
            given = cli.commands[words[1]].make_context(words[1], words[2:]).params
            if given["experiment"] in shipped(EXPERIMENTS):
                changes = given["overrides"]
                experiment = load_experiment(given["experiment"], changes)
                path = given["out"] or default_path(experiment.name, changes)
                RunDirectory.create(Path(page.stem if page else "help") / path, experiment)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a small run of the cube, as after `selftouch run cube`, and a recording."""
    folder = tmp_path_factory.mktemp("docs")
    small = {
        "babbling": {"num_samples": 2000},
        "representation": {"num_targets": 260, "metric": "sensorimotor"},
    }
    run = str(folder / "runs" / "cube")
    changes = yaml.safe_dump(small)
    cli.main(
        ["babble", "cube", "--out", run, "--set", changes, "--workers", "1"], standalone_mode=False
    )
    cli.main(["learn", run], standalone_mode=False)
    touches = ExperienceReader(folder / "runs" / "cube" / "experience")
    arrays = {name: touches.read(name) for name in ("q", "sensation")}
    np.savez(folder / "recording.npz", **arrays)
    return folder


def programs() -> Iterator[object]:
    """Every Python program of the pages; those that read raw readings have a test of their own."""
    for page in PAGES:
        for number, program in enumerate(blocks(TEXTS[page], "python")):
            # That of your robot runs in a test of its own, after the page's commands.
            if page.name not in ("gymnasium.md", "your_robot.md") and "find_touches" not in program:
                slow = [pytest.mark.slow] if "KMeans" in program or page.parent == ROOT else []
                yield pytest.param(page, number, marks=slow, id=f"{page.stem}-{number}")


@pytest.mark.parametrize(("page", "number"), list(programs()))
def test_a_program_runs(page, number, folder, monkeypatch):
    monkeypatch.chdir(folder)
    program = blocks(TEXTS[page], "python")[number]
    exec(compile(program, f"program {number} of {page.name}", "exec"), {})


def test_the_skins_beside_directives_are_valid(tmp_path):
    (text,) = blocks(TEXTS[DOCS / "drake_users.md"], "yaml")
    (tmp_path / "skins.yaml").write_text(text, encoding="utf-8")
    assert list(load_skins(tmp_path / "skins.yaml")) == ["forearm"]


def test_the_experiment_that_is_shown_is_valid():
    text, *_ = blocks(TEXTS[DOCS / "robots.md"], "yaml")
    assert experiment_from_fields(yaml.safe_load(text)).num_receptors == 140


def test_the_sweep_that_is_shown_is_valid(tmp_path):
    (text,) = blocks(TEXTS[DOCS / "running.md"], "yaml")
    own = (ROOT / "experiments" / "cube.yaml").read_text(encoding="utf-8")
    (tmp_path / "my_robot.yaml").write_text(own, encoding="utf-8")
    (tmp_path / "my_sweep.yaml").write_text(text, encoding="utf-8")
    sweep = load_sweep(tmp_path / "my_sweep.yaml")
    # Of two experiments and three seeds: the grid, in which the defaults are, two other shares of
    # dead receptors, one case.
    assert len(sweep.experiments) == 2 * 3 * (4 + 2 + 1)


@pytest.mark.parametrize("page", ["glossary.md", "code.md"])
def test_the_names_of_a_page_on_the_code_are_in_the_code(page):
    package = ROOT / "selftouch_drake"
    code = "\n".join(path.read_text(encoding="utf-8") for path in package.rglob("*.py"))
    folders = (package, ROOT / "tests", ROOT / "benchmarks")
    stems = {path.stem for folder in folders for path in folder.rglob("*")}
    known = {*re.findall(r"\w+", code), *stems}
    named = re.findall(r"`([^`]+)`", TEXTS[DOCS / page])
    # Placeholders are in capitals.
    words = {w for name in named for w in re.findall(r"[A-Za-z_]\w{2,}", name) if not w.isupper()}
    assert {word for word in words if word.strip("_") not in known} - known == set()


def test_what_the_page_on_the_code_says_to_be_in_a_file_is_in_it():
    wrong = []
    for file, name in re.findall(r"`([\w/]+\.py): (\w+)`", TEXTS[DOCS / "code.md"]):
        code = (ROOT / "selftouch_drake" / file).read_text(encoding="utf-8")
        if not re.search(rf"^(?:def|class) {name}\b", code, re.MULTILINE):
            wrong.append(f"{file}: {name}")
    assert wrong == []
