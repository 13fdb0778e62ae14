import sys
from pathlib import Path

import matplotlib as mpl
import pytest
from matplotlib.figure import Figure
from pydrake.geometry import Meshcat

from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.show.meshcat.stage import page_meshcat
from selftouch_drake.show.outputs import write_report

# pytest's importlib mode imports test files alone: this lets them share `laid_out`.
sys.path.insert(0, str(Path(__file__).parent))

from laid_out import lay_out
from made_once import made_once

MALICIOUS = '<script>alert("&")</script>'


@pytest.fixture
def make_run(tmp_path):
    """Makes a run up to a given stage."""
    return lambda stage, kind="ball": lay_out(tmp_path / "run", kind=kind, stage=stage)


@pytest.fixture
def unrendered(monkeypatch):
    """Figures are made but not rendered, where only their existence matters."""

    def savefig(figure, path, **options):
        path.write_bytes(b"pixels")

    monkeypatch.setattr(Figure, "savefig", savefig)


@pytest.fixture(scope="session")
def reported(tmp_path_factory) -> RunDirectory:
    """A run that was executed and reported, under a malicious name."""
    return RunDirectory.open(made_once(tmp_path_factory, "reported", _report_of_a_ball))


def _report_of_a_ball(path: Path) -> None:
    run = lay_out(path, name=MALICIOUS)
    style, ports = dict(mpl.rcParams), []
    had_one = page_meshcat.knows()

    def opened(params):
        meshcat = Meshcat(params)
        ports.append(meshcat.port())
        return meshcat

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("selftouch_drake.show.meshcat.stage.Meshcat", opened)
        write_report(run)
    assert dict(mpl.rcParams) == style, "drawing changed matplotlib's own settings"
    # For all its pages a thread opens one, unless other tests had it open one; it is left empty.
    assert len(ports) == (0 if had_one else 1)
    assert not any(map(page_meshcat().HasPath, ("/drake", "/skins", "/expected", "/recovered")))


@pytest.fixture(scope="session")
def two_skins(tmp_path_factory) -> RunDirectory:
    """A reported run of two skins, one on an arm that moves."""

    def make(path: Path) -> None:
        write_report(lay_out(path, kind="two_skins"))

    return RunDirectory.open(made_once(tmp_path_factory, "two_skins", make))


@pytest.fixture(scope="module", autouse=True)
def _no_meshcat_is_left(frees_meshcat):
    pass
