import dataclasses
import gc
import os
import shutil
import signal
import sys
from pathlib import Path

import pytest
from hypothesis import settings
from threadpoolctl import threadpool_limits

from selftouch_drake.experiment import load_experiment
from selftouch_drake.experiment.schema import Imperfections, ReadingSettings
from selftouch_drake.robot import World
from selftouch_drake.robot import world as world_module
from selftouch_drake.robot.skins import make_skins
from selftouch_drake.run.directory import RunDirectory

# pytest's importlib mode imports test files alone: this lets them share `fenced`.
sys.path.insert(0, str(Path(__file__).parent))

from made_once import made_once

# Each worker has a core: a second thread of its linear algebra would only take that of the other.
# Libraries that are loaded already are told; others, and programs that tests start, look it up.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    threadpool_limits(int(os.environ["OMP_NUM_THREADS"]))

# Some share with `benchmarks`: the imitation of a real skin is the one there.
sys.path.append(str(Path(__file__).parents[1]))

# The same examples every time; `make fuzz` looks for new ones.
settings.register_profile("steady", derandomize="SELFTOUCH_FUZZ" not in os.environ)
settings.load_profile("steady")

# A shell that runs the tests in its background lets them ignore Ctrl-C, and so do the programs
# that they start: those that are to be stopped would never hear of it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def _skins_are_made_once():
    """Worlds of shipped robots share skins that are described alike: they take seconds to make."""
    made = {}

    def skins(experiment):
        given = [
            dataclasses.replace(skin, imperfections=Imperfections(), reading=ReadingSettings())
            for skin in experiment.skins.values()
        ]
        files = any(skin.receptors or skin.surface.mesh for skin in given)
        if files or not experiment.robot.directives.startswith("package://selftouch_drake/"):
            return make_skins(experiment)
        key = repr((experiment.robot, [*experiment.skins], given, experiment.seed))
        key += repr(experiment.changes)
        if key not in made:
            made[key] = make_skins(experiment)
        return made[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(world_module, "make_skins", skins)
        yield


@pytest.fixture
def skins_are_made_anew(monkeypatch):
    """Skins are made in the test, as they are for a user."""
    monkeypatch.setattr(world_module, "make_skins", make_skins)


@pytest.fixture(scope="session")
def cube_world():
    """One finger on a cube."""
    return World(load_experiment("cube"))


@pytest.fixture(scope="session")
def torus_world():
    """Two fingers on a torus."""
    return World(load_experiment("torus_two_fingers"))


@pytest.fixture(scope="session", params=["cube_world", "torus_world"])
def world(request):
    """Each of the worlds above."""
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory) -> Path:
    """A small run of the cube with its report, made once for all workers; leave it as it is."""

    def make(path: Path) -> None:
        from commands import SMALL, selftouch

        done = selftouch("run", "cube", "--out", path, "--set", SMALL, "--workers", 1)
        assert done.status == 0, done.stderr

    return made_once(tmp_path_factory, "cube", make)


@pytest.fixture
def small_run(finished_run, tmp_path) -> RunDirectory:
    """A copy of `finished_run`."""
    return RunDirectory.open(shutil.copytree(finished_run, tmp_path / "cube"))


@pytest.fixture(scope="module")
def frees_meshcat():
    """Frees every Meshcat that the module opened, in this thread: another would end the process."""
    yield
    gc.collect()
