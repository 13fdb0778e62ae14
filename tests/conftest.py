import gc
import os
import signal
import sys
from pathlib import Path

import pytest
from hypothesis import settings

from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World

# pytest's importlib mode imports test files alone: this lets them share `fenced`.
sys.path.insert(0, str(Path(__file__).parent))
# The imitation of a real skin is the one that the benchmarks have.
sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

# The same examples every time; `make fuzz` looks for new ones.
settings.register_profile("steady", derandomize="SELFTOUCH_FUZZ" not in os.environ)
settings.load_profile("steady")

# A shell that runs the tests in its background lets them ignore Ctrl-C, and so do the programs
# that they start: those that are to be stopped would never hear of it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


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


@pytest.fixture(scope="module")
def frees_meshcat():
    """Frees every Meshcat that the module opened, in this thread: another would end the process."""
    yield
    gc.collect()
