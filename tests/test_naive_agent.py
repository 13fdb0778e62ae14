"""The agent is naive: none of its modules reaches Drake, the world, the truth or files."""

import ast
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

from selftouch_drake import agent, quotient

MODULES = [
    agent.__name__,
    *(found.name for found in pkgutil.walk_packages(agent.__path__, f"{agent.__name__}.")),
    *(found.name for found in pkgutil.walk_packages(quotient.__path__, f"{quotient.__name__}.")),
]

FORBIDDEN = (
    "pydrake",
    "selftouch_drake.robot",
    "selftouch_drake.bodies",
    "selftouch_drake.evaluation",
    "selftouch_drake.experiment",
    "selftouch_drake.experience",
    "selftouch_drake.run",
    "selftouch_drake.show",
    "selftouch_drake.sweep",
    "selftouch_drake.files",
    "selftouch_drake.cli",
)


def imported(*modules: str) -> set[str]:
    """All modules loaded in a fresh interpreter, so that indirect imports count too."""
    program = f"import sys, {', '.join(modules)}; print(*sys.modules, sep='\\n')"
    listing = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    return set(listing.stdout.splitlines())


def test_every_module_is_looked_at():
    assert {
        "selftouch_drake.agent.agent",
        "selftouch_drake.agent.motions",
        "selftouch_drake.agent.tries",
        "selftouch_drake.agent.planning.planner",
        "selftouch_drake.agent.representation.estimator",
        "selftouch_drake.agent.shape.recovery",
        "selftouch_drake.quotient.learn",
    } <= set(MODULES)


def test_no_module_of_the_agent_loads_what_it_must_not_know():
    loaded = imported(*MODULES)
    assert set(MODULES) <= loaded
    guilty = sorted(
        name for name in loaded if any(f"{name}.".startswith(f"{bad}.") for bad in FORBIDDEN)
    )
    assert guilty == []


def test_only_the_estimator_loads_scikit_learn():
    estimator = "selftouch_drake.agent.representation.estimator"
    others = [name for name in MODULES if name != estimator]
    assert "sklearn" not in imported(*others, "selftouch_drake.run.stages")
    assert "sklearn" in imported(estimator)


def test_the_search_sees_what_is_loaded():
    assert "selftouch_drake.files" in imported(*MODULES, "selftouch_drake.files")


# pandas loads pyarrow, and scikit-learn loads pandas where it finds it: so look at the source.
ALLOWED = {
    *("numpy", "scipy", "sklearn", "networkx", "numba", "joblib", "threadpoolctl", "ripser"),
    *sys.stdlib_module_names,
}


def outside(source: str) -> set[str]:
    """Imports of a module other than the agent and its few libraries."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or "")
    own = (
        "selftouch_drake.agent",
        "selftouch_drake.compiled",
        "selftouch_drake.quotient",
        "selftouch_drake.randomness",
    )
    return {n for n in names if n.split(".")[0] not in ALLOWED and not n.startswith(own)}


@pytest.mark.parametrize(
    "path", sorted(Path(agent.__path__[0]).rglob("*.py")), ids=lambda p: p.stem
)
def test_a_module_of_the_agent_names_only_a_few_libraries(path):
    assert outside(path.read_text()) == set()


def test_the_look_at_the_source_sees_what_is_imported():
    assert outside("def f():\n    import pyarrow.parquet") == {"pyarrow.parquet"}
    assert outside("from selftouch_drake.files import x") == {"selftouch_drake.files"}
