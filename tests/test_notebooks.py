"""Every notebook runs from its first cell to its last, at a small scale.

A notebook names its scale in a cell that is tagged `parameters`, as papermill has it; what is named
there and below is made small in a cell after it. What a notebook asserts, it shows.
"""

import ast
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))
SMALL = {
    "NUM_SAMPLES": 4000,
    "NUM_TARGETS": 80,
    "NUM_PAIRS": 1,
    "NUM_STEPS": 40_000,
    "NUM_PLACES": 60,
    "NUM_RECEPTORS": (20, 50),
    "METRICS_SHOWN": ("motor", "sensorimotor"),
}
# s a cell, on a machine that tests on all its cores.
PATIENCE = 600


@pytest.fixture(scope="session")
def runs(tmp_path_factory):
    """Where notebooks leave their runs, for one another."""
    return tmp_path_factory.mktemp("runs")


def named(source: str) -> set[str]:
    assigned = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Assign))
    return {target.id for node in assigned for target in node.targets}


def made_small(notebook, runs):
    for number, cell in enumerate(notebook.cells):
        if "parameters" in cell.metadata.get("tags", []):
            values = {**SMALL, "RUNS": str(runs)}
            small = sorted(named(cell.source) & {*values})
            lines = [f"{name} = {values[name]!r}" for name in small]
            notebook.cells.insert(number + 1, nbformat.v4.new_code_cell("\n".join(lines)))
            return notebook
    return notebook


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path, runs, tmp_path):
    notebook = made_small(nbformat.read(path, as_version=4), runs)
    where = {"metadata": {"path": tmp_path}}
    NotebookClient(notebook, timeout=PATIENCE, kernel_name="python3", resources=where).execute()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_outputs_are_cleared(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(not cell.outputs and cell.execution_count is None for cell in code)
