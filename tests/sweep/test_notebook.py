import json
from pathlib import Path

from matplotlib.figure import Figure

NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "trust.ipynb"


def test_the_notebook_of_the_study_runs_on_its_table(monkeypatch, capsys):
    monkeypatch.chdir(NOTEBOOK.parent)
    names = {}
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    assert isinstance(names["figure"], Figure)
    assert "torus   20 receptors" in capsys.readouterr().out
