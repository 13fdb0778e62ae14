"""Runs notebooks from the first cell to the last, and stores their outputs.

    python benchmarks/make/notebooks.py                    # all of them
    python benchmarks/make/notebooks.py trust two_fingers

Messages on stderr, such as progress, are left out. Pictures are stored with few colours. By default
`learn_to_reach` runs only where Stable-Baselines3 is installed.
"""

from __future__ import annotations

import argparse
import base64
import io
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from PIL import Image

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
COLORS = 128


def smaller(image: str) -> str:
    """A PNG in base64 with its own palette; unchanged if that is not smaller, or if it moves."""
    picture = Image.open(io.BytesIO(base64.b64decode(image)))
    if getattr(picture, "is_animated", False):
        return image
    file = io.BytesIO()
    picture.convert("RGB").quantize(COLORS, dither=Image.Dither.NONE).save(
        file, "PNG", optimize=True
    )
    return min(base64.b64encode(file.getvalue()).decode("ascii"), image, key=len)


def run(path: Path, folder: Path) -> None:
    """Runs a notebook in a folder and stores its outputs."""
    notebook = nbformat.read(path, as_version=4)
    where = {"metadata": {"path": folder}}
    NotebookClient(notebook, timeout=None, kernel_name="python3", resources=where).execute()
    for number, cell in enumerate(c for c in notebook.cells if c.cell_type == "code"):
        cell.execution_count = number + 1
        cell.metadata.pop("execution", None)
        cell.outputs = [o for o in cell.outputs if o.get("name") != "stderr"]
        for output in cell.outputs:
            if image := output.get("data", {}).get("image/png"):
                output.data["image/png"] = smaller(image)
            if "execution_count" in output:
                output.execution_count = number + 1
    notebook.metadata.pop("language_info", None)
    nbformat.write(notebook, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="of notebooks; all by default")
    names = parser.parse_args().names or sorted(
        path.stem
        for path in NOTEBOOKS.glob("*.ipynb")
        if path.stem != "learn_to_reach" or find_spec("stable_baselines3")
    )
    # Notebooks leave their runs in `../runs`, for one another.
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "notebooks"
        folder.mkdir()
        for name in names:
            began, path = time.perf_counter(), NOTEBOOKS / f"{name}.ipynb"
            run(path, folder)
            took, size = time.perf_counter() - began, path.stat().st_size
            print(f"{name}: {took:.0f} s, {size / 1e6:.2f} MB", flush=True)


if __name__ == "__main__":
    main()
