"""Every notebook runs from its first cell to its last, at a small scale.

A cell with small values follows the first cell that assigns one of the names in `SMALL`; a
notebook that assigns none of them is small anyway.
"""

import ast
import base64
import io
import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from PIL import Image

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))
SMALL = {
    "NUM_SAMPLES": 4000,
    "NUM_KERNELS": 80,
    "NUM_PAIRS": 1,
    "NUM_ACTIONS": 1500,
    "NUM_STEPS": 40_000,
    "RATE_HZ": 1,
    "NUM_PLACES": 60,
    "NUM_RECEPTORS": (20, 50),
    "METRIC": "sensorimotor",
    "METRICS_SHOWN": ("motor", "sensorimotor"),
    "SECONDS": 5.0,
    "NUM_TASKS": 20,
}
# What only one notebook needs: a large package, with torch.
NEEDS = {"learn_to_reach": "stable_baselines3"}
# Those that take long however small they are.
LONG = {"any_robot", "paper_figures", "what_the_agent_knows"}
# s a cell, on a machine that tests on all its cores.
PATIENCE = 600


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """The folder in which notebooks share their runs."""
    return tmp_path_factory.mktemp("runs")


def assigned(cell) -> set[str]:
    """The names that a cell assigns at its top level."""
    if cell.cell_type != "code":
        return set()
    lines = [line for line in cell.source.splitlines() if not line.startswith(("%", "!"))]
    statements = ast.parse("\n".join(lines)).body
    targets = [t for node in statements if isinstance(node, ast.Assign) for t in node.targets]
    return {node.id for t in targets for node in ast.walk(t) if isinstance(node, ast.Name)}


def made_small(notebook, folder):
    values = {**SMALL, "FOLDER": str(folder)}
    for number, cell in enumerate(notebook.cells):
        if small := sorted(assigned(cell) & {*values}):
            lines = [f"{name} = {values[name]!r}" for name in small]
            notebook.cells.insert(number + 1, nbformat.v4.new_code_cell("\n".join(lines)))
            break
    return notebook


@pytest.mark.slow
@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=pytest.mark.long if path.stem in LONG else (), id=path.stem)
        for path in NOTEBOOKS
    ],
)
def test_notebook_runs(path, folder, tmp_path):
    if needed := NEEDS.get(path.stem):
        pytest.importorskip(needed)
    notebook = made_small(nbformat.read(path, as_version=4), folder)
    where = {"metadata": {"path": tmp_path}}
    NotebookClient(notebook, timeout=PATIENCE, kernel_name="python3", resources=where).execute()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_is_stored_is_whole_and_small(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    outputs = [output for cell in cells for output in cell.outputs]
    # `make notebooks` stores what a notebook shows; a person may have cleared it.
    assert {cell.execution_count is None for cell in cells} in ({True}, {False})
    assert not any(output.output_type == "error" for output in outputs)
    assert path.stat().st_size < 1_000_000
    assert not re.search(r"/(tmp|home|root|work)/", path.read_text(encoding="utf-8"))


def test_visitors_see_pictures():
    text = [path.read_text(encoding="utf-8") for path in NOTEBOOKS]
    assert sum("image/png" in one for one in text) > len(text) / 2


def test_a_recording_is_embedded():
    notebook = nbformat.read(NOTEBOOKS[0].with_name("sensation_to_sensation.ipynb"), as_version=4)
    (cell,) = [cell for cell in notebook.cells if "display(recording" in cell.source]
    image = base64.b64decode(cell.outputs[0].data["image/png"])
    with Image.open(io.BytesIO(image)) as picture:
        assert picture.n_frames > 10
