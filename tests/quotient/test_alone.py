"""The paper is readable alone: its folder needs nothing of ours, and few libraries."""

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from selftouch_drake import quotient

FOLDER = Path(quotient.__file__).parent
ALLOWED = {"numpy", "scipy", "sklearn", "networkx", "numba", "threadpoolctl"}
SPHERE = """
import sys
import numpy as np
from quotient import PlanningGraph, learn, plan, recover

assert not any(name.startswith("selftouch_drake") for name in sys.modules)
with np.load("sphere.npz") as file:
    representation = learn(file["q"], file["sensation"], num_targets=80)
shape = recover(representation)
path = plan(representation, 3, 60)
print(*shape.topology.betti, *path.nodes[[0, -1]])
assert not any(name.startswith("selftouch_drake") for name in sys.modules)
"""


def outside(source: str) -> set[str]:
    """What a module imports from beyond its folder, the standard library and a few libraries."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level != 1:
            found.add("." * node.level + (node.module or ""))
    return {
        name for name in found if name.partition(".")[0] not in ALLOWED | sys.stdlib_module_names
    }


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*")), ids=lambda path: path.name)
def test_it_imports_nothing_of_ours(path):
    if path.name != "__pycache__":
        assert path.suffix == ".py"
        assert outside(path.read_text(encoding="utf-8")) == set()


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("from selftouch_drake.files import x", {"selftouch_drake.files"}),
        ("def f():\n    import joblib", {"joblib"}),
        ("from ..agent import agent", {"..agent"}),
        ("from .kernels import KernelSets\nimport numpy.linalg, os", set()),
    ],
)
def test_the_look_at_the_source_sees_what_is_imported(source, found):
    assert outside(source) == found


def reading_order() -> list[str]:
    """The modules in the order in which the package says to read them; tools come first."""
    lists, tools = quotient.__doc__.split("1. ", 1)[1].split("are tools")[0].rsplit("\n\n", 1)
    in_lists = [re.findall("`(\\w+)`", line) for line in lists.split("\n")]
    return re.findall("`(\\w+)`", tools) + [name for names in in_lists for name in names]


def test_each_module_needs_only_those_that_are_read_before_it():
    order = reading_order()
    assert sorted(order) == sorted(path.stem for path in FOLDER.glob("*.py") if path.stem[0] != "_")
    for place, name in enumerate(order):
        source = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
        needs = {
            node.module
            for node in ast.walk(ast.parse(source))
            if isinstance(node, ast.ImportFrom) and node.level == 1
        }
        assert needs <= set(order[:place]), name


def test_the_folder_copied_out_learns_recovers_and_plans(tmp_path, experience):
    shutil.copytree(FOLDER, tmp_path / "quotient", ignore=shutil.ignore_patterns("__pycache__"))
    q, sensation = experience
    np.savez(tmp_path / "sphere.npz", q=q, sensation=sensation)
    # Isolated, so that neither the environment nor an editable install of the package is found.
    program = f"import sys; sys.path[:] = {sys.path[1:]!r}; sys.path.insert(0, '.')\n{SPHERE}"
    program = program.replace("import numpy as np\n", HIDE + "import numpy as np\n", 1)
    done = subprocess.run(
        [sys.executable, "-I", "-c", program],
        cwd=tmp_path,
        env=os.environ | {"NUMBA_OPT": "0"},  # it compiles everything, and for once
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["1", "0", "1", "3", "60"]


#: What refuses to import the package, wherever it is found.
HIDE = """
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "selftouch_drake":
            raise ImportError(f"{name} is not needed")


sys.meta_path.insert(0, Refuse())
"""
