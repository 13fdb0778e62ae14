"""The documentation site builds without a warning, needs no network, and is complete."""

import dataclasses
import html
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from selftouch_drake import systems
from selftouch_drake.cli import cli
from selftouch_drake.experiment import Experiment, Skin
from selftouch_drake.experiment.schema import Babbling
from selftouch_drake.run.directory import Inside, RunDirectory
from selftouch_drake.run.metrics import METRICS

ROOT = Path(__file__).parents[1]
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, built so that a broken link is an error."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", folder],
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def words(page: Path) -> str:
    return html.unescape(re.sub(r"<[^>]+>", "", page.read_text(encoding="utf-8")))


def test_every_page_is_in_the_navigation(site):
    start = (site / "index.html").read_text(encoding="utf-8")
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")}
    assert [name for name in sorted(pages) if f'href="{name}.html"' not in start] == []


def test_nothing_is_loaded_from_the_network(site):
    loaded = re.compile(r"<(?:script|img|iframe|source)\b[^>]*\bsrc=\"?(https?:[^\"\s>]+)")
    linked = re.compile(
        r"<link\b(?=[^>]*rel=\"?(?:stylesheet|preconnect))[^>]*href=\"?(https?:\S+)"
    )
    found = []
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        found += [f"{page.name}: {name}" for name in loaded.findall(text) + linked.findall(text)]
    for sheet in site.rglob("*.css"):
        found += re.findall(r"url\(['\"]?https?:.*", sheet.read_text(encoding="utf-8"))
    assert found == []


def test_the_reference_names_every_command_field_metric_and_file(site):
    reference = site / "reference"
    commands = words(reference / "cli.html")
    assert [name for name in cli.commands if f"selftouch {name}" not in commands] == []
    options = {option for c in cli.commands.values() for p in c.params for option in p.opts}
    assert [name for name in options if name.startswith("--") and name not in commands] == []
    fields = words(reference / "experiment.html")
    for prefix, schema in (("babbling", Babbling), ("skins.NAME", Skin)):
        names = [f"{prefix}.{field.name}" for field in dataclasses.fields(schema)]
        assert [name for name in names if name not in fields] == []
    metrics = words(reference / "metrics.html")
    assert [metric.key for metric in METRICS if metric.key not in metrics] == []
    files, run = words(reference / "files.html"), RunDirectory(Path(), Experiment())
    inside = [name for name, entry in vars(RunDirectory).items() if isinstance(entry, Inside)]
    assert "representation" in inside
    assert [name for name in inside if getattr(run, name).name not in files] == []
    api = "".join(
        (reference / "api" / f"{name}.html").read_text(encoding="utf-8")
        for name in ("systems", "robot")
    )
    assert [name for name in systems.__all__ if not re.search(rf'id="[\w.]*\.{name}"', api)] == []


def test_formulas_are_drawn_by_the_browser(site):
    text = (site / "method.html").read_text(encoding="utf-8")
    assert text.count("<math") > 40
    assert "arithmatex" not in text
