import pyarrow as pa
from matplotlib.figure import Figure

from selftouch_drake.sweep.figures import draw_sweep_figures, label


def test_pictures_are_drawn_of_what_varied(tmp_path):
    table = pa.table(
        {
            "run": list("abcdef"),
            "experiment": ["cube"] * 6,
            "seed": [0, 1] * 3,
            "skins.body.num_receptors": [50, 50, 100, 100, 50, 50],
            "skins.body.imperfections.saturation": [None, None, None, None, 1.0, 1.0],
            "shape_rms_fraction": [0.1, 0.2, 0.1, None, 0.3, 0.3],
            "shape_trusted": [True, False, True, None, False, False],
            "topology_betti": [[1, 0, 1]] * 5 + [None],
        }
    ).replace_schema_metadata(
        {"selftouch.fields": "skins.body.num_receptors\nskins.body.imperfections.saturation"}
    )
    paths = draw_sweep_figures(table, tmp_path / "figures")
    assert [path.name for path in paths] == [
        "skins.body.num_receptors.png",
        "skins.body.imperfections.saturation.png",
    ]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in paths)


def test_panels_have_units_and_only_what_changes_has_one(tmp_path, monkeypatch):
    assert label("skins.body.num_receptors") == "skins.body.num_receptors"
    assert label("execution_contact_worst") == "execution_contact_worst (%)"
    assert label("shape_rms_fraction_by_metric.motor") == "shape_rms_fraction_by_metric.motor (%)"
    drawn = []
    monkeypatch.setattr(
        "selftouch_drake.sweep.figures._draw",
        lambda field, rows, names: drawn.append((field, names)) or Figure(),
    )
    table = pa.table(
        {
            "run": ["a", "b"],
            "experiment": ["cube", "cube"],
            "seed": [0, 0],
            "skins.body.num_receptors": [50, 100],
            "topology_betti": [[1, 0, 1], [1, 0, 1]],
            "parts_found": [1, 2],
        }
    ).replace_schema_metadata({"selftouch.fields": "skins.body.num_receptors"})
    draw_sweep_figures(table, tmp_path)
    assert drawn == [("skins.body.num_receptors", ["parts_found"])]
