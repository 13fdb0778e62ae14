"""A run whose body is of the user's own: everything from babbling to the report."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import selftouch
from matplotlib.figure import Figure

from selftouch_drake.files import load_arrays

TOYS = Path(__file__).with_name("toys.py")
SMALL = {
    "babbling": {"num_samples": 2000, "walk_size": 1000},
    "representation": {"num_targets": 60, "metric": "sensorimotor", "body_model": "off"},
    "evaluation": {"num_pairs": 1},
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
    python = {"file": str(TOYS), "class": "Flat"}
    (folder / "flat.yaml").write_text(yaml.safe_dump({"python": python, **SMALL}))
    with pytest.MonkeyPatch.context() as patch:
        # Figures are made but not rendered: no test here looks at them.
        patch.setattr(Figure, "savefig", lambda figure, path, **_: path.write_bytes(b"pixels"))
        done = selftouch("run", folder / "flat.yaml", "--out", folder / "run", "--workers", 1)
    assert done.status == 0, done.stderr
    return folder / "run"


def test_everything_is_done_but_what_needs_a_truth(finished):
    metrics = json.loads((finished / "metrics.json").read_text())
    assert metrics["parts_found"] == 1
    assert not any(name.startswith("shape_rms") for name in metrics)
    assert not (finished / "truth").exists()
    assert "The body comes from python." in (finished / "report.html").read_text()


def test_a_plan_is_executed_on_it(finished):
    for verb in ("plan", "execute"):
        done = selftouch(verb, finished, "--from", 3, "--to", 40)
        assert done.status == 0, done.stderr
    assert "in contact: " in done.stdout


def test_its_life_is_shown_as_curves_without_what_needs_a_truth(finished):
    done = selftouch("live", finished)
    assert done.status == 0, done.stderr
    assert (
        "selftouch: no page: it needs a robot that Drake simulates, and this run has none"
        in done.stderr
    )
    life = load_arrays(finished / "life.npz")
    assert life["block_touches"].tolist() == list(range(50, 2001, 50))
    assert life["coverage"][-1] == 1
    assert np.isnan(life["error"]).all()
    assert np.isnan(life["contact"]).all()


def test_an_environment_lives(tmp_path):
    pytest.importorskip("gymnasium", reason="pip install gymnasium")
    env = {
        "env": f"{TOYS.with_name('worlds.py')}:Sliders",
        "joints": "joints",
        "touch": "touch",
        "action": "none",
        "set_posture": "set_posture",
    }
    settings = SMALL | {"gymnasium": env, "babbling": {"num_samples": 1000}}
    (tmp_path / "env.yaml").write_text(yaml.safe_dump(settings))
    done = selftouch("live", tmp_path / "env.yaml", "--out", tmp_path / "run", "--no-page")
    assert done.status == 0, done.stderr
    life = load_arrays(tmp_path / "run" / "life.npz")
    assert life["block_touches"].tolist() == list(range(50, 1001, 50))
