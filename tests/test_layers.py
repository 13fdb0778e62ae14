"""Imports point down only, and only to declared packages."""

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "selftouch_drake"
HELPERS = ("colors", "compiled", "files", "lazy", "randomness", "resources", "threads")
# Rooms on one line do not import each other.
LAYERS = (
    ("__main__",),
    ("cli",),
    ("sweep", "envs"),
    ("show",),
    ("run",),
    ("evaluation", "export"),
    ("bodies",),
    ("systems",),
    ("experience",),
    ("agent",),
    ("quotient",),
    ("robot",),
    ("geometry",),
    ("experiment",),
    HELPERS,
)
HEIGHT = {room: -number for number, rooms in enumerate(LAYERS) for room in rooms}
# The paper is readable alone: it imports nothing of ours. The agent is naive: below it are only the
# paper and the helpers of `geometry` that know no robot. Between agent and world there is one door,
# the body.
CLOSED = {
    "quotient": ("robot", "geometry", "experiment", *HELPERS),
    "robot": ("quotient",),
    "agent": ("experience", "robot", "experiment", "files", "resources"),
    "experience": ("robot",),
    "run": ("robot",),
}


def modules() -> list[Path]:
    return sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports(path: Path, text: str) -> Iterator[tuple[int, str]]:
    """Line and full name of every import, including those in functions and for type checkers."""
    package = ("selftouch_drake", *path.relative_to(PACKAGE).parent.parts)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = package[: len(package) + 1 - node.level] if node.level else ()
            module = ".".join(filter(None, (*start, node.module)))
            # `from selftouch_drake import run` names the room last.
            yield from ((node.lineno, f"{module}.{alias.name}") for alias in node.names)


def imported_rooms(path: Path, text: str) -> Iterator[tuple[int, str]]:
    """Line and layer of every import from this package."""
    for line, name in imports(path, text):
        root, _, rest = name.partition(".")
        if root == "selftouch_drake" and rest and not rest.startswith("__"):
            yield line, rest.partition(".")[0]


def upward_imports(path: Path, text: str) -> list[str]:
    room = room_of(path)
    closed = CLOSED.get(room, ())
    return [
        f"line {line} imports {other}"
        for line, other in imported_rooms(path, text)
        if other != room and (HEIGHT[other] >= HEIGHT[room] or other in closed)
    ]


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_point_down(path):
    assert upward_imports(path, path.read_text(encoding="utf-8")) == []


def test_every_package_has_a_layer():
    assert {room_of(path) for path in modules()} == set(HEIGHT)


@pytest.mark.parametrize(
    ("module", "text"),
    [
        ("robot/world.py", "from selftouch_drake.run.directory import RunDirectory"),
        ("robot/world.py", "from selftouch_drake.systems import TactileSkin"),
        ("systems/babbler.py", "from selftouch_drake.bodies.drake import DrakeBody"),
        ("robot/world.py", "def f():\n    import selftouch_drake.agent"),
        ("robot/world.py", "if TYPE_CHECKING:\n    from selftouch_drake import show"),
        ("robot/world.py", "from ..evaluation import coverage"),
        ("run/stages.py", "from selftouch_drake.cli.stages import progress_bar"),
        ("files.py", "from .resources import MODELS"),
        ("quotient/learn.py", "from selftouch_drake.threads import mapped"),
        ("quotient/plan.py", "from ..agent import memory"),
        ("agent/agent.py", "from selftouch_drake.experience import ExperienceReader"),
        ("agent/agent.py", "from selftouch_drake.files import load_arrays"),
        ("run/stages.py", "from selftouch_drake.robot import World"),
        ("experience/collect.py", "from selftouch_drake.robot import World"),
    ],
)
def test_an_import_that_points_up_is_found(module, text):
    assert len(upward_imports(PACKAGE / module, text)) == 1


@pytest.mark.parametrize(
    ("module", "text"),
    [
        ("agent/agent.py", "from selftouch_drake.geometry import farthest_points"),
        ("agent/shape/recovery.py", "from ..representation import quotient"),
        ("agent/shape/recovery.py", "from ...quotient import body"),
        ("quotient/learn.py", "from .threads import mapped"),
        ("cli/__init__.py", "from selftouch_drake import __version__"),
    ],
)
def test_an_import_that_points_down_is_let_through(module, text):
    assert upward_imports(PACKAGE / module, text) == []


def test_what_is_imported_from_elsewhere_is_declared():
    project = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text())["project"]
    groups = project["optional-dependencies"]
    # What a user may leave out is imported where it is used, and its absence is handled there.
    optional = ("collada", "dask", "gym", "hdf5", "homology", "ros")
    left_out = [entry for name in optional for entry in groups[name]]
    wanted = [*project["dependencies"], *left_out]
    declared = {re.match(r"[\w-]+", entry)[0].lower() for entry in wanted}
    found = {
        name.partition(".")[0]
        for path in modules()
        for _, name in imports(path, path.read_text(encoding="utf-8"))
    }
    # An extra may be left out, and then nothing says whose module it is.
    distributions = {"collada": ["pycollada"]} | dict(packages_distributions())
    owners = {
        name: {owner.lower() for owner in distributions.get(name, [name])}
        for name in found - {*sys.stdlib_module_names, "selftouch_drake"}
    }
    assert {name for name, owner in owners.items() if not owner & declared} == set()


def systems_in(text: str) -> set[str]:
    """What a module of `robot` names that makes it more than a plant: systems and diagrams."""
    names = {
        alias.name
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.ImportFrom)
        and (node.module or "").startswith("pydrake.systems")
        and node.module != "pydrake.systems.lcm"  # messages are no systems
        for alias in node.names
        if alias.name != "Context"  # a plant's state, which its functions are given
    }
    modules = {
        alias.name
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Import)
        for alias in node.names
        if alias.name.startswith("pydrake.systems")
    }
    return names | modules


@pytest.mark.parametrize("path", sorted((PACKAGE / "robot").glob("*.py")), ids=lambda p: p.stem)
def test_robots_hold_no_system_and_build_no_diagram(path):
    assert systems_in(path.read_text(encoding="utf-8")) == set()


@pytest.mark.parametrize(
    "text",
    [
        "from pydrake.systems.framework import LeafSystem",
        "def f():\n    from pydrake.systems.framework import DiagramBuilder",
        "import pydrake.systems.framework",
    ],
)
def test_a_system_among_robots_is_found(text):
    assert len(systems_in(text)) == 1


def test_nothing_but_systems_are_leaf_systems_or_build_diagrams():
    rooms = {
        room_of(path)
        for path in modules()
        if re.search(r"\b(LeafSystem|DiagramBuilder)\b", path.read_text(encoding="utf-8"))
    }
    # Where nothing is simulated, `show` poses a robot.
    assert rooms <= {"systems", "show"}
