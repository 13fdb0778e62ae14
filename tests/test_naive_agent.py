"""The agent is naive: what learns and plans reaches neither Drake nor the world nor the truth."""

import subprocess
import sys

import pytest

NAIVE = (
    "selftouch_drake.agent.representation",
    "selftouch_drake.agent.shape",
    "selftouch_drake.agent.planning",
)


@pytest.mark.parametrize("package", NAIVE)
def test_naive_package_loads_neither_drake_nor_the_world(package):
    # What is imported in a fresh interpreter is the whole truth about imports, indirect ones too.
    listing = f"import sys, {package}; print(*sorted(sys.modules), sep='\\n')"
    modules = subprocess.run(
        [sys.executable, "-c", listing], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    forbidden = (
        "pydrake",
        "selftouch_drake.robot",
        "selftouch_drake.geometry",
        "selftouch_drake.evaluation",
        "selftouch_drake.experiment",
    )
    assert package in modules
    assert [name for name in modules if name.startswith(forbidden)] == []
