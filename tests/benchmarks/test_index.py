"""The index of the benchmarks, and every place that names one, agree with the files."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "benchmarks"
INDEX = (FOLDER / "README.md").read_text(encoding="utf-8")
PROGRAMS = {
    path.relative_to(FOLDER).as_posix()
    for path in FOLDER.rglob("*.py")
    if path.name != "__init__.py"
}
# A line of the index: file, what it measures, command; a part of another program has no command.
LINE = re.compile(r"^\| `([\w/]+\.py)` \| ([^|]+) \| ([^|]*)\|$", re.MULTILINE)
NAMED = re.compile(r"benchmarks/[\w/]+\.py")
# A program that is named from within its folder, as in "part of `table.py`".
NEIGHBOUR = re.compile(r"`(\w+\.py)`")


def newest_part(changelog: str) -> str:
    """What has changed since the last version: older parts name files as they were."""
    return changelog.split("\n## ")[1]


def text_of(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    return newest_part(text) if path.name == "CHANGELOG.md" else text


def places() -> list[Path]:
    """Files in which benchmarks may be named."""
    found = [ROOT / "Makefile", ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]
    for folder, pattern in (
        ("docs", "**/*.md"),
        ("docs", "**/*.py"),
        ("docs/data", "*.csv"),
        ("benchmarks", "**/*.md"),
        ("benchmarks", "**/*.py"),
        ("selftouch_drake", "**/*.py"),
        ("selftouch_drake", "**/*.csv"),
        ("tests", "**/*.py"),
        ("examples", "**/*.py"),
        ("notebooks", "*.ipynb"),
        ("experiments", "*.yaml"),
        ("sweeps", "*.yaml"),
        (".github", "**/*.yml"),
    ):
        found += sorted((ROOT / folder).glob(pattern))
    return [path for path in found if path != Path(__file__)]


def test_the_index_lists_exactly_the_programs_that_there_are():
    listed = [file for file, _, _ in LINE.findall(INDEX)]
    assert sorted(listed) == sorted(PROGRAMS)


@pytest.mark.parametrize(
    ("file", "command"), [(file, command.strip()) for file, _, command in LINE.findall(INDEX)]
)
def test_a_command_of_the_index_starts_the_program_of_its_line(file, command):
    code = (FOLDER / file).read_text(encoding="utf-8")
    starts = 'if __name__ == "__main__":' in code
    assert bool(command) == starts
    if command.startswith("`make "):
        target = re.match(r"`make ([a-z-]+)", command)[1]
        makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
        recipe = makefile.partition(f"\n{target}: ")[2].split("\n\n")[0]
        assert f"$(BIN)/python benchmarks/{file}" in recipe
    elif command:
        _, program, *words = command.strip("`").split()
        assert program == f"benchmarks/{file}"
        assert [word for word in words if word.startswith("--") and f'"{word}"' not in code] == []


def test_a_part_of_a_program_names_one_of_its_folder():
    wrong = []
    for file, meaning, _ in LINE.findall(INDEX):
        if meaning.startswith("part of "):
            (whole,) = NEIGHBOUR.findall(meaning)
            if f"{Path(file).parent.as_posix()}/{whole}" not in PROGRAMS:
                wrong.append(f"{file}: {whole}")
    assert wrong == []


def test_every_benchmark_that_is_named_is_there():
    named = {path: set(NAMED.findall(text_of(path))) for path in places()}
    wrong = [
        f"{path.relative_to(ROOT)}: {name}"
        for path, names in named.items()
        for name in sorted(names)
        if not (ROOT / name).is_file()
    ]
    assert wrong == []
    # The search finds something where much is named.
    for path in ("Makefile", "docs/shape.md", "benchmarks/README.md", "benchmarks/cost/live.py"):
        assert named[ROOT / path], path
