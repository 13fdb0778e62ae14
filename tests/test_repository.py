"""Files that describe the repository agree with the package."""

import re
import tomllib
from importlib.metadata import version
from pathlib import Path

import yaml

import selftouch_drake

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
TARGETS = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)


def loaded(path: str) -> dict:
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


def make_targets(text: str) -> list[str]:
    """The `make` targets that a text names."""
    return re.findall(r"\bmake ([a-z-]+)\b(?! sure)|\"make\", \"([a-z-]+)\"", text)


def test_the_citation_names_this_version():
    citation = loaded("CITATION.cff")
    assert citation["version"] == PROJECT["version"] == selftouch_drake.__version__
    assert version("selftouch-drake") == PROJECT["version"]
    assert citation["license"] == PROJECT["license"]
    assert len(citation["preferred-citation"]["authors"]) == 3


def test_the_changelog_names_this_version():
    assert f"\n## {PROJECT['version']}\n" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_workflow_tests_every_python_that_is_allowed():
    tested = loaded(".github/workflows/ci.yml")["jobs"]["test"]["strategy"]["matrix"]
    least, below = re.fullmatch(r">=3\.(\d+),<3\.(\d+)", PROJECT["requires-python"]).groups()
    assert tested["python-version"] == [f"3.{n}" for n in range(int(least), int(below))]


def test_the_badges_are_true():
    least, below = re.findall(r"3\.(\d+)", PROJECT["requires-python"])
    pythons = f"Python: 3.{least} to 3.{int(below) - 1}"
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for name, text in (("python", pythons), ("licence", f"licence: {PROJECT['license']}")):
        assert f"[![{text}](docs/badges/{name}.svg)]" in readme
        badge = (ROOT / "docs" / "badges" / f"{name}.svg").read_text(encoding="utf-8")
        assert f"<title>{text}</title>" in badge
        assert all(f">{word}</text>" in badge for word in text.split(": "))


def test_make_has_what_others_ask_it_for():
    others = [
        ".github/workflows/ci.yml",
        "Dockerfile",
        ".devcontainer/devcontainer.json",
        "README.md",
        "CONTRIBUTING.md",
        *(str(page.relative_to(ROOT)) for page in (ROOT / "docs").glob("*.md")),
    ]
    missing = []
    for path in others:
        code = (ROOT / path).read_text(encoding="utf-8")
        if path.endswith(".md"):
            code = "\n".join(re.findall(r"`+([^`]+)`+", code))
        asked = ["".join(groups) for groups in make_targets(code)]
        missing += [f"{path}: {target}" for target in asked if target not in TARGETS]
    assert missing == []


def test_types_are_for_others_too():
    assert (ROOT / "selftouch_drake" / "py.typed").is_file()
