"""The reference builds from the docstrings, and what the documentation shows is there."""

import ast
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from selftouch_drake.experiment import experiment_from_fields, load_skins
from selftouch_drake.sweep import load_sweep

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
# Files of the repository that pages name; the reference is there once it was made.
NAMED = re.compile(
    r"`((?!docs/reference)(?:tests|docs|benchmarks|notebooks|experiments|sweeps)/[\w./-]+)`"
)


def blocks(path: Path, language: str) -> list[str]:
    text = path.read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def test_the_reference_builds(tmp_path):
    options = ["--docformat", "google", "--no-show-source", "--output-directory", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, "-m", "pdoc", *options, "selftouch_drake"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "Warn" not in done.stderr, done.stderr
    robot = (tmp_path / "selftouch_drake" / "robot.html").read_text(encoding="utf-8")
    assert "TactileSkin.AddToBuilder" in robot
    assert (tmp_path / "selftouch_drake" / "show.html").is_file()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_names_only_files_that_are_there(page):
    text = page.read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)#]+)\)", text) if "://" not in link]
    missing = [link for link in links if not (page.parent / link).exists()]
    missing += [name for name in NAMED.findall(text) if not (ROOT / name).exists()]
    assert missing == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_imports_only_what_is_there(page):
    for block in blocks(page, "python"):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("selftouch"):
                module = importlib.import_module(str(node.module))
                assert [a.name for a in node.names if not hasattr(module, a.name)] == []


@pytest.mark.parametrize("number", range(len(blocks(ROOT / "docs" / "drake_users.md", "python"))))
def test_a_program_for_drake_users_runs(number):
    program = blocks(ROOT / "docs" / "drake_users.md", "python")[number]
    exec(compile(program, f"program {number} of drake_users.md", "exec"), {})


def test_the_skins_beside_directives_are_valid(tmp_path):
    (text,) = blocks(ROOT / "docs" / "drake_users.md", "yaml")
    (tmp_path / "skins.yaml").write_text(text, encoding="utf-8")
    assert list(load_skins(tmp_path / "skins.yaml")) == ["forearm"]


def test_the_experiment_that_is_shown_is_valid():
    (text,) = blocks(ROOT / "docs" / "robots.md", "yaml")
    assert experiment_from_fields(yaml.safe_load(text)).num_receptors == 140


def test_the_sweep_that_is_shown_is_valid(tmp_path):
    (text,) = blocks(ROOT / "docs" / "sweeps.md", "yaml")
    own = (ROOT / "experiments" / "cube.yaml").read_text(encoding="utf-8")
    (tmp_path / "my_robot.yaml").write_text(own, encoding="utf-8")
    (tmp_path / "my_sweep.yaml").write_text(text, encoding="utf-8")
    sweep = load_sweep(tmp_path / "my_sweep.yaml")
    # Of two experiments and three seeds: the grid, in which the defaults are, two other shares of
    # dead receptors, one case.
    assert len(sweep.experiments) == 2 * 3 * (4 + 2 + 1)
